//! Reads the head of a request before any work is done for it: bounded in size and time, and answered with an error if
//! it is malformed. Run by the thread that serves connections.

use axum::http::{Method, Uri};
use rcc_api::codes;
use rcc_api::error::ApiError;
use rcc_api::routes::{is_stop, is_stream};
use tokio::io::{AsyncRead, AsyncReadExt};

use super::request_class::RequestClass;

/// Maximum size of a request head, bytes.
pub const HEAD_MAX: usize = 16 << 10;
/// Maximum number of header lines.
pub const HEADERS_MAX: usize = 64;
/// Up to this many bytes the head is parsed after each read, so that garbage is answered at once; beyond, only at line
/// ends.
const EVERY_BYTE_PARSED_MAX: usize = 64;

/// A complete head, and the bytes read so far.
#[derive(Debug, PartialEq)]
pub(super) struct RequestHead {
    /// All bytes as received: the head, and possibly the body or its beginning, and further requests.
    pub bytes: Vec<u8>,
    /// Length of the head, bytes.
    pub size: usize,
    /// Length of the body, bytes; 0 if it is chunked.
    pub body_size: usize,
    /// The token after `Bearer ` in the header `authorization`.
    pub bearer: Option<Vec<u8>>,
    /// The class that the request is counted in, if it has the right token.
    pub class: RequestClass,
    /// True if the connection may carry another request: HTTP/1.1 without `connection: close`, and a body whose length
    /// is known.
    pub stays_open: bool,
}

/// Reads a head, whose first bytes may have been read before. Returns `None` if the client closed the connection
/// without sending anything.
pub(super) async fn read(
    io: &mut (impl AsyncRead + Unpin),
    begun: Vec<u8>,
) -> Result<Option<RequestHead>, ApiError> {
    let mut bytes = begun;
    let mut parsed = 0;
    loop {
        let looked_at = parsed < EVERY_BYTE_PARSED_MAX || bytes[parsed..].contains(&b'\n');
        if parsed < bytes.len()
            && looked_at
            && let Some(head) = parse(&bytes)?
        {
            return Ok(Some(RequestHead { bytes, ..head }));
        }
        if bytes.len() > HEAD_MAX {
            return Err(too_large(format!("more than {HEAD_MAX} bytes")));
        }
        let before = bytes.len();
        parsed = before;
        let room = (HEAD_MAX + 1 - before).min(4096) as u64;
        let read = (&mut *io).take(room).read_buf(&mut bytes).await;
        match read {
            Ok(0) if before == 0 => return Ok(None),
            Ok(0) | Err(_) => {
                return Err(malformed("the connection ends before the end of its head"));
            }
            Ok(_) => {}
        }
    }
}

/// Parses a head, without its bytes; `None` while it is incomplete.
fn parse(bytes: &[u8]) -> Result<Option<RequestHead>, ApiError> {
    let mut headers = [httparse::EMPTY_HEADER; HEADERS_MAX];
    let mut request = httparse::Request::new(&mut headers);
    match request.parse(bytes) {
        Ok(httparse::Status::Partial) => Ok(None),
        Ok(httparse::Status::Complete(size)) => {
            let body = check(&request)?;
            let value = values(&request, "authorization").next();
            let bearer = value.and_then(|value| value.strip_prefix(b"Bearer "));
            let mut options =
                values(&request, "connection").flat_map(|value| value.split(|byte| *byte == b','));
            let closes = options.any(|option| option.trim_ascii().eq_ignore_ascii_case(b"close"));
            Ok(Some(RequestHead {
                bytes: Vec::new(),
                size,
                body_size: body.unwrap_or(0),
                bearer: bearer.map(<[u8]>::to_vec),
                class: class_of(&request),
                stays_open: request.version == Some(1) && !closes && body.is_some(),
            }))
        }
        Err(httparse::Error::TooManyHeaders) => {
            Err(too_large(format!("more than {HEADERS_MAX} lines")))
        }
        Err(error) => Err(malformed(error)),
    }
}

/// Returns the values of all headers with this name.
fn values<'r, 'b: 'r>(
    request: &'r httparse::Request<'_, 'b>,
    name: &'r str,
) -> impl Iterator<Item = &'b [u8]> {
    let headers = request.headers.iter();
    headers
        .filter(move |header| header.name.eq_ignore_ascii_case(name))
        .map(|header| header.value)
}

fn class_of(request: &httparse::Request<'_, '_>) -> RequestClass {
    let (method, path) = (
        request.method.unwrap_or_default(),
        request.path.unwrap_or_default(),
    );
    if method == "POST" && is_stop(path) {
        RequestClass::Stop
    } else if is_stream(method, path) {
        RequestClass::Stream
    } else {
        RequestClass::Usual
    }
}

/// Returns the length of the body, bytes, or `None` if it is chunked. Rejects requests that the HTTP library would
/// refuse with a bare status: an invalid method, address or version, and a body whose end is ambiguous (RFC 9112,
/// section 6.3).
fn check(request: &httparse::Request<'_, '_>) -> Result<Option<usize>, ApiError> {
    let method = request.method.unwrap_or_default();
    if Method::from_bytes(method.as_bytes()).is_err() {
        return Err(malformed("invalid method"));
    }
    if request.path.unwrap_or_default().parse::<Uri>().is_err() {
        return Err(malformed("invalid address"));
    }
    let mut length: Option<&[u8]> = None;
    let mut size = 0;
    let mut chunked = false;
    for header in request.headers.iter() {
        if header.name.eq_ignore_ascii_case("content-length") {
            let value = header.value.trim_ascii();
            let text = std::str::from_utf8(value).unwrap_or_default();
            let number = text.parse().ok();
            let number = number.filter(|_| value.iter().all(u8::is_ascii_digit));
            size = number.ok_or_else(|| malformed("`content-length` is not a number"))?;
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
    Ok((!chunked).then_some(size))
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
        assert_eq!(
            parse(text),
            Ok(Some(RequestHead {
                bytes: Vec::new(),
                size: text.len(),
                body_size: 0,
                bearer: Some(b"abc".to_vec()),
                class: RequestClass::Usual,
                stays_open: true,
            }))
        );
        let basic = parse(b"GET / HTTP/1.1\r\nauthorization: Basic abc\r\n\r\n");
        assert_eq!(
            basic.map(|head| head.map(|head| head.bearer)),
            Ok(Some(None))
        );
    }

    #[test]
    fn the_class_of_a_request_follows_from_its_first_line() {
        let (stop, stream, usual) = (
            RequestClass::Stop,
            RequestClass::Stream,
            RequestClass::Usual,
        );
        for (line, class) in [
            ("POST /commands/line%237/cancel", stop),
            ("POST /commands/7/abort?x", stop),
            ("GET /commands/7/abort", usual),
            ("POST /commands/7/start", usual),
            ("POST /commands/a/b/cancel", usual),
            ("POST /commands/7/inputs/stream", stream),
            ("PUT /commands/7/inputs", usual),
            ("GET /stream?ports=a/b.c", stream),
            ("POST /stream", usual),
        ] {
            let head = format!("{line} HTTP/1.1\r\n\r\n");
            let head = parse(head.as_bytes()).ok().flatten();
            assert_eq!(head.map(|head| head.class), Some(class), "{line}");
        }
    }

    #[test]
    fn a_connection_stays_open_unless_the_client_or_the_body_says_otherwise() {
        for (lines, version, stays_open, body_size) in [
            ("", 1, true, 0),
            ("content-length: 12\r\n", 1, true, 12),
            ("Connection: Keep-Alive, CLOSE\r\n", 1, false, 0),
            ("connection: keep-alive\r\n", 1, true, 0),
            ("transfer-encoding: chunked\r\n", 1, false, 0),
            ("", 0, false, 0),
        ] {
            let head = format!("POST / HTTP/1.{version}\r\n{lines}\r\n");
            let head = parse(head.as_bytes()).ok().flatten();
            let facts = head.map(|head| (head.stays_open, head.body_size));
            assert_eq!(facts, Some((stays_open, body_size)), "{lines}");
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
            assert!(matches!(parse(text.as_bytes()), Ok(Some(_))), "{lines}");
        }
    }

    #[test]
    fn an_invalid_address_is_refused_with_a_code() {
        for path in ["/a\"b", "//:x:y", "http://", "a b"] {
            let text = format!("GET {path} HTTP/1.1\r\n\r\n");
            let said = parse(text.as_bytes());
            let known = path.parse::<Uri>().is_ok();
            assert_eq!(said.is_ok(), known, "{path}: {said:?}");
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
