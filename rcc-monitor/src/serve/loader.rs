//! Client of the loader's REST interface for the dashboard: one request per connection, and streams of server-sent events.
//! Run by the serving thread, which never waits for the loader.

use std::io;
use std::path::PathBuf;
use std::time::Duration;

use http_body_util::{BodyExt, Full};
use hyper::body::{Bytes, Incoming};
use hyper::client::conn::http1::{SendRequest, handshake};
use hyper::{Method, Request, Response};
use hyper_util::rt::TokioIo;
use rcc_api::bodies::ErrorBody;
use rcc_api::codes;
use rcc_api::routes::TIMEOUT_HEADER;
use rcc_ipc::cell::base_dir;
use serde_json::Value;
use tokio::net::UnixStream;

/// Time limit of a request.
pub const TIMEOUT: Duration = Duration::from_secs(5);
/// Largest part of an event of a stream that is kept until it is complete, bytes.
const EVENT_MAX: usize = 4 << 20;

/// The loader of a cell.
#[derive(Clone, Debug)]
pub struct LoaderPeer {
    cell: String,
    socket: PathBuf,
}

/// An answer: status and JSON.
#[derive(Clone, Debug)]
pub struct Answer {
    /// HTTP status.
    pub status: u16,
    /// The body; for a status of 400 and above an [`ErrorBody`].
    pub body: Bytes,
}

/// A stream of server-sent events.
#[derive(Debug)]
pub struct EventStream {
    body: Incoming,
    buffer: Vec<u8>,
    // The connection ends with it.
    _sender: SendRequest<Full<Bytes>>,
}

impl LoaderPeer {
    /// Creates a client for the cell of this name; the cell need not exist yet.
    #[must_use]
    pub fn new(cell: &str) -> LoaderPeer {
        LoaderPeer {
            cell: cell.to_owned(),
            socket: base_dir().join(cell).join("loader.sock"),
        }
    }

    /// Sends a request and waits for its answer.
    ///
    /// # Errors
    /// Returns the error that the page shows if the loader does not answer.
    pub async fn request(
        &self,
        method: Method,
        path: &str,
        body: String,
    ) -> Result<Answer, ErrorBody> {
        let exchange = async {
            let (_sender, response) = self.send(method, path, body).await?;
            let status = response.status().as_u16();
            let body = response.into_body().collect().await;
            let body = body.map_err(io::Error::other)?.to_bytes();
            io::Result::Ok(Answer { status, body })
        };
        match tokio::time::timeout(TIMEOUT, exchange).await {
            Ok(Ok(answer)) => Ok(answer),
            Ok(Err(error)) => Err(self.unreachable(&error)),
            Err(_) => Err(ErrorBody {
                code: codes::LOADER_SILENT.code.to_owned(),
                message: format!(
                    "the loader of cell `{}` did not answer within {TIMEOUT:?}",
                    self.cell
                ),
                help: Some(
                    "CANCEL and ABORT are carried out all the same as soon as it can".to_owned(),
                ),
                ..ErrorBody::default()
            }),
        }
    }

    /// Reads a value.
    ///
    /// # Errors
    /// Returns the loader's error, or the reason why it does not answer.
    pub async fn get(&self, path: &str) -> Result<Value, ErrorBody> {
        let answer = self.request(Method::GET, path, String::new()).await?;
        let unreadable = |error: serde_json::Error| ErrorBody {
            code: codes::OTHER_BUILD.code.to_owned(),
            message: format!("cannot parse the loader's answer: {error}"),
            help: Some("install rcc-monitor and rcc-loader from the same build".to_owned()),
            ..ErrorBody::default()
        };
        match answer.status {
            200..300 => serde_json::from_slice(&answer.body).map_err(unreadable),
            _ => Err(serde_json::from_slice(&answer.body).map_err(unreadable)?),
        }
    }

    /// Opens a stream.
    ///
    /// # Errors
    /// As [`LoaderPeer::get`].
    pub async fn open(&self, path: &str) -> Result<EventStream, ErrorBody> {
        let opened = self.send(Method::GET, path, String::new()).await;
        let (sender, response) = opened.map_err(|error| self.unreachable(&error))?;
        let status = response.status();
        let mut body = response.into_body();
        if status.is_success() {
            return Ok(EventStream {
                body,
                buffer: Vec::new(),
                _sender: sender,
            });
        }
        let text = (&mut body).collect().await;
        let text = text.map_err(|error| self.unreachable(&io::Error::other(error)))?;
        Err(serde_json::from_slice(&text.to_bytes()).unwrap_or_default())
    }

    async fn send(
        &self,
        method: Method,
        path: &str,
        body: String,
    ) -> io::Result<(SendRequest<Full<Bytes>>, Response<Incoming>)> {
        let stream = UnixStream::connect(&self.socket).await?;
        let (mut sender, connection) = handshake(TokioIo::new(stream))
            .await
            .map_err(io::Error::other)?;
        // It ends when the sender and the body are dropped.
        tokio::spawn(connection);
        let time = TIMEOUT.as_millis() as u64;
        let request = Request::builder().method(method).uri(path);
        let request = request.header("host", "rcc").header(TIMEOUT_HEADER, time);
        let request = request
            .body(Full::new(Bytes::from(body)))
            .map_err(io::Error::other)?;
        let response = sender
            .send_request(request)
            .await
            .map_err(io::Error::other)?;
        Ok((sender, response))
    }

    fn unreachable(&self, error: &io::Error) -> ErrorBody {
        ErrorBody {
            code: codes::NO_LOADER.code.to_owned(),
            message: format!("cannot reach the loader of cell `{}` ({error})", self.cell),
            help: Some("start the cell with `rcc-cli up FILE`".to_owned()),
            ..ErrorBody::default()
        }
    }
}

impl EventStream {
    /// Returns name and data of the next event; `None` at the end of the stream.
    pub async fn next(&mut self) -> Option<(String, Value)> {
        loop {
            if let Some(event) = take_event(&mut self.buffer) {
                return Some(event);
            }
            let frame = self.body.frame().await?.ok()?;
            let data = frame.into_data().ok()?;
            if self.buffer.len() + data.len() > EVENT_MAX {
                return None;
            }
            self.buffer.extend_from_slice(&data);
        }
    }
}

/// Takes the first complete event out of the buffer; comments and other events without JSON are skipped.
fn take_event(buffer: &mut Vec<u8>) -> Option<(String, Value)> {
    while let Some(end) = buffer.windows(2).position(|two| two == b"\n\n") {
        let block: Vec<u8> = buffer.drain(..end + 2).collect();
        let block = String::from_utf8_lossy(&block);
        let field = |name: &str| block.lines().find_map(|line| line.strip_prefix(name));
        let data = field("data:").and_then(|data| serde_json::from_str(data).ok());
        if let Some(data) = data {
            let name = field("event:").unwrap_or("message").trim();
            return Some((name.to_owned(), data));
        }
    }
    None
}

/// Percent-encodes a name as one path segment or one value of a query (RFC 3986, section 2.1).
#[must_use]
pub fn encoded(name: &str) -> String {
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
    use serde_json::json;

    #[test]
    fn events_are_taken_when_they_are_complete() {
        let mut buffer =
            b": alive\n\nevent: values\ndata: {\"id\":1}\n\nevent: state\ndata: {".to_vec();
        assert_eq!(
            take_event(&mut buffer),
            Some(("values".to_owned(), json!({"id": 1})))
        );
        assert_eq!(take_event(&mut buffer), None);
        buffer.extend_from_slice(b"\"a\":2}\n\n");
        assert_eq!(
            take_event(&mut buffer),
            Some(("state".to_owned(), json!({"a": 2})))
        );
        assert!(buffer.is_empty());
    }
}
