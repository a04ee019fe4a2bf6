//! What comes in and goes out as body: each route takes so much and no more, and all bodies together take so much memory.
//! Run by the one thread that serves connections, which copies pieces and parses nothing.

use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use axum::body::{Body, Bytes};
use axum::extract::Request;
use axum::http::{Method, StatusCode, header};
use axum::response::{IntoResponse, Response};
use http_body_util::{BodyExt, Full};
use hyper::body::{Body as _, Frame, SizeHint};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use super::codes;
use super::error::ApiError;

/// Longest text of a net, bytes.
pub const TEXT_MAX: usize = 4 << 20;
/// Texts longer than this are compiled one after the other, because each takes a hundred times its memory meanwhile, which
/// is given back afterwards; shorter ones do not wait for them.
pub const LONG_TEXT: usize = 256 << 10;
/// Longest body of other requests that have one, bytes.
pub const SET_TEXT_MAX: usize = 64 << 10;
/// All texts that come, wait to be compiled, or are compiled, bytes.
pub const TEXTS_MAX: usize = 32 << 20;
/// All long answers that are made or that clients have not taken yet, bytes.
pub const ANSWERS_MAX: usize = 64 << 20;
/// An answer up to this long is not counted, bytes.
const SHORT: usize = 64 << 10;
/// So long a body may take to come.
pub const BODY_TIME: Duration = Duration::from_secs(5);

/// The longest body of a request, by its route; nothing for CANCEL and ABORT, which are done whatever comes with them.
#[must_use]
pub fn body_max(method: &Method, route: &str) -> Option<usize> {
    match (method.as_str(), route) {
        ("POST", "/commands") => Some(TEXT_MAX),
        ("POST", "/commands/{name}/start" | "/switch") => Some(SET_TEXT_MAX),
        ("PUT", "/commands/{name}/inputs") => Some(SET_TEXT_MAX),
        ("POST", "/commands/{name}/cancel" | "/commands/{name}/abort") => None,
        _ => Some(0),
    }
}

/// Memory that a text takes, until the last clone of this is dropped.
#[derive(Clone, Debug, Default)]
pub struct TextMemory {
    _permit: Option<Arc<OwnedSemaphorePermit>>,
}

/// Takes a body that has at most `bytes_max` bytes; a long one counts as part of `texts`.
///
/// # Errors
/// It is too long, not whole, too slow, or all of the memory for bodies is in use.
pub async fn read(
    body: Body,
    bytes_max: usize,
    texts: &Arc<Semaphore>,
) -> Result<(Bytes, TextMemory), ApiError> {
    if body.size_hint().lower() > bytes_max as u64 {
        return Err(too_large(bytes_max));
    }
    match tokio::time::timeout(BODY_TIME, collect(body, bytes_max, texts)).await {
        Ok(taken) => taken,
        Err(_) => Err(ApiError::new(
            codes::TOO_SLOW,
            format!("the body took longer than {BODY_TIME:?}"),
            "send the whole request at once",
        )),
    }
}

async fn collect(
    mut body: Body,
    bytes_max: usize,
    texts: &Arc<Semaphore>,
) -> Result<(Bytes, TextMemory), ApiError> {
    let mut bytes = Vec::new();
    let mut permit: Option<OwnedSemaphorePermit> = None;
    while let Some(frame) = body.frame().await {
        let frame = frame.map_err(|error| {
            let message = format!("the body is not whole: {error}");
            ApiError::new(codes::BAD_REQUEST, message, "send all of it")
        })?;
        let Ok(data) = frame.into_data() else {
            continue;
        };
        if bytes.len() + data.len() > bytes_max {
            return Err(too_large(bytes_max));
        }
        if bytes.len() + data.len() > SHORT {
            let memory = permit.as_ref().map_or(0, OwnedSemaphorePermit::num_permits);
            let more = bytes.len() + data.len() - memory;
            let more = Arc::clone(texts).try_acquire_many_owned(more as u32);
            let more = more.map_err(|_| no_memory(TEXTS_MAX, "texts"))?;
            match permit.as_mut() {
                Some(permit) => permit.merge(more),
                None => permit = Some(more),
            }
        }
        bytes.extend_from_slice(&data);
    }
    let memory = TextMemory {
        _permit: permit.map(Arc::new),
    };
    Ok((bytes.into(), memory))
}

/// The request without its body, if it has none.
///
/// # Errors
/// It has one.
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
            "this address takes no body",
            "send the request without one",
        ),
        TEXT_MAX => ApiError::new(
            codes::TOO_LARGE,
            format!("a text has at most {TEXT_MAX} bytes"),
            "divide the net into several",
        ),
        _ => ApiError::new(
            codes::TOO_LARGE,
            format!("the body of this request has at most {bytes_max} bytes"),
            "divide it into several requests",
        ),
    }
}

fn no_memory(bytes_max: usize, what: &str) -> ApiError {
    ApiError::new(
        codes::TOO_MANY,
        format!(
            "the loader has {} MiB for {what} at a time, and they are in use",
            bytes_max >> 20
        ),
        "try again in a moment",
    )
}

/// An answer of JSON that was written by a blocking thread; a long one is counted until the client has taken it.
///
/// # Errors
/// All of the memory for answers is in use.
pub fn answer(bytes: Vec<u8>, answers: &Arc<Semaphore>) -> Result<Response, ApiError> {
    let permit = match bytes.len() {
        0..=SHORT => None,
        long => {
            let permit = Arc::clone(answers).try_acquire_many_owned(long as u32);
            Some(permit.map_err(|_| no_memory(ANSWERS_MAX, "answers"))?)
        }
    };
    let body = Body::new(AccountedBody {
        bytes: Full::new(bytes.into()),
        _permit: permit,
    });
    let kind = [(header::CONTENT_TYPE, "application/json")];
    Ok((StatusCode::OK, kind, body).into_response())
}

/// A body with its share of the memory.
struct AccountedBody {
    bytes: Full<Bytes>,
    _permit: Option<OwnedSemaphorePermit>,
}

impl hyper::body::Body for AccountedBody {
    type Data = Bytes;
    type Error = std::convert::Infallible;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Self::Error>>> {
        Pin::new(&mut self.bytes).poll_frame(context)
    }

    fn is_end_stream(&self) -> bool {
        self.bytes.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.bytes.size_hint()
    }
}
