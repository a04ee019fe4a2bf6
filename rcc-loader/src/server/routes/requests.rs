//! Common parts of all routes: limits on a request, its work on a blocking thread, and its answer. Run by the one
//! thread that serves connections.

use std::sync::OnceLock;
use std::time::{Duration, Instant};

use axum::body::Bytes;
use axum::extract::{MatchedPath, Request, State};
use axum::http::{HeaderMap, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use rcc_api::codes;
use rcc_api::error::ApiError;
use rcc_api::routes::{TIMEOUT_HEADER, is_stream};
use serde::Serialize;

use super::{REQUEST_TIME_MAX, REQUESTS_MAX, ServerState, interface};
use crate::server::bodies;
use crate::server::caller::Caller;
use crate::server::error::ErrorResponse;
use crate::server::peer::ClientPeer;
use crate::server::quota::QuotaLimits;
use crate::server::service::Service;

/// The peer of a request without a connection.
const NO_PEER: ClientPeer = ClientPeer::Process(0);

tokio::task_local! {
    /// The peer of the request that this task answers.
    static PEER: ClientPeer;
}

/// Limits the number of requests, the size of each, and the time for its arrival and its answer.
pub(super) async fn limited(
    State(state): State<ServerState>,
    mut request: Request,
    next: Next,
) -> Response {
    let route = request.extensions().get::<MatchedPath>();
    let route = route.map_or_else(String::new, |route| route.as_str().to_owned());
    if let Err(refused) = interface::check_method(request.method(), &route) {
        return refused;
    }
    let query = interface::check_query(request.method(), &route, request.uri());
    // Streams have limits of their own; the time until their answer begins is limited here.
    if is_stream(request.method().as_str(), request.uri().path()) {
        return match query {
            Ok(()) => with_time_limit(next.run(request)).await,
            Err(error) => ErrorResponse(error).into_response(),
        };
    }
    let Some(bytes_max) = bodies::body_max(request.method(), &route) else {
        let answer = with_time_limit(next.run(request)).await;
        // The client wanted the arm to stop: the faulty query is reported afterwards.
        return match query {
            Err(error) if answer.status().is_success() => {
                ErrorResponse(interface::after_stop(error)).into_response()
            }
            _ => answer,
        };
    };
    if let Err(error) = query {
        return ErrorResponse(error).into_response();
    }
    let caller = match caller(request.headers()) {
        Ok(caller) => caller,
        Err(error) => return ErrorResponse(error).into_response(),
    };
    let peer = peer_of(&request);
    // This future lives as long as the client's connection is open.
    let _presence = caller.guard();
    request.extensions_mut().insert(caller);
    // Read the body first: a slow sender occupies nothing that others need.
    let request = match read_body(request, bytes_max, (&state, peer)).await {
        Ok(request) => request,
        Err(error) => return ErrorResponse(error).into_response(),
    };
    let Ok(_place) = state.requests.try_acquire() else {
        return ErrorResponse(too_many(REQUESTS_MAX)).into_response();
    };
    let answer = with_time_limit(PEER.scope(peer, next.run(request))).await;
    bodies::account(answer, (&state.answers, peer))
        .unwrap_or_else(|error| ErrorResponse(error).into_response())
}

/// Returns the origin of a request, which its connection has set.
fn peer_of(request: &Request) -> ClientPeer {
    let peer = request.extensions().get::<ClientPeer>();
    peer.copied().unwrap_or(NO_PEER)
}

async fn with_time_limit(answer: impl Future<Output = Response>) -> Response {
    let error = match tokio::time::timeout(REQUEST_TIME_MAX, answer).await {
        Ok(response) if response.status().is_client_error() && !is_json(&response) => {
            let message = "invalid address or query";
            ApiError::new(
                codes::BAD_REQUEST,
                message,
                "encode it as UTF-8, percent-encoded",
            )
        }
        Ok(response) if response.status().is_server_error() && !is_json(&response) => {
            let message = format!("the loader could not answer: {}", response.status());
            let help = "this is a bug in the loader: report it";
            ApiError::new(codes::PROCESS_FAILED, message, help)
        }
        Ok(response) => return response,
        Err(_) => ApiError::new(
            codes::LOADER_SILENT,
            format!("the request took longer than {REQUEST_TIME_MAX:?}"),
            "try again; it may or may not have been carried out",
        ),
    };
    ErrorResponse(error).into_response()
}

/// Returns the caller with the waiting time that the client announces.
fn caller(head: &HeaderMap) -> Result<Caller, ApiError> {
    let Some(given) = head.get(TIMEOUT_HEADER) else {
        return Ok(Caller::default());
    };
    let time = given.to_str().ok().and_then(|text| text.parse().ok());
    let time = time.map(Duration::from_millis).ok_or_else(|| {
        ApiError::new(
            codes::BAD_REQUEST,
            format!("`{TIMEOUT_HEADER}` is not a number of milliseconds"),
            format!("send for example `{TIMEOUT_HEADER}: 2000`, or omit it"),
        )
    })?;
    Ok(Caller::until(Instant::now().checked_add(time)))
}

/// Reads the whole body of a request into memory.
async fn read_body(
    request: Request,
    bytes_max: usize,
    (state, peer): (&ServerState, ClientPeer),
) -> Result<Request, ApiError> {
    if bytes_max == 0 {
        return bodies::require_no_body(&request).map(|()| request);
    }
    let (mut parts, body) = request.into_parts();
    let (bytes, memory) = bodies::read(body, bytes_max, (&state.texts, peer)).await?;
    parts.extensions.insert(memory);
    Ok(Request::from_parts(parts, bytes.into()))
}

/// Returns true for our own errors, which are JSON; those of axum's extractors are not.
fn is_json(response: &Response) -> bool {
    let kind = response.headers().get(header::CONTENT_TYPE);
    kind.is_some_and(|kind| kind.as_bytes().starts_with(b"application/json"))
}

fn too_many(requests_max: usize) -> ApiError {
    ApiError::new(
        codes::TOO_MANY,
        format!("{requests_max} requests of this kind are being processed; this one is refused"),
        "try again in a moment",
    )
}

/// Returns the error for one more than these limits allow of something that a client does.
pub(super) fn too_many_of(limits: QuotaLimits, what: &str) -> ApiError {
    ApiError::new(
        codes::TOO_MANY,
        format!(
            "{what}: at most {}, and {} of one client; this one is refused",
            limits.all, limits.of_peer
        ),
        "try again when fewer are in progress",
    )
}

/// Returns the error for one stream or channel more than these limits allow.
pub(super) fn too_many_streams(limits: QuotaLimits, what: &str) -> ApiError {
    ApiError::new(
        codes::TOO_MANY,
        format!(
            "too many {what} are open: at most {}, and {} of one client; this one is refused",
            limits.all, limits.of_peer
        ),
        "close one of them, or use one for several values",
    )
}

/// Work for a request. Boxed, so that its way to a blocking thread is compiled once and not for each route.
type Work<T> = Box<dyn FnOnce(&Service) -> Result<T, ApiError> + Send>;

/// Runs `what` on a blocking thread.
pub(super) fn blocking<T: Send + 'static>(
    state: ServerState,
    what: impl FnOnce(&Service) -> Result<T, ApiError> + Send + 'static,
) -> impl Future<Output = Result<T, ApiError>> {
    run(state, Box::new(what))
}

async fn run<T: Send + 'static>(state: ServerState, work: Work<T>) -> Result<T, ApiError> {
    tokio::task::spawn_blocking(move || work(&state.service))
        .await
        .unwrap_or_else(|panic| {
            Err(ApiError::new(
                codes::PROCESS_FAILED,
                format!("the loader failed to process the request: {panic}"),
                "this is a bug in the loader: report it",
            ))
        })
}

/// As [`blocking`]; the result is also serialized to JSON there.
pub(super) fn answering<T: Serialize>(
    state: ServerState,
    what: impl FnOnce(&Service) -> Result<T, ApiError> + Send + 'static,
) -> impl Future<Output = Result<Response, ErrorResponse>> {
    answer(state, Box::new(move |service| written(&what(service)?)))
}

async fn answer(state: ServerState, work: Work<Vec<u8>>) -> Result<Response, ErrorResponse> {
    Ok(bodies::answer(run(state, work).await?))
}

/// As [`answering`], for requests that read command files.
pub(super) fn reading<T: Serialize>(
    state: ServerState,
    what: impl FnOnce(&Service) -> Result<T, ApiError> + Send + 'static,
) -> impl Future<Output = Result<Response, ErrorResponse>> {
    answer_in_turn(state, Box::new(move |service| written(&what(service)?)))
}

async fn answer_in_turn(
    state: ServerState,
    work: Work<Vec<u8>>,
) -> Result<Response, ErrorResponse> {
    let peer = PEER.try_with(|peer| *peer);
    let turn = state.reading.take(peer.unwrap_or(NO_PEER)).await;
    let work = Box::new(move |service: &Service| {
        // Passed on when the files are read, even if nobody waits for the answer any more.
        let _turn = turn;
        work(service)
    });
    answer(state, work).await
}

pub(super) fn written<T: Serialize>(value: &T) -> Result<Vec<u8>, ApiError> {
    serde_json::to_vec(value).map_err(|error| {
        ApiError::new(
            codes::PROCESS_FAILED,
            error.to_string(),
            "report it as a bug",
        )
    })
}

pub(super) fn text_of(body: Bytes, what: &str) -> Result<String, ApiError> {
    String::from_utf8(body.into()).map_err(|_| {
        ApiError::new(
            codes::BAD_REQUEST,
            format!("{what} not valid UTF-8"),
            "send YAML or JSON as UTF-8",
        )
    })
}

/// Returns an answer that is constant for this process; it is created once, by a blocking thread.
pub(super) async fn constant(
    state: ServerState,
    kept: &'static OnceLock<Bytes>,
    make: impl FnOnce(&Service) -> Result<Vec<u8>, ApiError> + Send + 'static,
) -> Result<Response, ErrorResponse> {
    let bytes = match kept.get() {
        Some(bytes) => bytes.clone(),
        None => {
            let made = blocking(state, make).await?;
            kept.get_or_init(|| made.into()).clone()
        }
    };
    Ok(([(header::CONTENT_TYPE, "application/json")], bytes).into_response())
}

/// Parses a JSON body.
pub(super) fn json<T: serde::de::DeserializeOwned>(body: &[u8]) -> Result<T, ApiError> {
    serde_json::from_slice(body).map_err(|error| {
        ApiError::new(
            codes::BAD_REQUEST,
            format!("invalid body: {error}"),
            "see `GET /openapi.json` for the format",
        )
    })
}
