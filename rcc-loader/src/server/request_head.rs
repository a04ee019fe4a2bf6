//! Reads the head of a request before any work is done for it: bounded in size and time, and answered with an error if
//! it is malformed. Run by the thread that serves connections.

use std::io;
use std::pin::Pin;
use std::task::{Context, Poll};

use axum::http::{Method, Uri};
use rcc_api::codes;
use rcc_api::error::ApiError;
use rcc_api::routes::is_stop;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, ReadBuf};

/// Maximum size of a request head, bytes.
pub const HEAD_MAX: usize = 16 << 10;
/// Maximum number of header lines.
pub const HEADERS_MAX: usize = 64;
/// Up to this many bytes the head is parsed after each read, so that garbage is answered at once; beyond, only at line
/// ends.
const EVERY_BYTE_PARSED_MAX: usize = 64;

/// The bytes read so far: the head, and possibly the beginning of the body.
pub(super) struct RequestHead {
    /// All bytes as received.
    pub bytes: Vec<u8>,
    /// The token after `Bearer ` in the header `authorization`.
    pub bearer: Option<Vec<u8>>,
    /// True for CANCEL and ABORT.
    pub is_stop: bool,
}

/// Reads a head. Returns `None` if the client closed the connection without sending anything.
pub(super) async fn read(
    io: &mut (impl AsyncRead + Unpin),
) -> Result<Option<RequestHead>, ApiError> {
    let mut bytes = Vec::with_capacity(1024);
    loop {
        let before = bytes.len();
        let room = (HEAD_MAX + 1 - before).min(4096) as u64;
        let read = (&mut *io).take(room).read_buf(&mut bytes).await;
        match read {
            Ok(0) if before == 0 => return Ok(None),
            Ok(0) | Err(_) => {
                return Err(malformed("the connection ends before the end of its head"));
            }
            Ok(_) => {}
        }
        let looked_at = before < EVERY_BYTE_PARSED_MAX || bytes[before..].contains(&b'\n');
        if looked_at && let Some((bearer, is_stop)) = parse(&bytes)? {
            return Ok(Some(RequestHead {
                bytes,
                bearer,
                is_stop,
            }));
        }
        if bytes.len() > HEAD_MAX {
            return Err(too_large(format!("more than {HEAD_MAX} bytes")));
        }
    }
}

/// Parses a head. Returns its token, if any, and whether it is a CANCEL or ABORT; `None` while the head is incomplete.
#[allow(clippy::type_complexity)] // Two facts of one head, used once.
fn parse(bytes: &[u8]) -> Result<Option<(Option<Vec<u8>>, bool)>, ApiError> {
    let mut headers = [httparse::EMPTY_HEADER; HEADERS_MAX];
    let mut request = httparse::Request::new(&mut headers);
    match request.parse(bytes) {
        Ok(httparse::Status::Partial) => Ok(None),
        Ok(httparse::Status::Complete(_)) => {
            check(&request)?;
            let headers = request.headers.iter();
            let mut named =
                headers.filter(|header| header.name.eq_ignore_ascii_case("authorization"));
            let value = named.next().map(|header| header.value);
            let bearer = value.and_then(|value| value.strip_prefix(b"Bearer "));
            let is_stop = request.method == Some("POST") && request.path.is_some_and(is_stop);
            Ok(Some((bearer.map(<[u8]>::to_vec), is_stop)))
        }
        Err(httparse::Error::TooManyHeaders) => {
            Err(too_large(format!("more than {HEADERS_MAX} lines")))
        }
        Err(error) => Err(malformed(error)),
    }
}

/// Rejects what the HTTP library would refuse with a bare status: an invalid method, address or version, and a body
/// whose end is ambiguous (RFC 9112, section 6.3).
fn check(request: &httparse::Request<'_, '_>) -> Result<(), ApiError> {
    let method = request.method.unwrap_or_default();
    if Method::from_bytes(method.as_bytes()).is_err() {
        return Err(malformed("invalid method"));
    }
    if request.path.unwrap_or_default().parse::<Uri>().is_err() {
        return Err(malformed("invalid address"));
    }
    let mut length: Option<&[u8]> = None;
    let mut chunked = false;
    for header in request.headers.iter() {
        if header.name.eq_ignore_ascii_case("content-length") {
            let value = header.value.trim_ascii();
            let text = std::str::from_utf8(value).unwrap_or_default();
            let number = value.iter().all(u8::is_ascii_digit) && text.parse::<u64>().is_ok();
            if !number {
                return Err(malformed("`content-length` is not a number"));
            }
            if length.is_some_and(|before| before != value) {
                return Err(malformed("two different `content-length` headers"));
            }
            length = Some(value);
        } else if header.name.eq_ignore_ascii_case("transfer-encoding") {
            let value = header.value.trim_ascii();
            if chunked || request.version == Some(0) || !value.eq_ignore_ascii_case(b"chunked") {
                return Err(malformed("only `transfer-encoding: chunked` is supported"));
            }
            chunked = true;
        }
    }
    if chunked && length.is_some() {
        let why = "both `content-length` and `transfer-encoding` are given";
        return Err(malformed(why));
    }
    Ok(())
}

fn malformed(why: impl std::fmt::Display) -> ApiError {
    let message = format!("not a valid HTTP/1.1 request: {why}");
    ApiError::new(
        codes::BAD_REQUEST,
        message,
        "use rcc-cli, curl or an HTTP library",
    )
}

fn too_large(what: String) -> ApiError {
    let message = format!("the head of the request has {what}");
    ApiError::new(codes::HEAD_TOO_LARGE, message, "send long data in the body")
}

/// A connection whose first bytes have already been read.
pub(super) struct PrefixedStream<I> {
    prefix: Vec<u8>,
    consumed: usize,
    /// The underlying connection.
    pub io: I,
}

impl<I> PrefixedStream<I> {
    /// Creates a connection that yields `prefix` before the rest of its input.
    pub fn new(prefix: Vec<u8>, io: I) -> PrefixedStream<I> {
        PrefixedStream {
            prefix,
            consumed: 0,
            io,
        }
    }
}

impl<I: AsyncRead + Unpin> AsyncRead for PrefixedStream<I> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        into: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let rest = self.prefix.get(self.consumed..).unwrap_or_default();
        if rest.is_empty() {
            return Pin::new(&mut self.io).poll_read(context, into);
        }
        let count = rest.len().min(into.remaining());
        into.put_slice(&rest[..count]);
        self.consumed += count;
        Poll::Ready(Ok(()))
    }
}

impl<I: AsyncWrite + Unpin> AsyncWrite for PrefixedStream<I> {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.io).poll_write(context, bytes)
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.io).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.io).poll_shutdown(context)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn code<T>(result: Result<T, ApiError>) -> Option<&'static str> {
        result.err().map(|error| error.code.code)
    }

    #[test]
    fn a_head_is_complete_at_its_empty_line_and_yields_its_token() {
        let text = b"GET /status HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer abc\r\n\r\n";
        for end in 0..text.len() {
            assert_eq!(parse(&text[..end]), Ok(None), "{end}");
        }
        assert_eq!(parse(text), Ok(Some((Some(b"abc".to_vec()), false))));
        assert_eq!(
            parse(b"GET / HTTP/1.1\r\nauthorization: Basic abc\r\n\r\n"),
            Ok(Some((None, false)))
        );
        for (line, stops) in [
            ("POST /commands/line%237/cancel", true),
            ("POST /commands/7/abort?x", true),
            ("GET /commands/7/abort", false),
            ("POST /commands/7/start", false),
            ("POST /commands/a/b/cancel", false),
        ] {
            let head = format!("{line} HTTP/1.1\r\n\r\n");
            assert_eq!(parse(head.as_bytes()), Ok(Some((None, stops))), "{line}");
        }
    }

    #[test]
    fn a_body_without_a_clear_end_is_refused_with_a_code() {
        for lines in [
            "content-length: abc",
            "content-length: -1",
            "content-length: +1",
            "content-length: 99999999999999999999",
            "content-length: 1, 1",
            "content-length: ",
            "content-length: 1\r\nContent-Length: 2",
            "content-length: 1\r\ntransfer-encoding: chunked",
            "transfer-encoding: gzip",
            "transfer-encoding: gzip, chunked",
            "transfer-encoding: chunked\r\ntransfer-encoding: chunked",
        ] {
            let text = format!("POST /commands HTTP/1.1\r\n{lines}\r\n\r\n");
            assert_eq!(code(parse(text.as_bytes())), Some("RCC4011"), "{lines}");
        }
        let old = b"POST / HTTP/1.0\r\ntransfer-encoding: chunked\r\n\r\n";
        assert_eq!(code(parse(old)), Some("RCC4011"));
        for lines in [
            "content-length: 12",
            "Content-Length: 0\r\ncontent-length: 0",
            "Transfer-Encoding: Chunked",
        ] {
            let text = format!("POST /commands HTTP/1.1\r\n{lines}\r\n\r\n");
            assert_eq!(parse(text.as_bytes()), Ok(Some((None, false))), "{lines}");
        }
    }

    #[test]
    fn an_invalid_address_is_refused_with_a_code() {
        for path in ["/a\"b", "//:x:y", "http://", "a b"] {
            let text = format!("GET {path} HTTP/1.1\r\n\r\n");
            let said = parse(text.as_bytes());
            let known = path.parse::<Uri>().is_ok();
            assert_eq!(code(said.clone()).is_none(), known, "{path}: {said:?}");
        }
    }

    #[test]
    fn malformed_heads_and_too_many_lines_have_different_codes() {
        assert_eq!(code(parse(b"\x00\xff")), Some("RCC4011"));
        assert_eq!(code(parse(b"\x16\x03\x01\x02\x00")), Some("RCC4011"), "TLS");
        let lines = "a: b\r\n".repeat(HEADERS_MAX + 1);
        let text = format!("GET / HTTP/1.1\r\n{lines}\r\n");
        assert_eq!(code(parse(text.as_bytes())), Some("RCC4016"));
    }
}
