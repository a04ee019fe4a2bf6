//! The routes of the REST interface (paper, section IV-B) and their OpenAPI document. Run by the one thread that serves
//! connections; everything that may block runs on blocking threads.

use std::io;
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use axum::body::Bytes;
use axum::extract::{DefaultBodyLimit, Extension, Path, State};
use axum::http::header;
use axum::middleware;
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post, put};
use axum::{Json, Router};
// Bodies that only the OpenAPI document names.
#[cfg(test)]
use rcc_api::bodies::*;
use rcc_api::bodies::{CommandRef, Start, Switch};
use rcc_api::catalogue;
use rcc_process::Helpers;
use serde::Deserialize;
use tokio::sync::Semaphore;

use super::bodies::{ANSWERS, TEXTS};
use super::caller::Caller;
use super::connection::{TCP, UNIX};
use super::error::ErrorResponse;
use super::fair_queue::FairQueue;
use super::quota::{Quota, QuotaLimits};
use super::service::{Operation, Service};
use super::stop_steps::{ArrivalTime, StopSteps};
use super::stop_workers::StopWorkers;
use interface::Query;
use requests::{answering, constant, json, limited, reading, text_of, written};

pub use set_points::{CHANNEL_IDLE_MAX, CHANNELS};
pub use stream::{FAST_STREAMS, STREAMS};

#[cfg(test)]
mod document;
mod interface;
mod load;
mod records;
mod requests;
mod rules;
mod set_points;
mod stream;

/// Limits of texts that are being compiled or wait for it; further ones are refused.
pub const LOADING: QuotaLimits = QuotaLimits {
    all: 32,
    of_peer: 16,
    reserve: 16,
    small: 1,
};
/// Maximum number of concurrent requests of all listeners; further ones are refused. CANCEL and ABORT are not counted.
pub const REQUESTS_MAX: usize = UNIX.connections + UNIX.reserve + TCP.connections + TCP.reserve;
/// Maximum number of threads that work for requests, one for each request, load and stream, so that none waits for a
/// thread.
pub const THREADS_MAX: usize = REQUESTS_MAX + LOADING.most() + CHANNELS.most() + STREAMS.most();
/// Maximum number of concurrent requests that read command files; further ones wait, those of different peers in turns.
pub const READING_MAX: usize = 2;
/// Time allowed for a request after its body has arrived.
pub const REQUEST_TIME_MAX: Duration = Duration::from_secs(10);

/// State shared by all requests.
#[derive(Clone)]
struct ServerState {
    service: Arc<Service>,
    stops: StopWorkers,
    requests: Arc<Semaphore>,
    loading: Arc<Quota>,
    compiling: Arc<FairQueue>,
    compiling_long: Arc<FairQueue>,
    reading: Arc<FairQueue>,
    texts: Arc<Quota>,
    answers: Arc<Quota>,
    channels: Arc<Quota>,
    streams: Arc<Quota>,
    fast_streams: Arc<Quota>,
}

/// The OpenAPI document of this interface. A test compares it with the handlers and the bodies.
pub const OPEN_API: &str = include_str!("routes/openapi.json");

/// Creates the router with all routes, and starts the threads of CANCEL and ABORT.
///
/// # Errors
/// Returns an error if the system cannot create a thread.
pub fn router(service: Arc<Service>, helpers: &Helpers) -> io::Result<Router> {
    let state = ServerState {
        service,
        stops: StopWorkers::start(helpers)?,
        requests: Arc::new(Semaphore::new(REQUESTS_MAX)),
        loading: Quota::new(LOADING),
        compiling: FairQueue::new(1),
        compiling_long: FairQueue::new(1),
        reading: FairQueue::new(READING_MAX),
        texts: Quota::new(TEXTS),
        answers: Quota::new(ANSWERS),
        channels: Quota::new(CHANNELS),
        streams: Quota::new(STREAMS),
        fast_streams: Quota::new(FAST_STREAMS),
    };
    Ok(routes(state))
}

fn routes(state: ServerState) -> Router {
    Router::new()
        .route("/commands", post(load::load).get(list))
        .route("/check", post(load::check))
        .route("/commands/{name}", get(detail).delete(unload))
        .route("/commands/{name}/start", post(start))
        .route("/commands/{name}/inputs", put(set))
        .route(
            "/commands/{name}/inputs/stream",
            post(set_points::set_points),
        )
        .route("/commands/{name}/values", get(values))
        .route("/stream", get(stream::stream))
        .route("/switch", post(switch))
        .route("/commands/{name}/cancel", post(cancel))
        .route("/commands/{name}/abort", post(abort))
        .merge(records::router())
        .merge(rules::router())
        .route("/devices", get(devices))
        .route("/primitives", get(primitives))
        .route("/schema", get(schema))
        .route("/status", get(status))
        .route("/status/acknowledge", post(acknowledge))
        .route("/timing", get(timing))
        .route("/topics", get(topics))
        .route("/openapi.json", get(openapi))
        .fallback(interface::no_route)
        // `limited` has already checked the size.
        .layer(DefaultBodyLimit::disable())
        .layer(middleware::from_fn_with_state(state.clone(), limited))
        .with_state(state)
}

/// Lists all commands, sorted by id.
#[cfg_attr(test, utoipa::path(get, path = "/commands", operation_id = "listCommands", tag = "commands",
    responses((status = 200, body = Vec<CommandView>), (status = 503, body = ErrorBody))))]
async fn list(State(state): State<ServerState>) -> Result<Response, ErrorResponse> {
    answering(state, Service::list).await
}

#[derive(Deserialize)]
struct DetailQuery {
    /// Without text and names.
    #[serde(default)]
    brief: bool,
    /// Also a command that was unloaded.
    #[serde(default)]
    unloaded: bool,
}

/// STATE: one command, by id or by the net's name (then the newest of that name).
#[cfg_attr(test, utoipa::path(get, path = "/commands/{name}", operation_id = "getCommand", tag = "commands",
    params(("name" = String, Path, description = "id or name"),
        ("brief" = Option<bool>, Query, description = "without `text` and `names`, which are long"),
        ("unloaded" = Option<bool>, Query,
            description = "also one of the last 256 that had ended when they were unloaded, by its id; implies `brief`")),
    responses((status = 200, body = CommandDetail), (status = 404, body = ErrorBody))))]
async fn detail(
    State(state): State<ServerState>,
    Path(name): Path<String>,
    Query(DetailQuery { brief, unloaded }): Query<DetailQuery>,
) -> Result<Response, ErrorResponse> {
    match brief {
        _ if unloaded => answering(state, move |service| service.detail_or_unloaded(&name)).await,
        true => answering(state, move |service| service.detail(&name, false)).await,
        false => reading(state, move |service| service.detail(&name, true)).await,
    }
}

/// Carries out CANCEL or ABORT, even if the client is gone: it wanted the arm to stop.
async fn stop(
    state: ServerState,
    name: String,
    what: Operation,
    arrived: ArrivalTime,
) -> Result<Response, ErrorResponse> {
    let service = state.service;
    let mut steps = StopSteps::since(arrived);
    steps.done("head");
    let stopped = move || {
        steps.done("queue");
        let done = &mut |step| steps.done(step);
        let stopped = service.carry_out(&Caller::default(), &name, what, done);
        Ok((stopped, steps))
    };
    let (stopped, mut steps) = state.stops.run(stopped).await?;
    steps.done("wake-up");
    steps.log_if_slow(what.name());
    Ok(Json(stopped?).into_response())
}

/// START: the net is evaluated from the next cycle on. With `after_stopping`, those commands end between the same two
/// cycles, and an arm that they command continues with the first set-point of this net; if that is impossible, nothing
/// changes.
#[cfg_attr(test, utoipa::path(post, path = "/commands/{name}/start", operation_id = "startCommand", tag = "commands", params(("name" = String, Path, description = "id or name")),
    request_body(content = Option<Start>, description = "optional"),
    responses((status = 200, body = Done), (status = 400, body = ErrorBody), (status = 404, body = ErrorBody),
        (status = 409, body = ErrorBody))))]
async fn start(
    State(state): State<ServerState>,
    Path(name): Path<String>,
    Extension(caller): Extension<Caller>,
    body: Bytes,
) -> Result<Response, ErrorResponse> {
    answering(state, move |service| {
        let options: Start = match body.is_empty() {
            true => Start::default(),
            false => json(&body)?,
        };
        if options.after_stopping.is_empty() {
            return service.start(&caller, &name, &options);
        }
        let switch = Switch {
            stop: options.after_stopping,
            start: vec![CommandRef::Name(name)],
            rules: options.rules,
            lease: options.lease,
        };
        service.start_after(&caller, &switch)
    })
    .await
}

/// Hand-over: some commands end and others start between the same two cycles, or nothing changes. An arm continues
/// without a gap: the first set-point must continue from the last one.
#[cfg_attr(test, utoipa::path(post, path = "/switch", operation_id = "switchCommands", tag = "commands", request_body(content = Switch),
    responses((status = 200, body = Switched), (status = 400, body = ErrorBody), (status = 404, body = ErrorBody),
        (status = 409, body = ErrorBody))))]
async fn switch(
    State(state): State<ServerState>,
    Extension(caller): Extension<Caller>,
    body: Bytes,
) -> Result<Response, ErrorResponse> {
    answering(state, move |service| service.switch(&caller, &json(&body)?)).await
}

/// Sets inputs of a ready or active net: a mapping from their names to constants of the language, YAML or JSON; null
/// unsets an input. All of them take effect in the same cycle, or none.
#[cfg_attr(test, utoipa::path(put, path = "/commands/{name}/inputs", operation_id = "setInputs", tag = "values", params(("name" = String, Path, description = "id or name")),
    request_body(content = Object, content_type = "application/json",
        description = "`{\"speed\": \"0.2 m/s\", \"goal\": {\"xyz\": [0.5, 0, 0.3], \"rpy\": [0, 0, 0]}}`"),
    responses((status = 200, body = InputsSet), (status = 404, body = ErrorBody), (status = 409, body = ErrorBody),
        (status = 422, body = ErrorBody))))]
async fn set(
    State(state): State<ServerState>,
    Path(name): Path<String>,
    Extension(caller): Extension<Caller>,
    body: Bytes,
) -> Result<Response, ErrorResponse> {
    answering(state, move |service| {
        service.set(&caller, &name, &text_of(body, "the values are")?)
    })
    .await
}

#[derive(Deserialize)]
struct ValuesQuery {
    /// Patterns, separated by commas.
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

/// Reads values of ports of a net, all from its last evaluation.
#[cfg_attr(test, utoipa::path(get, path = "/commands/{name}/values", operation_id = "readValues", tag = "values",
    params(("name" = String, Path, description = "id or name"),
        ("ports" = Option<String>, Query,
            description = "patterns such as `move.pose,ik.*,a.out[2]`; without, all outputs")),
    responses((status = 200, body = ValuesView), (status = 404, body = ErrorBody), (status = 409, body = ErrorBody))))]
async fn values(
    State(state): State<ServerState>,
    Path(name): Path<String>,
    Query(query): Query<ValuesQuery>,
    Extension(caller): Extension<Caller>,
) -> Result<Response, ErrorResponse> {
    reading(state, move |service| {
        service.values(&caller, &name, &query.patterns())
    })
    .await
}

/// CANCEL: the net's `Cancel` primitive outputs true from the next cycle on.
#[cfg_attr(test, utoipa::path(post, path = "/commands/{name}/cancel", operation_id = "cancelCommand", tag = "commands", params(("name" = String, Path, description = "id or name")),
    responses((status = 200, body = Done), (status = 404, body = ErrorBody), (status = 409, body = ErrorBody))))]
async fn cancel(
    State(state): State<ServerState>,
    Path(name): Path<String>,
    arrived: ArrivalTime,
) -> Result<Response, ErrorResponse> {
    stop(state, name, Operation::Cancel, arrived).await
}

/// ABORT: the devices get no more commands, and their drivers bring them to rest.
#[cfg_attr(test, utoipa::path(post, path = "/commands/{name}/abort", operation_id = "abortCommand", tag = "commands", params(("name" = String, Path, description = "id or name")),
    responses((status = 200, body = Done), (status = 404, body = ErrorBody), (status = 409, body = ErrorBody))))]
async fn abort(
    State(state): State<ServerState>,
    Path(name): Path<String>,
    arrived: ArrivalTime,
) -> Result<Response, ErrorResponse> {
    stop(state, name, Operation::Abort, arrived).await
}

/// UNLOAD: removes a command that is not active.
#[cfg_attr(test, utoipa::path(delete, path = "/commands/{name}", operation_id = "unloadCommand", tag = "commands", params(("name" = String, Path, description = "id or name")),
    responses((status = 200, body = Done), (status = 404, body = ErrorBody), (status = 409, body = ErrorBody))))]
async fn unload(
    State(state): State<ServerState>,
    Path(name): Path<String>,
    Extension(caller): Extension<Caller>,
) -> Result<Response, ErrorResponse> {
    answering(state, move |service| {
        service.operate(&caller, &name, Operation::Unload)
    })
    .await
}

/// Lists the devices, in the order of the cell's configuration.
#[cfg_attr(test, utoipa::path(get, path = "/devices", operation_id = "listDevices", tag = "cell",
    responses((status = 200, body = Vec<DeviceView>), (status = 503, body = ErrorBody))))]
async fn devices(State(state): State<ServerState>) -> Result<Response, ErrorResponse> {
    answering(state, Service::devices).await
}

/// Lists every primitive with its ports and parameters.
#[cfg_attr(test, utoipa::path(get, path = "/primitives", operation_id = "listPrimitives", tag = "language", responses((status = 200, body = Vec<PrimitiveView>))))]
async fn primitives(State(state): State<ServerState>) -> Result<Response, ErrorResponse> {
    static WRITTEN: OnceLock<Bytes> = OnceLock::new();
    constant(state, &WRITTEN, |_| written(&catalogue::primitives())).await
}

/// Returns the JSON Schema of nets, with the names of this cell's devices and channels.
#[cfg_attr(test, utoipa::path(get, path = "/schema", operation_id = "getNetSchema", tag = "language", responses((status = 200, body = serde_json::Value))))]
async fn schema(State(state): State<ServerState>) -> Result<Response, ErrorResponse> {
    answering(state, |service| Ok(service.schema())).await
}

/// Returns the executor's health and the processes of the cell.
#[cfg_attr(test, utoipa::path(get, path = "/status", operation_id = "getStatus", tag = "cell",
    responses((status = 200, body = StatusView), (status = 503, body = ErrorBody))))]
async fn status(State(state): State<ServerState>) -> Result<Response, ErrorResponse> {
    answering(state, Service::status).await
}

/// Acknowledges late cycles: latched cycles, worst values and histograms are reset.
#[cfg_attr(test, utoipa::path(post, path = "/status/acknowledge", operation_id = "acknowledgeLateCycles", tag = "cell",
    responses((status = 200, body = Acknowledged), (status = 503, body = ErrorBody))))]
async fn acknowledge(
    State(state): State<ServerState>,
    Extension(caller): Extension<Caller>,
) -> Result<Response, ErrorResponse> {
    answering(state, move |service| service.acknowledge(&caller)).await
}

/// Lists the topics: who publishes each value, and who subscribes to it.
#[cfg_attr(test, utoipa::path(get, path = "/topics", operation_id = "listTopics", tag = "values",
    responses((status = 200, body = Vec<TopicView>), (status = 503, body = ErrorBody))))]
async fn topics(State(state): State<ServerState>) -> Result<Response, ErrorResponse> {
    answering(state, Service::topics).await
}

/// Returns histograms of the cycle and the measured cost of primitives.
#[cfg_attr(test, utoipa::path(get, path = "/timing", operation_id = "getTiming", tag = "cell",
    responses((status = 200, body = TimingView), (status = 503, body = ErrorBody))))]
async fn timing(State(state): State<ServerState>) -> Result<Response, ErrorResponse> {
    answering(state, Service::timing).await
}

/// Returns this document.
#[cfg_attr(test, utoipa::path(get, path = "/openapi.json", operation_id = "getOpenApi", tag = "language",
    responses((status = 200, body = serde_json::Value))))]
async fn openapi() -> Response {
    ([(header::CONTENT_TYPE, "application/json")], OPEN_API).into_response()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_document_has_every_address() -> Result<(), serde_json::Error> {
        let document: serde_json::Value = serde_json::from_str(OPEN_API)?;
        let paths = document["paths"].as_object().map(|paths| {
            let mut names: Vec<_> = paths.keys().cloned().collect();
            names.sort();
            names
        });
        let expected = [
            "/check",
            "/commands",
            "/commands/{name}",
            "/commands/{name}/abort",
            "/commands/{name}/cancel",
            "/commands/{name}/inputs",
            "/commands/{name}/inputs/stream",
            "/commands/{name}/start",
            "/commands/{name}/values",
            "/devices",
            "/events",
            "/history",
            "/incidents",
            "/incidents/{file}",
            "/leases",
            "/leases/{lease}",
            "/leases/{lease}/commands",
            "/leases/{lease}/renew",
            "/openapi.json",
            "/primitives",
            "/rules",
            "/rules/{rule}",
            "/schema",
            "/status",
            "/status/acknowledge",
            "/stream",
            "/switch",
            "/timing",
            "/topics",
        ];
        assert_eq!(paths.as_deref(), Some(&expected.map(String::from)[..]));
        Ok(())
    }
}
