//! The command line's end of the REST interface: one request a connection over the cell's Unix socket.
//! Blocks the calling thread, never longer than its time-out.

use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use http_body_util::{BodyExt, Full};
use hyper::body::Bytes;
use hyper::{Method, Request, StatusCode};
use hyper_util::rt::TokioIo;
use rcc_loader::server::api::ErrorBody;
use rcc_loader::server::codes;
use serde::de::DeserializeOwned;
use tokio::net::UnixStream;
use tokio::runtime::{Builder, Runtime};

use crate::failure::Failure;

/// Asks the loader of one cell.
#[derive(Debug)]
pub struct Client {
    cell: String,
    socket: PathBuf,
    timeout: Duration,
    runtime: Runtime,
}

impl Client {
    /// A client of the cell `cell` with this socket; every request takes at most `timeout`.
    ///
    /// # Errors
    /// The system gives no event queue.
    pub fn new(cell: &str, socket: &Path, timeout: Duration) -> Result<Client, Failure> {
        let runtime = Builder::new_current_thread()
            .enable_all()
            .build()
            .map_err(|error| {
                Failure::new(
                    codes::PROCESS_FAILED,
                    error.to_string(),
                    "close other programs",
                )
            })?;
        Ok(Client {
            cell: cell.to_owned(),
            socket: socket.to_owned(),
            timeout,
            runtime,
        })
    }

    /// GET.
    ///
    /// # Errors
    /// The loader cannot be reached, is silent, or refuses.
    pub fn get<T: DeserializeOwned>(&self, path: &str) -> Result<T, Failure> {
        self.request(Method::GET, path, String::new())
    }

    /// POST with a text.
    ///
    /// # Errors
    /// As [`Client::get`].
    pub fn post<T: DeserializeOwned>(&self, path: &str, body: String) -> Result<T, Failure> {
        self.request(Method::POST, path, body)
    }

    /// DELETE.
    ///
    /// # Errors
    /// As [`Client::get`].
    pub fn delete<T: DeserializeOwned>(&self, path: &str) -> Result<T, Failure> {
        self.request(Method::DELETE, path, String::new())
    }

    fn request<T: DeserializeOwned>(
        &self,
        method: Method,
        path: &str,
        body: String,
    ) -> Result<T, Failure> {
        let exchange = self.exchange(method, path, body);
        let answer = self
            .runtime
            .block_on(async { tokio::time::timeout(self.timeout, exchange).await });
        let (status, bytes) = match answer {
            Ok(Ok(answer)) => answer,
            Ok(Err(cause)) => return Err(self.unreachable(&cause)),
            Err(_) => {
                return Err(Failure::new(
                    codes::LOADER_SILENT,
                    format!(
                        "the loader of cell '{}' did not answer within {:?}",
                        self.cell, self.timeout
                    ),
                    "whether it did what was asked is not known; give it more time with --timeout",
                ));
            }
        };
        if status.is_success() {
            return serde_json::from_slice(&bytes).map_err(|error| other_build(&error));
        }
        let body: ErrorBody =
            serde_json::from_slice(&bytes).map_err(|error| other_build(&error))?;
        Err(Failure::answered(body))
    }

    async fn exchange(
        &self,
        method: Method,
        path: &str,
        body: String,
    ) -> io::Result<(StatusCode, Bytes)> {
        let stream = UnixStream::connect(&self.socket).await?;
        let (mut sender, connection) = hyper::client::conn::http1::handshake(TokioIo::new(stream))
            .await
            .map_err(io::Error::other)?;
        // Ends with the connection, which ends with `sender`.
        let driven = tokio::spawn(connection);
        let request = Request::builder()
            .method(method)
            .uri(path)
            .header("host", "rcc")
            .body(Full::new(Bytes::from(body)))
            .map_err(io::Error::other)?;
        let response = sender
            .send_request(request)
            .await
            .map_err(io::Error::other)?;
        let status = response.status();
        let bytes = response
            .into_body()
            .collect()
            .await
            .map_err(io::Error::other)?
            .to_bytes();
        driven.abort();
        Ok((status, bytes))
    }

    fn unreachable(&self, cause: &io::Error) -> Failure {
        let cell = &self.cell;
        if cause.kind() == io::ErrorKind::PermissionDenied {
            return Failure::new(
                codes::NOT_PERMITTED,
                format!("{} may not be used by you", self.socket.display()),
                format!("cell '{cell}' belongs to another user: work as that user"),
            );
        }
        no_loader(cell, &format!(" ({cause})"))
    }
}

/// The failure of a cell whose loader is not there.
#[must_use]
pub fn no_loader(cell: &str, cause: &str) -> Failure {
    Failure::new(
        codes::NO_LOADER,
        format!("the loader of cell '{cell}' cannot be reached{cause}"),
        "start the cell with `rcc-cli up FILE`, or name another one with --cell (RCC_CELL)",
    )
}

fn other_build(error: &dyn std::fmt::Display) -> Failure {
    Failure::new(
        codes::OTHER_BUILD,
        format!("the loader's answer is not understood: {error}"),
        "install the command line and the loader from one build",
    )
}

/// A name as one segment of an address (RFC 3986, section 2.1).
#[must_use]
pub fn segment(name: &str) -> String {
    let mut out = String::new();
    for byte in name.bytes() {
        if byte.is_ascii_alphanumeric() || b"-._~".contains(&byte) {
            out.push(char::from(byte));
        } else {
            out.push_str(&format!("%{byte:02X}"));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_becomes_one_segment() {
        assert_eq!(segment("line#7"), "line%237");
        assert_eq!(segment("a/../b?"), "a%2F..%2Fb%3F");
    }

    #[test]
    fn a_socket_that_is_not_there_is_an_unreachable_loader() -> Result<(), Failure> {
        let path = std::env::temp_dir().join("rcc-no-such.sock");
        let client = Client::new("x", &path, Duration::from_secs(20))?;
        let failed = client.get::<serde_json::Value>("/status");
        assert_eq!(
            failed.map_err(|failure| (failure.exit, failure.body.code)),
            Err((4, "RCC4004".to_owned()))
        );
        Ok(())
    }
}
