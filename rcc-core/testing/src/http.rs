//! The server's side of HTTP for tests: one request of a connection is read and answered.

use std::io::{self, BufRead, BufReader, Read, Write};

/// A request.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct HttpRequest {
    /// Method and path without the query: `POST /commands/7/start`.
    pub line: String,
    /// The query, without the question mark; empty if there is none.
    pub query: String,
    /// The body.
    pub body: Vec<u8>,
}

/// Reads the one request of a connection, and answers it with a status and a body. A connection without a request is not
/// answered.
///
/// # Errors
/// Returns an error if the other side is gone, or sends no HTTP.
pub fn answer_request<S>(
    stream: &S,
    answer: impl FnOnce(&HttpRequest) -> (u16, String),
) -> io::Result<()>
where
    for<'a> &'a S: Read + Write,
{
    let mut reader = BufReader::new(stream);
    let mut head = String::new();
    while !head.ends_with("\r\n\r\n") {
        if reader.read_line(&mut head)? == 0 {
            return Ok(());
        }
    }
    let length = head.lines().find_map(|line| {
        let line = line.to_ascii_lowercase();
        line.strip_prefix("content-length:")?.trim().parse().ok()
    });
    let mut body = vec![0; length.unwrap_or(0)];
    reader.read_exact(&mut body)?;
    let line = head.lines().next().unwrap_or_default();
    let line = line.trim_end_matches(" HTTP/1.1");
    let (line, query) = line.split_once('?').unwrap_or((line, ""));
    let (line, query) = (line.to_owned(), query.to_owned());
    let (status, body) = answer(&HttpRequest { line, query, body });
    let length = body.len();
    let mut writer = stream;
    write!(
        writer,
        "HTTP/1.1 {status} .\r\ncontent-type: application/json\r\ncontent-length: {length}\r\nconnection: close\r\n\r\n{body}"
    )
}
