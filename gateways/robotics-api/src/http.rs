//! The little HTTP/1.1 that the library uses: heads of requests, bodies with a length, answers that close the
//! connection. Run by the threads of connections.

use std::collections::BTreeMap;
use std::io::{self, Read, Write};

/// Longest head of a request in bytes.
const HEAD_MAX: usize = 16 << 10;
/// Longest body of a request in bytes; form-encoded nets are longer than nets.
const BODY_MAX: usize = 8 << 20;

/// A request without its body.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RequestHead {
    /// `GET`, `POST`, …
    pub method: String,
    /// Path with each run of slashes as one: the library writes `//devices/`.
    pub path: String,
    /// Headers by their name in lower case.
    pub headers: BTreeMap<String, String>,
    /// Bytes that came behind the head.
    pub rest: Vec<u8>,
}

/// Why a request cannot be answered.
#[derive(Debug, thiserror::Error)]
pub enum RequestError {
    /// The connection is lost, or nothing came in time.
    #[error("the connection ended: {0}")]
    Ended(#[from] io::Error),
    /// Not HTTP.
    #[error("not a request of HTTP/1.1")]
    Malformed,
    /// Too long.
    #[error("the request is too long")]
    TooLong,
}

/// Reads the head of a request.
///
/// # Errors
/// Returns an error if no head comes.
pub fn read_head(stream: &mut impl Read) -> Result<RequestHead, RequestError> {
    let mut received = Vec::new();
    let mut piece = [0; 4096];
    loop {
        let read = stream.read(&mut piece)?;
        if read == 0 {
            return Err(RequestError::Ended(io::ErrorKind::UnexpectedEof.into()));
        }
        received.extend_from_slice(piece.get(..read).unwrap_or_default());
        if let Some(head) = parse_head(&received)? {
            return Ok(head);
        }
        if received.len() > HEAD_MAX {
            return Err(RequestError::TooLong);
        }
    }
}

fn parse_head(received: &[u8]) -> Result<Option<RequestHead>, RequestError> {
    let mut headers = [httparse::EMPTY_HEADER; 64];
    let mut request = httparse::Request::new(&mut headers);
    let parsed = request
        .parse(received)
        .map_err(|_| RequestError::Malformed)?;
    let httparse::Status::Complete(length) = parsed else {
        return Ok(None);
    };
    let headers = request.headers.iter().map(|header| {
        let value = String::from_utf8_lossy(header.value).trim().to_owned();
        (header.name.to_ascii_lowercase(), value)
    });
    let target = request.path.unwrap_or_default();
    let path = target.split('?').next().unwrap_or_default();
    Ok(Some(RequestHead {
        method: request.method.unwrap_or_default().to_owned(),
        path: single_slashes(path),
        headers: headers.collect(),
        rest: received.get(length..).unwrap_or_default().to_vec(),
    }))
}

fn single_slashes(path: &str) -> String {
    let mut single = String::new();
    for letter in path.chars() {
        if !(letter == '/' && single.ends_with('/')) {
            single.push(letter);
        }
    }
    single
}

/// Reads the body of a request, which must state its length.
///
/// # Errors
/// Returns an error if it does not come, or is too long.
pub fn read_body(head: &RequestHead, stream: &mut impl Read) -> Result<Vec<u8>, RequestError> {
    let length = match head.headers.get("content-length") {
        Some(length) => length
            .parse::<usize>()
            .map_err(|_| RequestError::Malformed)?,
        None if head.headers.contains_key("transfer-encoding") => {
            return Err(RequestError::Malformed);
        }
        None => 0,
    };
    if length > BODY_MAX {
        return Err(RequestError::TooLong);
    }
    let mut body = head.rest.clone();
    body.truncate(length);
    let missing = length.saturating_sub(body.len());
    stream.take(missing as u64).read_to_end(&mut body)?;
    match body.len() == length {
        true => Ok(body),
        false => Err(RequestError::Ended(io::ErrorKind::UnexpectedEof.into())),
    }
}

/// Writes an answer after which the connection is closed.
///
/// # Errors
/// Returns an error if the client is gone.
pub fn write_answer(
    stream: &mut impl Write,
    status: u16,
    content_type: &str,
    body: &str,
) -> io::Result<()> {
    let reason = match status {
        200 => "OK",
        201 => "Created",
        303 => "See Other",
        400 => "Bad Request",
        404 => "Not Found",
        405 => "Method Not Allowed",
        409 => "Conflict",
        413 => "Content Too Large",
        _ => "Service Unavailable",
    };
    // Without `Location` the library sees the 303 that it expects; it would follow one.
    let answer = format!(
        "HTTP/1.1 {status} {reason}\r\nContent-Type: {content_type}\r\nContent-Length: {}\r\nConnection: close\r\n\r\n{body}",
        body.len()
    );
    stream.write_all(answer.as_bytes())
}

/// Decodes a value of a form: `+` is a blank, `%41` a byte.
#[must_use]
pub fn decoded(text: &str) -> String {
    let bytes = text.as_bytes();
    let mut decoded = Vec::with_capacity(bytes.len());
    let mut at = 0;
    while let Some(byte) = bytes.get(at) {
        let escaped = text
            .get(at + 1..at + 3)
            .and_then(|digits| u8::from_str_radix(digits, 16).ok());
        match (byte, escaped) {
            (b'%', Some(byte)) => {
                decoded.push(byte);
                at += 2;
            }
            (b'+', _) => decoded.push(b' '),
            (byte, _) => decoded.push(*byte),
        }
        at += 1;
    }
    String::from_utf8_lossy(&decoded).into_owned()
}

/// Splits a body at `&` and each part at its first `=`. Nothing is decoded.
#[must_use]
pub fn form(body: &str) -> BTreeMap<String, String> {
    let parts = body.split('&').filter_map(|part| part.split_once('='));
    parts
        .map(|(name, value)| (name.trim().to_owned(), value.to_owned()))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_request_of_the_library_is_read() {
        let text = "GET /DirectIO/ HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
                    Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n";
        let head = read_head(&mut text.as_bytes()).expect("a head");
        assert_eq!((&*head.method, &*head.path), ("GET", "/DirectIO/"));
        assert_eq!(
            head.headers["sec-websocket-key"],
            crate::websocket::CLIENT_KEY
        );
        assert!(head.rest.is_empty());
    }

    #[test]
    fn bodies_have_a_length_and_paths_single_slashes() {
        let text = "POST //devices/ HTTP/1.1\r\nContent-Length: 5\r\n\r\na=b&c";
        let mut stream = text.as_bytes();
        let head = read_head(&mut stream).expect("a head");
        assert_eq!(head.path, "/devices/");
        assert_eq!(read_body(&head, &mut stream).expect("a body"), b"a=b&c");
        for text in ["x", "POST / HTTP/1.1\r\n\r\n\r\nx"] {
            assert!(
                read_head(&mut text.as_bytes()).map_or(true, |head| head.rest == b"\r\nx"),
                "{text}"
            );
        }
        let chunked = "POST / HTTP/1.1\r\ntransfer-encoding: chunked\r\n\r\n";
        let head = read_head(&mut chunked.as_bytes()).expect("a head");
        assert!(matches!(
            read_body(&head, &mut io::empty()),
            Err(RequestError::Malformed)
        ));
        let endless = "GET / HTTP/1.1\r\nx: ".to_owned() + &"a".repeat(HEAD_MAX + 4096);
        assert!(matches!(
            read_head(&mut endless.as_bytes()),
            Err(RequestError::TooLong)
        ));
    }

    #[test]
    fn forms_are_split_and_eval_nets_decoded() {
        let form =
            form("name=my arm&type=kuka_lwr_sim&tcp={pos:{x:0},rot:{a:1}}&home_joint=[0, 1]&x=a=b");
        assert_eq!(form["name"], "my arm");
        assert_eq!(form["tcp"], "{pos:{x:0},rot:{a:1}}");
        assert_eq!(form["x"], "a=b");
        assert_eq!(
            decoded("%7B1%3DCore%3A%3AX%28%29%7D+a%2+%zz%"),
            "{1=Core::X()} a%2 %zz%"
        );
    }
}
