//! Bodies of requests and answers: the size of each is limited by route, and the memory of all together. Run by the one
//! thread that serves connections, which copies pieces and parses nothing.

use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use axum::body::{Body, Bytes};
use axum::extract::Request;
use axum::http::{Method, StatusCode, header};
use axum::response::{IntoResponse, Response};
use http_body_util::BodyExt;
use hyper::body::{Body as _, Frame, SizeHint};
use rcc_api::codes;
use rcc_api::error::ApiError;
use rcc_api::routes::TEXT_MAX;

use super::peer::ClientPeer;
use super::quota::{Quota, QuotaLimits, QuotaPermit};

/// Texts longer than this are compiled one after the other, bytes. Compiling takes a hundred times the text's size in
/// memory, which is returned afterwards; shorter texts do not wait for long ones.
pub const LONG_TEXT: usize = 256 << 10;
/// Maximum size of any other request body, bytes.
pub const SET_TEXT_MAX: usize = 64 << 10;
/// Limits of all texts together that are being received, wait to be compiled, or are being compiled, bytes.
pub const TEXTS: QuotaLimits = QuotaLimits {
    all: 32 << 20,
    of_peer: 16 << 20,
    reserve: 8 << 20,
    small: 1 << 20,
};
/// Limits of all long answers together that are not yet taken by their clients, bytes.
pub const ANSWERS: QuotaLimits = QuotaLimits {
    all: 64 << 20,
    of_peer: 32 << 20,
    reserve: 16 << 20,
    small: 8 << 20,
};
/// Bodies up to this size are not counted, bytes.
const SHORT: usize = 64 << 10;
/// Time allowed for a body to arrive.
pub const BODY_TIME_MAX: Duration = Duration::from_secs(5);

/// Returns the maximum body size of a request, by its route; `None` for CANCEL and ABORT, which are carried out
/// whatever their body is.
#[must_use]
pub fn body_max(method: &Method, route: &str) -> Option<usize> {
    match (method.as_str(), route) {
        ("POST", "/commands" | "/check") => Some(TEXT_MAX),
        ("POST", "/commands/{name}/start" | "/switch" | "/rules") => Some(SET_TEXT_MAX),
        ("POST", "/leases" | "/leases/{lease}/commands") => Some(SET_TEXT_MAX),
        ("PUT", "/commands/{name}/inputs") => Some(SET_TEXT_MAX),
        ("POST", "/commands/{name}/cancel" | "/commands/{name}/abort") => None,
        _ => Some(0),
    }
}

/// Accounts for the memory of a text until the last clone is dropped.
#[derive(Clone, Debug, Default)]
pub struct TextMemory {
    _share: Option<Arc<QuotaPermit>>,
}

/// Reads a body of at most `bytes_max` bytes; a long one is counted as the peer's share of `texts`.
///
/// # Errors
/// Returns an error if the body is too long, incomplete or too slow, or if all of the memory for bodies is in use.
pub async fn read(
    body: Body,
    bytes_max: usize,
    (texts, peer): (&Arc<Quota>, ClientPeer),
) -> Result<(Bytes, TextMemory), ApiError> {
    if body.size_hint().lower() > bytes_max as u64 {
        return Err(too_large(bytes_max));
    }
    match tokio::time::timeout(BODY_TIME_MAX, collect(body, bytes_max, (texts, peer))).await {
        Ok(taken) => taken,
        Err(_) => Err(ApiError::new(
            codes::TOO_SLOW,
            format!("the body took longer than {BODY_TIME_MAX:?}"),
            "send the whole request at once",
        )),
    }
}

async fn collect(
    mut body: Body,
    bytes_max: usize,
    (texts, peer): (&Arc<Quota>, ClientPeer),
) -> Result<(Bytes, TextMemory), ApiError> {
    let mut bytes = Vec::new();
    let mut share: Option<QuotaPermit> = None;
    while let Some(frame) = body.frame().await {
        let frame = frame.map_err(|error| {
            let message = format!("the body is incomplete: {error}");
            ApiError::new(codes::BAD_REQUEST, message, "send the whole body")
        })?;
        let Ok(data) = frame.into_data() else {
            continue;
        };
        if bytes.len() + data.len() > bytes_max {
            return Err(too_large(bytes_max));
        }
        if bytes.len() + data.len() > SHORT {
            let more = bytes.len() + data.len() - share.as_ref().map_or(0, QuotaPermit::amount);
            let is_free = match share.as_mut() {
                Some(share) => share.grow(more),
                None => {
                    share = texts.take(peer, more);
                    share.is_some()
                }
            };
            if !is_free {
                return Err(no_memory(TEXTS, "texts"));
            }
        }
        bytes.extend_from_slice(&data);
    }
    let memory = TextMemory {
        _share: share.map(Arc::new),
    };
    Ok((bytes.into(), memory))
}

/// Checks that a request has no body.
///
/// # Errors
/// Returns [`codes::TOO_LARGE`] if it has one.
pub fn require_no_body(request: &Request) -> Result<(), ApiError> {
    match request.body().is_end_stream() {
        true => Ok(()),
        false => Err(too_large(0)),
    }
}

fn too_large(bytes_max: usize) -> ApiError {
    match bytes_max {
        0 => ApiError::new(
            codes::TOO_LARGE,
            "requests to this address have no body",
            "send the request without a body",
        ),
        TEXT_MAX => ApiError::new(
            codes::TOO_LARGE,
            format!("the text is too large: the maximum is {TEXT_MAX} bytes"),
            "split the net into several nets",
        ),
        _ => ApiError::new(
            codes::TOO_LARGE,
            format!("the body is too large: the maximum for this request is {bytes_max} bytes"),
            "split it into several requests",
        ),
    }
}

fn no_memory(limits: QuotaLimits, what: &str) -> ApiError {
    ApiError::new(
        codes::TOO_MANY,
        format!(
            "the memory that the loader reserves for {what} is in use: {} MiB, at most {} MiB of one client",
            limits.all >> 20,
            limits.of_peer >> 20
        ),
        "try again in a moment",
    )
}

/// Marks a response whose body is in memory and long.
#[derive(Clone, Copy)]
struct LongAnswer(usize);

/// Wraps a JSON answer that was serialized by a blocking thread.
#[must_use]
pub fn answer(bytes: Vec<u8>) -> Response {
    let size = bytes.len();
    let kind = [(header::CONTENT_TYPE, "application/json")];
    let mut response = (StatusCode::OK, kind, Body::from(bytes)).into_response();
    if size > SHORT {
        response.extensions_mut().insert(LongAnswer(size));
    }
    response
}

/// Counts a long answer as the peer's share of `answers` until the client has taken it.
///
/// # Errors
/// Returns [`codes::TOO_MANY`] if too much is in use; the answer is dropped then.
pub fn account(
    response: Response,
    (answers, peer): (&Arc<Quota>, ClientPeer),
) -> Result<Response, ApiError> {
    let Some(LongAnswer(size)) = response.extensions().get().copied() else {
        return Ok(response);
    };
    let share = answers.take(peer, size);
    let _share = share.ok_or_else(|| no_memory(ANSWERS, "answers"))?;
    Ok(response.map(|body| Body::new(AccountedBody { body, _share })))
}

/// A body together with its share of the memory for answers.
struct AccountedBody {
    body: Body,
    _share: QuotaPermit,
}

impl hyper::body::Body for AccountedBody {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Self::Error>>> {
        Pin::new(&mut self.body).poll_frame(context)
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}
