//! Answers that are read while they arrive: lines of a stream. Blocks the calling thread while it waits for a line.

use std::io;
use std::time::Duration;

use http_body_util::{BodyExt, Full};
use hyper::body::{Bytes, Incoming};
use hyper::client::conn::http1::{SendRequest, handshake};
use hyper::http::request::Builder;
use hyper::{Request, Response};
use hyper_util::rt::TokioIo;
use rcc_api::bodies::ErrorBody;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpStream, UnixStream};
use tokio::task::JoinHandle;

use super::{Endpoint, LoaderClient, answer_not_understood};
use crate::error::RequestError;

/// Longest time without a byte after which a stream counts as broken: the loader sends a comment every 5 s.
const SILENCE_MAX: Duration = Duration::from_secs(20);

/// An open connection; the task that drives it ends when this is dropped.
pub(super) struct Connection {
    pub(super) sender: SendRequest<Full<Bytes>>,
    driver: JoinHandle<()>,
}

impl Drop for Connection {
    fn drop(&mut self) {
        self.driver.abort();
    }
}

/// The lines of an answer, as they arrive.
pub struct Lines<'a> {
    client: &'a LoaderClient,
    body: Incoming,
    begun: Vec<u8>,
    _connection: Connection,
}

impl std::fmt::Debug for Lines<'_> {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str("Lines")
    }
}

impl LoaderClient {
    /// Sends a GET request whose answer lasts as long as it is read.
    ///
    /// # Errors
    /// Fails if the loader cannot be reached, does not answer in time, or refuses the request.
    pub fn lines(&self, path: &str) -> Result<Lines<'_>, RequestError> {
        let opened = self.runtime.block_on(async {
            let mut connection = in_time(self.timeout, self.connect()).await??;
            let request = self.authorized(Request::get(path)).body(Full::default());
            let sent = connection
                .sender
                .send_request(request.map_err(io::Error::other)?);
            let response = in_time(self.timeout, sent)
                .await?
                .map_err(io::Error::other)?;
            io::Result::Ok((connection, response))
        });
        let (connection, response) = opened.map_err(|error| self.unreachable(&error))?;
        if !response.status().is_success() {
            let refused = self.runtime.block_on(refusal(response, self.timeout));
            return Err(refused.unwrap_or_else(|error| self.unreachable(&error)));
        }
        Ok(Lines {
            client: self,
            body: response.into_body(),
            begun: Vec::new(),
            _connection: connection,
        })
    }

    /// Adds the host and the token to a request.
    pub(super) fn authorized(&self, request: Builder) -> Builder {
        match &self.endpoint {
            Endpoint::Socket(_) => request.header("host", "rcc"),
            Endpoint::Tcp(remote) => {
                let request = request.header("host", &remote.authority);
                match &remote.authorization {
                    Some(token) => request.header("authorization", token.as_slice()),
                    None => request,
                }
            }
        }
    }

    pub(super) async fn connect(&self) -> io::Result<Connection> {
        match &self.endpoint {
            Endpoint::Socket(socket) => open(UnixStream::connect(socket).await?).await,
            Endpoint::Tcp(remote) => open(TcpStream::connect(&remote.authority).await?).await,
        }
    }
}

impl Lines<'_> {
    /// Returns the next line, or `None` when the loader ends the answer.
    ///
    /// # Errors
    /// Fails if the connection breaks.
    pub fn next_line(&mut self) -> Result<Option<String>, RequestError> {
        loop {
            if let Some(end) = self.begun.iter().position(|byte| *byte == b'\n') {
                let line: Vec<u8> = self.begun.drain(..=end).collect();
                let line = String::from_utf8_lossy(&line);
                return Ok(Some(line.trim_end().to_owned()));
            }
            let frame = self
                .client
                .runtime
                .block_on(in_time(SILENCE_MAX, self.body.frame()));
            let broken = |error: io::Error| self.client.unreachable(&error);
            match frame.map_err(broken)? {
                None => return Ok(None),
                Some(Err(error)) => return Err(broken(io::Error::other(error))),
                Some(Ok(frame)) => self
                    .begun
                    .extend_from_slice(&frame.into_data().unwrap_or_default()),
            }
        }
    }
}

/// Opens a connection over a socket; its result is that of the requests over it.
async fn open(
    stream: impl AsyncRead + AsyncWrite + Unpin + Send + 'static,
) -> io::Result<Connection> {
    let (sender, driven) = handshake(TokioIo::new(stream))
        .await
        .map_err(io::Error::other)?;
    let driver = tokio::spawn(async { driven.await.unwrap_or_default() });
    Ok(Connection { sender, driver })
}

pub(super) async fn in_time<T>(limit: Duration, what: impl Future<Output = T>) -> io::Result<T> {
    let done = tokio::time::timeout(limit, what).await;
    done.map_err(|_| io::Error::new(io::ErrorKind::TimedOut, format!("no data within {limit:?}")))
}

/// Reads the error in an answer.
pub(super) async fn refusal(
    response: Response<Incoming>,
    limit: Duration,
) -> io::Result<RequestError> {
    let body = in_time(limit, response.into_body().collect()).await?;
    let body = body.map_err(io::Error::other)?.to_bytes();
    Ok(match serde_json::from_slice::<ErrorBody>(&body) {
        Ok(body) => RequestError::from_server(body),
        Err(error) => answer_not_understood(&error),
    })
}
