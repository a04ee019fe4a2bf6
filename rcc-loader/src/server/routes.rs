//! The addresses of the REST interface (paper, section IV-B) and their OpenAPI document.
//! Run by the one thread that serves connections; everything that may block goes to blocking threads.

use std::io;
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use axum::body::Bytes;
use axum::extract::{DefaultBodyLimit, Extension, MatchedPath, Path, Query, Request, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post, put};
use axum::{Json, Router};
use rcc_core::printable::Printable;
use serde::{Deserialize, Serialize};
use tokio::sync::Semaphore;
use utoipa::OpenApi;

use super::api;
use super::api::{
    Acknowledged, CommandDetail, CommandView, DeviceView, Done, ErrorBody, Frozen, InputsSet,
    Loaded, PrimitiveView, StatusView, Switched, TimingView, TopicView, ValuesView,
};
use super::bodies::{self, ANSWERS_MAX, LONG_TEXT, TEXTS_MAX, TextMemory};
use super::caller::{Caller, TIMEOUT_HEADER};
use super::catalogue;
use super::codes;
use super::error::ApiError;
use super::service::{Operation, Service};
use super::stop_workers::StopWorkers;

/// Texts that are compiled or wait for it; further ones are refused.
pub const LOADING_MAX: usize = 32;
/// Requests that are answered at a time; further ones are refused. CANCEL and ABORT are not counted.
pub const REQUESTS_MAX: usize = 64;
/// Requests of them that read the files of commands at a time; further ones wait.
pub const READING_MAX: usize = 2;
/// So long a request may take after its body has come.
pub const REQUEST_TIME: Duration = Duration::from_secs(10);

/// What all requests share.
#[derive(Clone)]
struct ServerState {
    service: Arc<Service>,
    stops: StopWorkers,
    requests: Arc<Semaphore>,
    loading: Arc<Semaphore>,
    compiling: Arc<Semaphore>,
    compiling_long: Arc<Semaphore>,
    reading: Arc<Semaphore>,
    texts: Arc<Semaphore>,
    answers: Arc<Semaphore>,
}

#[derive(OpenApi)]
#[openapi(
    info(
        title = "RCC",
        description = "Robot Control Core: load a net as a command, start it, cancel it, look at it."
    ),
    paths(
        load,
        list,
        detail,
        start,
        switch,
        set,
        values,
        cancel,
        abort,
        unload,
        incident,
        devices,
        primitives,
        schema,
        status,
        timing,
        topics,
        acknowledge
    ),
    components(schemas(ErrorBody, api::Finding, api::TextLocation))
)]
struct Document;

/// The OpenAPI document of this interface.
///
/// # Errors
/// It cannot be written as JSON (by test it can).
pub fn document() -> Result<String, serde_json::Error> {
    Document::openapi().to_pretty_json()
}

/// All addresses. Makes the threads of CANCEL and ABORT.
///
/// # Errors
/// The system gives no thread.
pub fn router(service: Arc<Service>) -> io::Result<Router> {
    let places = |count| Arc::new(Semaphore::new(count));
    let state = ServerState {
        service,
        stops: StopWorkers::start()?,
        requests: places(REQUESTS_MAX),
        loading: places(LOADING_MAX),
        compiling: places(1),
        compiling_long: places(1),
        reading: places(READING_MAX),
        texts: places(TEXTS_MAX),
        answers: places(ANSWERS_MAX),
    };
    Ok(routes(state))
}

fn routes(state: ServerState) -> Router {
    Router::new()
        .route("/commands", post(load).get(list))
        .route("/commands/{name}", get(detail).delete(unload))
        .route("/commands/{name}/start", post(start))
        .route("/commands/{name}/inputs", put(set))
        .route("/commands/{name}/values", get(values))
        .route("/switch", post(switch))
        .route("/commands/{name}/cancel", post(cancel))
        .route("/commands/{name}/abort", post(abort))
        .route("/incidents", post(incident))
        .route("/devices", get(devices))
        .route("/primitives", get(primitives))
        .route("/schema", get(schema))
        .route("/status", get(status))
        .route("/status/acknowledge", post(acknowledge))
        .route("/timing", get(timing))
        .route("/topics", get(topics))
        .route("/openapi.json", get(openapi))
        .fallback(no_route)
        .method_not_allowed_fallback(no_route)
        // `limited` has already looked at the size.
        .layer(DefaultBodyLimit::disable())
        .layer(middleware::from_fn_with_state(state.clone(), limited))
        .with_state(state)
}

/// Bounds the number of requests, the size of each, and the time it takes to come and to be answered.
async fn limited(State(state): State<ServerState>, mut request: Request, next: Next) -> Response {
    let route = request.extensions().get::<MatchedPath>();
    let route = route.map_or_else(String::new, |route| route.as_str().to_owned());
    let Some(bytes_max) = bodies::body_max(request.method(), &route) else {
        return with_time_limit(next.run(request)).await;
    };
    let caller = match caller(request.headers()) {
        Ok(caller) => caller,
        Err(error) => return error.into_response(),
    };
    // As long as the client's connection is open, this future lives.
    let _presence = caller.guard();
    request.extensions_mut().insert(caller);
    // First the body: whoever sends slowly holds nothing that others need.
    let request = match read_body(request, bytes_max, &state).await {
        Ok(request) => request,
        Err(error) => return error.into_response(),
    };
    let Ok(_place) = state.requests.try_acquire() else {
        return too_many(REQUESTS_MAX).into_response();
    };
    with_time_limit(next.run(request)).await
}

async fn with_time_limit(answer: impl Future<Output = Response>) -> Response {
    match tokio::time::timeout(REQUEST_TIME, answer).await {
        Ok(response) if response.status().is_client_error() && !is_json(&response) => {
            let message = "the address or its query is not understood";
            ApiError::new(
                codes::BAD_REQUEST,
                message,
                "write it as UTF-8, percent-encoded",
            )
            .into_response()
        }
        Ok(response) if response.status().is_server_error() && !is_json(&response) => {
            let message = format!("the loader could not answer: {}", response.status());
            let help = "this is a fault of the loader: report it";
            ApiError::new(codes::PROCESS_FAILED, message, help).into_response()
        }
        Ok(response) => response,
        Err(_) => ApiError::new(
            codes::LOADER_SILENT,
            format!("the request took longer than {REQUEST_TIME:?}"),
            "try again; whether it was carried out is not known",
        )
        .into_response(),
    }
}

/// How long the client says that it waits.
fn caller(head: &HeaderMap) -> Result<Caller, ApiError> {
    let Some(given) = head.get(TIMEOUT_HEADER) else {
        return Ok(Caller::default());
    };
    let time = given.to_str().ok().and_then(|text| text.parse().ok());
    let time = time.map(Duration::from_millis).ok_or_else(|| {
        ApiError::new(
            codes::BAD_REQUEST,
            format!("`{TIMEOUT_HEADER}` has no number of milliseconds"),
            format!("send `{TIMEOUT_HEADER}: 2000`, or leave it out"),
        )
    })?;
    Ok(Caller::until(Instant::now().checked_add(time)))
}

/// The request with all of its body in memory.
async fn read_body(
    request: Request,
    bytes_max: usize,
    state: &ServerState,
) -> Result<Request, ApiError> {
    if bytes_max == 0 {
        return bodies::require_no_body(&request).map(|()| request);
    }
    let (mut parts, body) = request.into_parts();
    let (bytes, memory) = bodies::read(body, bytes_max, &state.texts).await?;
    parts.extensions.insert(memory);
    Ok(Request::from_parts(parts, bytes.into()))
}

/// Errors of ours are JSON; those that the extractors make by themselves are not.
fn is_json(response: &Response) -> bool {
    let kind = response.headers().get(header::CONTENT_TYPE);
    kind.is_some_and(|kind| kind.as_bytes().starts_with(b"application/json"))
}

fn too_many(bytes_max: usize) -> ApiError {
    ApiError::new(
        codes::TOO_MANY,
        format!("{bytes_max} requests of this kind are under way, more are not taken"),
        "try again in a moment",
    )
}

/// Runs what may block where it may block.
async fn blocking<T: Send + 'static>(
    state: ServerState,
    what: impl FnOnce(&Service) -> Result<T, ApiError> + Send + 'static,
) -> Result<T, ApiError> {
    tokio::task::spawn_blocking(move || what(&state.service))
        .await
        .unwrap_or_else(|panic| {
            Err(ApiError::new(
                codes::PROCESS_FAILED,
                format!("the loader could not do it: {panic}"),
                "this is a fault of the loader: report it",
            ))
        })
}

/// As [`blocking`], with the result as JSON, which is written there, too.
async fn answering<T: Serialize>(
    state: ServerState,
    what: impl FnOnce(&Service) -> Result<T, ApiError> + Send + 'static,
) -> Result<Response, ApiError> {
    let answers = Arc::clone(&state.answers);
    let bytes = blocking(state, |service| written(&what(service)?)).await?;
    bodies::answer(bytes, &answers)
}

/// As [`answering`], for what reads the files of commands.
async fn reading<T: Serialize>(
    state: ServerState,
    what: impl FnOnce(&Service) -> Result<T, ApiError> + Send + 'static,
) -> Result<Response, ApiError> {
    let places = Arc::clone(&state.reading);
    // The semaphores are never closed.
    let place = places.acquire_owned().await.ok();
    answering(state, move |service| {
        // Given back when the files are read and the answer is written, also if nobody waits for it any more.
        let _place = place;
        what(service)
    })
    .await
}

fn written<T: Serialize>(value: &T) -> Result<Vec<u8>, ApiError> {
    serde_json::to_vec(value).map_err(|error| {
        ApiError::new(
            codes::PROCESS_FAILED,
            error.to_string(),
            "report it as a bug",
        )
    })
}

fn text_of(body: Bytes, what: &str) -> Result<String, ApiError> {
    String::from_utf8(body.into()).map_err(|_| {
        ApiError::new(
            codes::BAD_REQUEST,
            format!("{what} not UTF-8"),
            "send YAML or JSON as UTF-8",
        )
    })
}

#[derive(Deserialize)]
struct LoadQuery {
    /// How diagnostics name the text.
    #[serde(default)]
    file: Option<String>,
}

/// LOAD: the body is the text of a net, YAML or JSON. Answers at once; the state goes from `loading` to `ready` or
/// `rejected`.
#[utoipa::path(post, path = "/commands", request_body(content = String, content_type = "application/yaml"),
    params(("file" = Option<String>, Query, description = "how diagnostics name the text")),
    responses((status = 202, body = Loaded), (status = 409, body = ErrorBody), (status = 503, body = ErrorBody)))]
async fn load(
    State(state): State<ServerState>,
    Query(query): Query<LoadQuery>,
    Extension(caller): Extension<Caller>,
    Extension(memory): Extension<TextMemory>,
    body: Bytes,
) -> Result<Response, ApiError> {
    let place = Arc::clone(&state.loading)
        .try_acquire_owned()
        .map_err(|_| too_many(LOADING_MAX))?;
    let turns = Arc::clone(match body.len() > LONG_TEXT {
        true => &state.compiling_long,
        false => &state.compiling,
    });
    let id = blocking(state.clone(), move |service| {
        service.reserve(&caller, text_of(body, "the text is")?)
    })
    .await?;
    // It goes into every drawing of a fault.
    let file = Printable(query.file.as_deref().unwrap_or("net")).to_string();
    tokio::spawn(async move {
        // The semaphores are never closed.
        let _turn = turns.acquire().await;
        let service = Arc::clone(&state.service);
        let compiled = tokio::task::spawn_blocking(move || service.install(id, &file));
        if let Err(error) = compiled.await {
            tracing::error!(id, %error, "a load panicked");
        }
        drop((place, memory));
    });
    let state = "loading".to_owned();
    Ok((StatusCode::ACCEPTED, Json(Loaded { id, state })).into_response())
}

/// All commands, by id.
#[utoipa::path(get, path = "/commands",
    responses((status = 200, body = Vec<CommandView>), (status = 503, body = ErrorBody)))]
async fn list(State(state): State<ServerState>) -> Result<Response, ApiError> {
    answering(state, Service::list).await
}

#[derive(Deserialize)]
struct DetailQuery {
    /// Without text and names.
    #[serde(default)]
    brief: bool,
}

/// STATE: one command, by id or by the net's name (then the newest of that name).
#[utoipa::path(get, path = "/commands/{name}",
    params(("name" = String, Path, description = "id or name"),
        ("brief" = Option<bool>, Query, description = "without `text` and `names`, which are long")),
    responses((status = 200, body = CommandDetail), (status = 404, body = ErrorBody)))]
async fn detail(
    State(state): State<ServerState>,
    Path(name): Path<String>,
    Query(DetailQuery { brief }): Query<DetailQuery>,
) -> Result<Response, ApiError> {
    match brief {
        true => answering(state, move |service| service.detail(&name, false)).await,
        false => reading(state, move |service| service.detail(&name, true)).await,
    }
}

/// CANCEL and ABORT are carried out also when their client is gone: whoever sent them wanted the arm to stop.
async fn stop(state: ServerState, name: String, what: Operation) -> Result<Response, ApiError> {
    let service = state.service;
    let stopped = move || service.operate(&Caller::default(), &name, what);
    state
        .stops
        .run(stopped)
        .await
        .map(|done| Json(done).into_response())
}

/// START: evaluated from the next cycle on. With `after_stopping` those commands end between the same two cycles, and
/// an arm that they command goes on with the first set-point of this one; if that cannot be, nothing changes.
#[utoipa::path(post, path = "/commands/{name}/start", params(("name" = String, Path, description = "id or name")),
    request_body(content = Option<api::Start>, description = "may be left out"),
    responses((status = 200, body = Done), (status = 400, body = ErrorBody), (status = 404, body = ErrorBody),
        (status = 409, body = ErrorBody)))]
async fn start(
    State(state): State<ServerState>,
    Path(name): Path<String>,
    Extension(caller): Extension<Caller>,
    body: Bytes,
) -> Result<Response, ApiError> {
    answering(state, move |service| {
        let api::Start { after_stopping } = match body.is_empty() {
            true => api::Start::default(),
            false => json(&body)?,
        };
        if after_stopping.is_empty() {
            return service.operate(&caller, &name, Operation::Start);
        }
        let switch = api::Switch {
            stop: after_stopping,
            start: vec![api::CommandRef::Name(name)],
        };
        service.start_after(&caller, &switch)
    })
    .await
}

/// Hand-over: some commands end and others begin between the same two cycles, or nothing changes. An arm goes on without
/// a gap: the first set-point must continue from the last one.
#[utoipa::path(post, path = "/switch", request_body(content = api::Switch),
    responses((status = 200, body = Switched), (status = 400, body = ErrorBody), (status = 404, body = ErrorBody),
        (status = 409, body = ErrorBody)))]
async fn switch(
    State(state): State<ServerState>,
    Extension(caller): Extension<Caller>,
    body: Bytes,
) -> Result<Response, ApiError> {
    answering(state, move |service| service.switch(&caller, &json(&body)?)).await
}

/// Sets inputs of a ready or active net: a mapping from their names to constants of the language, YAML or JSON; null
/// unsets. All of them count from the same cycle on, or none.
#[utoipa::path(put, path = "/commands/{name}/inputs", params(("name" = String, Path, description = "id or name")),
    request_body(content = Object, content_type = "application/json",
        description = "`{\"speed\": \"0.2 m/s\", \"goal\": {\"xyz\": [0.5, 0, 0.3], \"rpy\": [0, 0, 0]}}`"),
    responses((status = 200, body = InputsSet), (status = 404, body = ErrorBody), (status = 409, body = ErrorBody),
        (status = 422, body = ErrorBody)))]
async fn set(
    State(state): State<ServerState>,
    Path(name): Path<String>,
    Extension(caller): Extension<Caller>,
    body: Bytes,
) -> Result<Response, ApiError> {
    answering(state, move |service| {
        service.set(&caller, &name, &text_of(body, "the values are")?)
    })
    .await
}

#[derive(Deserialize)]
struct ValuesQuery {
    /// Patterns with commas between them.
    #[serde(default)]
    ports: Option<String>,
}

impl ValuesQuery {
    fn patterns(&self) -> Vec<String> {
        let ports = self.ports.as_deref().unwrap_or_default().split(',');
        let ports = ports.map(str::trim).filter(|port| !port.is_empty());
        ports.map(str::to_owned).collect()
    }
}

/// Values of any ports of a net, all of one cycle: those that its last evaluation left.
#[utoipa::path(get, path = "/commands/{name}/values",
    params(("name" = String, Path, description = "id or name"),
        ("ports" = Option<String>, Query,
            description = "patterns as `move.pose,ik.*,a.out[2]`; all outputs without")),
    responses((status = 200, body = ValuesView), (status = 404, body = ErrorBody), (status = 409, body = ErrorBody)))]
async fn values(
    State(state): State<ServerState>,
    Path(name): Path<String>,
    Query(query): Query<ValuesQuery>,
    Extension(caller): Extension<Caller>,
) -> Result<Response, ApiError> {
    reading(state, move |service| {
        service.values(&caller, &name, &query.patterns())
    })
    .await
}

/// A body of JSON.
fn json<T: serde::de::DeserializeOwned>(body: &[u8]) -> Result<T, ApiError> {
    serde_json::from_slice(body).map_err(|error| {
        ApiError::new(
            codes::BAD_REQUEST,
            format!("the body is not understood: {error}"),
            "`GET /openapi.json` shows what it may be",
        )
    })
}

/// CANCEL: the net's `Cancel` says true from the next cycle on.
#[utoipa::path(post, path = "/commands/{name}/cancel", params(("name" = String, Path, description = "id or name")),
    responses((status = 200, body = Done), (status = 404, body = ErrorBody), (status = 409, body = ErrorBody)))]
async fn cancel(
    State(state): State<ServerState>,
    Path(name): Path<String>,
) -> Result<Response, ApiError> {
    stop(state, name, Operation::Cancel).await
}

/// ABORT: the devices get no command any more, and their drivers bring them to rest.
#[utoipa::path(post, path = "/commands/{name}/abort", params(("name" = String, Path, description = "id or name")),
    responses((status = 200, body = Done), (status = 404, body = ErrorBody), (status = 409, body = ErrorBody)))]
async fn abort(
    State(state): State<ServerState>,
    Path(name): Path<String>,
) -> Result<Response, ApiError> {
    stop(state, name, Operation::Abort).await
}

/// UNLOAD: forgets a command that is not active.
#[utoipa::path(delete, path = "/commands/{name}", params(("name" = String, Path, description = "id or name")),
    responses((status = 200, body = Done), (status = 404, body = ErrorBody), (status = 409, body = ErrorBody)))]
async fn unload(
    State(state): State<ServerState>,
    Path(name): Path<String>,
    Extension(caller): Extension<Caller>,
) -> Result<Response, ApiError> {
    answering(state, move |service| {
        service.operate(&caller, &name, Operation::Unload)
    })
    .await
}

/// Has the flight recorder write its last seconds to a file.
#[utoipa::path(post, path = "/incidents",
    responses((status = 200, body = Frozen), (status = 409, body = ErrorBody), (status = 503, body = ErrorBody)))]
async fn incident(
    State(state): State<ServerState>,
    Extension(caller): Extension<Caller>,
) -> Result<Response, ApiError> {
    answering(state, move |service| service.freeze(&caller)).await
}

/// The devices, in the order of the cell's configuration.
#[utoipa::path(get, path = "/devices",
    responses((status = 200, body = Vec<DeviceView>), (status = 503, body = ErrorBody)))]
async fn devices(State(state): State<ServerState>) -> Result<Response, ApiError> {
    answering(state, Service::devices).await
}

/// Every primitive with its ports and parameters.
#[utoipa::path(get, path = "/primitives", responses((status = 200, body = Vec<PrimitiveView>)))]
async fn primitives(State(state): State<ServerState>) -> Result<Response, ApiError> {
    static WRITTEN: OnceLock<Bytes> = OnceLock::new();
    constant(state, &WRITTEN, |_| written(&catalogue::primitives())).await
}

/// An answer that is always the same for this process: made once, by a blocking thread.
async fn constant(
    state: ServerState,
    kept: &'static OnceLock<Bytes>,
    make: impl FnOnce(&Service) -> Result<Vec<u8>, ApiError> + Send + 'static,
) -> Result<Response, ApiError> {
    let bytes = match kept.get() {
        Some(bytes) => bytes.clone(),
        None => {
            let made = blocking(state, make).await?;
            kept.get_or_init(|| made.into()).clone()
        }
    };
    Ok(([(header::CONTENT_TYPE, "application/json")], bytes).into_response())
}

/// The JSON Schema of nets, with the names of this cell's devices and channels.
#[utoipa::path(get, path = "/schema", responses((status = 200, body = serde_json::Value)))]
async fn schema(State(state): State<ServerState>) -> Result<Response, ApiError> {
    answering(state, |service| Ok(service.schema())).await
}

/// The executor's health and the processes of the cell.
#[utoipa::path(get, path = "/status",
    responses((status = 200, body = StatusView), (status = 503, body = ErrorBody)))]
async fn status(State(state): State<ServerState>) -> Result<Response, ApiError> {
    answering(state, Service::status).await
}

/// Late cycles are acknowledged: what is latched, worst values and histograms begin anew.
#[utoipa::path(post, path = "/status/acknowledge",
    responses((status = 200, body = Acknowledged), (status = 503, body = ErrorBody)))]
async fn acknowledge(
    State(state): State<ServerState>,
    Extension(caller): Extension<Caller>,
) -> Result<Response, ApiError> {
    answering(state, move |service| service.acknowledge(&caller)).await
}

/// Values that go from net to net: who publishes what, and who subscribes to it.
#[utoipa::path(get, path = "/topics",
    responses((status = 200, body = Vec<TopicView>), (status = 503, body = ErrorBody)))]
async fn topics(State(state): State<ServerState>) -> Result<Response, ApiError> {
    answering(state, Service::topics).await
}

/// Histograms of the cycle, and what primitives cost.
#[utoipa::path(get, path = "/timing",
    responses((status = 200, body = TimingView), (status = 503, body = ErrorBody)))]
async fn timing(State(state): State<ServerState>) -> Result<Response, ApiError> {
    answering(state, Service::timing).await
}

async fn openapi(State(state): State<ServerState>) -> Result<Response, ApiError> {
    static WRITTEN: OnceLock<Bytes> = OnceLock::new();
    constant(state, &WRITTEN, |_| {
        let text = document();
        text.map(String::into_bytes).map_err(|error| {
            ApiError::new(
                codes::PROCESS_FAILED,
                error.to_string(),
                "report it as a bug",
            )
        })
    })
    .await
}

async fn no_route() -> ApiError {
    ApiError::new(
        codes::NO_ROUTE,
        "there is no such address or method",
        "GET /openapi.json lists all",
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_document_has_every_address() -> Result<(), serde_json::Error> {
        let document: serde_json::Value = serde_json::from_str(&document()?)?;
        let paths = document["paths"].as_object().map(|paths| {
            let mut names: Vec<_> = paths.keys().cloned().collect();
            names.sort();
            names
        });
        let expected = [
            "/commands",
            "/commands/{name}",
            "/commands/{name}/abort",
            "/commands/{name}/cancel",
            "/commands/{name}/inputs",
            "/commands/{name}/start",
            "/commands/{name}/values",
            "/devices",
            "/incidents",
            "/primitives",
            "/schema",
            "/status",
            "/status/acknowledge",
            "/switch",
            "/timing",
            "/topics",
        ];
        assert_eq!(paths.as_deref(), Some(&expected.map(String::from)[..]));
        Ok(())
    }
}
