//! Downloads a long file from the loader, piece by piece; an interrupted download goes on where it was interrupted.
//! Blocks the calling thread for as long as data arrives.

use std::io::{self, Write};
use std::time::Duration;

use http_body_util::{BodyExt, Full};
use hyper::body::{Bytes, Incoming};
use hyper::client::conn::http1::{SendRequest, handshake};
use hyper::{Request, Response};
use hyper_util::rt::TokioIo;
use rcc_api::bodies::ErrorBody;
use rcc_api::codes;
use tokio::net::{TcpStream, UnixStream};
use tokio::task::JoinHandle;

use super::{Endpoint, LoaderClient, answer_not_understood, timeout_help};
use crate::failure::Failure;

/// Reason why a download ended early.
enum DownloadError {
    /// The connection failed, or no data arrived in time.
    Interrupted(io::Error),
    /// The loader refused it, or the file cannot be written.
    Failed(Failure),
}

impl From<io::Error> for DownloadError {
    fn from(error: io::Error) -> DownloadError {
        DownloadError::Interrupted(error)
    }
}

impl From<hyper::Error> for DownloadError {
    fn from(error: hyper::Error) -> DownloadError {
        DownloadError::Interrupted(io::Error::other(error))
    }
}

/// An open connection; the task that drives it ends when this is dropped.
struct Connection {
    sender: SendRequest<Full<Bytes>>,
    driver: JoinHandle<()>,
}

impl Drop for Connection {
    fn drop(&mut self) {
        self.driver.abort();
    }
}

async fn in_time<T>(limit: Duration, what: impl Future<Output = T>) -> io::Result<T> {
    let done = tokio::time::timeout(limit, what).await;
    done.map_err(|_| io::Error::new(io::ErrorKind::TimedOut, format!("no data within {limit:?}")))
}

impl LoaderClient {
    /// Downloads the file at `path` into `out`, and returns its length in bytes. Goes on after an interruption as long as
    /// each connection brings data; each piece arrives within the client's time-out.
    ///
    /// # Errors
    /// Fails if the loader cannot be reached or refuses the request, or if `write_failed` describes why `out` cannot be
    /// written.
    pub fn download(
        &self,
        path: &str,
        out: &mut impl Write,
        write_failed: impl Fn(&io::Error) -> Failure,
    ) -> Result<u64, Failure> {
        let mut received = 0;
        loop {
            let before = received;
            let part = self.receive(path, &mut received, out, &write_failed);
            match self.runtime.block_on(part) {
                Ok(()) => return Ok(received),
                Err(DownloadError::Failed(failure)) => return Err(failure),
                Err(DownloadError::Interrupted(_)) if received > before => {}
                Err(DownloadError::Interrupted(error))
                    if error.kind() == io::ErrorKind::TimedOut =>
                {
                    let message =
                        format!("the download of {path} stopped after {received} bytes: {error}");
                    return Err(Failure::new(
                        codes::LOADER_SILENT,
                        message,
                        timeout_help(path),
                    ));
                }
                Err(DownloadError::Interrupted(error)) => return Err(self.unreachable(&error)),
            }
        }
    }

    /// Receives the rest of the file over one connection.
    async fn receive(
        &self,
        path: &str,
        received: &mut u64,
        out: &mut impl Write,
        write_failed: &impl Fn(&io::Error) -> Failure,
    ) -> Result<(), DownloadError> {
        let mut connection = in_time(self.timeout, self.connect()).await??;
        let mut request = Request::get(path).header("host", self.host());
        if let Endpoint::Tcp(remote) = &self.endpoint
            && let Some(token) = &remote.authorization
        {
            request = request.header("authorization", token.as_slice());
        }
        if *received > 0 {
            request = request.header("range", format!("bytes={received}-"));
        }
        let request = request.body(Full::default()).map_err(io::Error::other)?;
        let sent = connection.sender.send_request(request);
        let response = in_time(self.timeout, sent).await??;
        if !response.status().is_success() {
            return Err(DownloadError::Failed(self.refusal(response).await?));
        }
        let mut body = response.into_body();
        while let Some(frame) = in_time(self.timeout, body.frame()).await? {
            if let Ok(data) = frame?.into_data() {
                let written = out.write_all(&data);
                written.map_err(|error| DownloadError::Failed(write_failed(&error)))?;
                *received += data.len() as u64;
            }
        }
        Ok(())
    }

    async fn refusal(&self, response: Response<Incoming>) -> Result<Failure, DownloadError> {
        let body = in_time(self.timeout, response.into_body().collect()).await??;
        let body = serde_json::from_slice::<ErrorBody>(&body.to_bytes());
        Ok(match body {
            Ok(body) => Failure::from_server(body),
            Err(error) => answer_not_understood(&error),
        })
    }

    fn host(&self) -> &str {
        match &self.endpoint {
            Endpoint::Socket(_) => "rcc",
            Endpoint::Tcp(remote) => &remote.authority,
        }
    }

    async fn connect(&self) -> io::Result<Connection> {
        // The connection's result is that of the requests over it.
        match &self.endpoint {
            Endpoint::Socket(socket) => {
                let stream = TokioIo::new(UnixStream::connect(socket).await?);
                let (sender, driven) = handshake(stream).await.map_err(io::Error::other)?;
                let driver = tokio::spawn(async { driven.await.unwrap_or_default() });
                Ok(Connection { sender, driver })
            }
            Endpoint::Tcp(remote) => {
                let stream = TokioIo::new(TcpStream::connect(&remote.authority).await?);
                let (sender, driven) = handshake(stream).await.map_err(io::Error::other)?;
                let driver = tokio::spawn(async { driven.await.unwrap_or_default() });
                Ok(Connection { sender, driver })
            }
        }
    }
}
