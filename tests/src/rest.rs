//! A minimal REST client: HTTP/1.1 over the cell's Unix socket, without an HTTP library, as any program may use it.
//! Runs on the threads of the test harness.

use std::io::{self, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::Duration;

use serde_json::Value;

/// The response to a request.
#[derive(Clone, Debug, PartialEq)]
pub struct Reply {
    /// HTTP status code.
    pub status: u16,
    /// The body; null if it is not JSON.
    pub body: Value,
}

impl Reply {
    /// Returns the `code` of an error; empty for a success.
    pub fn code(&self) -> &str {
        self.body["code"].as_str().unwrap_or_default()
    }

    /// Returns the `message` of an error followed by its `help`.
    pub fn error_text(&self) -> String {
        let text = |key: &str| self.body[key].as_str().unwrap_or_default().to_owned();
        format!("{} {}", text("message"), text("help"))
    }
}

/// Sends one request over a Unix socket and reads the whole response.
///
/// # Errors
/// Returns an error if the socket is not served or the response is not HTTP.
pub fn request(socket: &Path, method: &str, path: &str, body: &[u8]) -> io::Result<Reply> {
    over(connect(socket)?, method, path, "", body)
}

/// Like [`request`], over an open connection and with additional header lines, each ended by CRLF.
///
/// # Errors
/// Returns an error if the connection fails or the response is not HTTP.
pub fn over(
    mut stream: impl Read + Write,
    method: &str,
    path: &str,
    lines: &str,
    body: &[u8],
) -> io::Result<Reply> {
    let head = format!(
        "{method} {path} HTTP/1.1\r\nhost: rcc\r\nconnection: close\r\n{lines}content-length: {}\r\n\r\n",
        body.len()
    );
    stream.write_all(head.as_bytes())?;
    // A server that refuses a body for its size may close the connection before it has read all of it.
    let sent = stream.write_all(body);
    let mut answer = Vec::new();
    match stream.read_to_end(&mut answer) {
        Err(error) if answer.is_empty() => return Err(error),
        _ => {}
    }
    parse(&answer).ok_or_else(|| {
        sent.err()
            .unwrap_or_else(|| io::ErrorKind::InvalidData.into())
    })
}

/// Sends arbitrary bytes and returns everything received until the server closes the connection.
///
/// # Errors
/// Returns an error if the socket is not served.
pub fn raw(socket: &Path, bytes: &[u8]) -> io::Result<Vec<u8>> {
    let mut stream = connect(socket)?;
    // The server may close the connection at the first invalid byte.
    let _ = stream.write_all(bytes);
    let _ = stream.shutdown(std::net::Shutdown::Write);
    let mut answer = Vec::new();
    let _ = stream.read_to_end(&mut answer);
    Ok(answer)
}

/// Sends a request with `connection: close` and returns the whole answer. The sending side stays open, because a client
/// that closes it is gone.
///
/// # Errors
/// Returns an error if the socket is not served.
pub fn raw_answer(socket: &Path, request: &[u8]) -> io::Result<Vec<u8>> {
    let mut stream = connect(socket)?;
    stream.write_all(request)?;
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer)?;
    Ok(answer)
}

fn connect(socket: &Path) -> io::Result<UnixStream> {
    let stream = UnixStream::connect(socket)?;
    stream.set_read_timeout(Some(Duration::from_secs(20)))?;
    stream.set_write_timeout(Some(Duration::from_secs(20)))?;
    Ok(stream)
}

fn parse(answer: &[u8]) -> Option<Reply> {
    let end = answer.windows(4).position(|bytes| bytes == b"\r\n\r\n")?;
    let head = std::str::from_utf8(&answer[..end]).ok()?;
    let status = head.split(' ').nth(1)?.parse().ok()?;
    let body = serde_json::from_slice(&answer[end + 4..]).unwrap_or(Value::Null);
    Some(Reply { status, body })
}
