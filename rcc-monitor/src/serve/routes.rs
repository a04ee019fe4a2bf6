//! The routes of the dashboard. Run by the one serving thread; long operations run on blocking threads.

use std::sync::Arc;

use axum::body::Bytes;
use axum::extract::rejection::JsonRejection;
use axum::extract::{DefaultBodyLimit, Path, Query, State};
use axum::http::{HeaderMap, header};
use axum::middleware;
use axum::response::IntoResponse;
use axum::routing::{get, post};
use axum::{Json, Router};
use hyper::Method;
use rcc_api::bodies::ErrorBody;
use rcc_api::codes;
use rcc_protocol::pattern::Pattern;
use serde::Deserialize;
use serde_json::{Value, json};
use tokio::sync::Semaphore;

use super::Server;
use super::access::{Access, guard};
use super::answers::{Answered, Refused, passed};
use super::hub::{PORTS_MAX, RATE_MAX, VIEWERS_MAX, Watch};
use super::{assets, drawings, incidents, metrics, triggers, viewer};

/// Maximum size of a request's body, bytes.
const BODY_MAX: usize = 16 << 10;
/// CANCEL requests of one page at a time: the loader serves 8 of a peer, and keeps some for other pages.
const STOPS_MAX: usize = 5;
/// Highest rate of monitored ports, Hz: no executor is faster.
const MONITOR_RATE_MAX: f64 = 10_000.0;

type Shared = State<Arc<Server>>;

/// Creates the router.
pub fn router(server: Arc<Server>, access: Arc<Access>) -> Router {
    Router::new()
        .route("/", get(assets::index))
        .route("/assets/{*path}", get(assets::file))
        .route("/metrics", get(metrics::answer))
        .route("/api/stream", get(stream))
        .route("/api/viewers/{viewer}/watch", post(watch))
        .route("/api/cancel", post(cancel_all))
        .route("/api/nets/{id}", get(net))
        .route("/api/nets/{id}/graph", get(graph))
        .route("/api/nets/{id}/start", post(start))
        .route("/api/nets/{id}/{stop}", post(stop))
        .route("/api/timing", get(timing))
        .route("/api/acknowledge", post(acknowledge))
        .route("/api/triggers", get(triggers::list).post(triggers::arm))
        .route("/api/triggers/{rule}/disarm", post(triggers::disarm))
        .route("/api/incidents", get(list_incidents).post(record_incident))
        .route("/api/incidents/{file}", get(incident))
        .route("/api/incidents/{file}/values", get(incident_values))
        .fallback(no_route)
        .layer(DefaultBodyLimit::max(BODY_MAX))
        .layer(middleware::from_fn_with_state(access, guard))
        .with_state(server)
}

async fn no_route() -> Refused {
    Refused::new(codes::NO_ROUTE, "the address does not exist", "open `/`")
}

/// Runs blocking work.
async fn blocking<T: Send + 'static>(
    work: impl FnOnce() -> Result<T, ErrorBody> + Send + 'static,
) -> Result<T, Refused> {
    let done = tokio::task::spawn_blocking(work).await;
    let panicked = |_| {
        Refused::new(
            codes::PROCESS_FAILED,
            "the dashboard's thread panicked",
            "report it as a bug",
        )
    };
    Ok(done.map_err(panicked)??)
}

async fn stream(State(server): Shared, headers: HeaderMap) -> Answered {
    let Some((viewer, updates)) = server.hub.connect() else {
        let message = format!("{VIEWERS_MAX} pages are open");
        return Err(Refused::new(codes::TOO_MANY, message, "close one of them"));
    };
    let last = headers
        .get("last-event-id")
        .and_then(|id| id.to_str().ok()?.parse().ok());
    Ok(viewer::answer(server, viewer, updates, last))
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WatchBody {
    ports: Vec<String>,
    rate: f64,
    #[serde(default)]
    arms: bool,
}

async fn watch(
    State(server): Shared,
    Path(viewer): Path<u64>,
    body: Result<Json<WatchBody>, JsonRejection>,
) -> Answered {
    let bad = |message: String| Refused::new(codes::BAD_REQUEST, message, "");
    let Json(body) = body.map_err(|error| bad(error.body_text()))?;
    if body.ports.len() > PORTS_MAX {
        return Err(bad(format!(
            "at most {PORTS_MAX} ports can be watched, not {}",
            body.ports.len()
        )));
    }
    if !(0.1..=MONITOR_RATE_MAX).contains(&body.rate) {
        return Err(bad(format!(
            "the rate is 0.1 to {MONITOR_RATE_MAX} Hz, not {}",
            body.rate
        )));
    }
    for port in &body.ports {
        let parsed: Result<Pattern, _> = port.parse();
        parsed.map_err(|error| bad(error.to_string()))?;
        if !port.contains('/') || port.contains([',', '[']) {
            return Err(bad(format!(
                "invalid port `{port}`: write net/primitive.port"
            )));
        }
    }
    let wanted = Watch {
        ports: body.ports,
        rate: body.rate,
        arms: body.arms,
    };
    if !server.hub.watch(viewer, wanted) {
        return Err(bad(format!("page {viewer} has no stream: open one first")));
    }
    Ok(Json(json!({"sampled_hz_max": RATE_MAX})).into_response())
}

async fn net(State(server): Shared, Path(id): Path<u64>) -> Answered {
    passed(
        &server,
        Method::GET,
        &format!("/commands/{id}"),
        String::new(),
    )
    .await
}

async fn graph(State(server): Shared, Path(id): Path<u64>) -> Answered {
    let structure = server.structure(id).await?;
    let svg = blocking(move || drawings::draw(&structure)).await?;
    Ok(([(header::CONTENT_TYPE, "image/svg+xml")], svg).into_response())
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct StartBody {
    /// The net as the person saw it when confirming: `net#id`.
    confirm: String,
}

/// START, if the person confirmed this very net.
async fn start(
    State(server): Shared,
    Path(id): Path<u64>,
    body: Result<Json<StartBody>, JsonRejection>,
) -> Answered {
    if !server.may_start {
        let help = "start the dashboard without `--no-start`, or use `rcc-cli start`";
        return Err(Refused::new(
            codes::NOT_PERMITTED,
            "this dashboard may not start nets",
            help,
        ));
    }
    let confirmed = body.map(|Json(body)| body.confirm);
    let confirmed = confirmed.map_err(|error| {
        Refused::new(
            codes::BAD_REQUEST,
            error.body_text(),
            "send {\"confirm\": \"net#id\"}",
        )
    })?;
    let row = server
        .loader
        .get(&format!("/commands/{id}?brief=true"))
        .await?;
    let title = format!("{}#{id}", row["net"].as_str().unwrap_or_default());
    if confirmed != title {
        let message = format!(
            "`{confirmed}` was confirmed, but command {id} is `{title}`: nothing was started"
        );
        return Err(Refused::new(
            codes::BAD_REQUEST,
            message,
            "look at the list again",
        ));
    }
    passed(
        &server,
        Method::POST,
        &format!("/commands/{id}/start"),
        String::new(),
    )
    .await
}

/// CANCEL and ABORT.
async fn stop(State(server): Shared, Path((id, stop)): Path<(u64, String)>) -> Answered {
    if !matches!(stop.as_str(), "cancel" | "abort") {
        return Err(no_route().await);
    }
    passed(
        &server,
        Method::POST,
        &format!("/commands/{id}/{stop}"),
        String::new(),
    )
    .await
}

/// CANCEL of every active net. Nets without a `Cancel` are listed, for ABORT.
async fn cancel_all(State(server): Shared) -> Answered {
    let rows = server.loader.get("/commands").await?;
    let is_active = |row: &&Value| matches!(row["state"].as_str(), Some("running" | "canceling"));
    let active: Vec<(u64, String)> = rows
        .as_array()
        .into_iter()
        .flatten()
        .filter(is_active)
        .filter_map(|row| Some((row["id"].as_u64()?, row["net"].as_str()?.to_owned())))
        .collect();
    // Several at once; the loader refuses a peer that sends more.
    let places = Arc::new(Semaphore::new(STOPS_MAX));
    let asked = active.into_iter().map(|(id, net)| {
        let loader = server.loader.clone();
        let path = format!("/commands/{id}/cancel");
        let places = Arc::clone(&places);
        let sent = tokio::spawn(async move {
            // The semaphore is never closed.
            let _place = places.acquire().await;
            loader.request(Method::POST, &path, String::new()).await
        });
        (id, net, sent)
    });
    let asked: Vec<_> = asked.collect();
    let mut results = Vec::new();
    for (id, net, sent) in asked {
        let error = match sent.await {
            Ok(Ok(answer)) if answer.status < 300 => Value::Null,
            Ok(Ok(answer)) => serde_json::from_slice(&answer.body).unwrap_or_default(),
            Ok(Err(error)) => json!(error),
            Err(error) => json!({"message": error.to_string()}),
        };
        results.push(json!({"id": id, "net": net, "error": error}));
    }
    server.hub.poll.notify_one();
    Ok(Json(results).into_response())
}

async fn timing(State(server): Shared) -> Answered {
    passed(&server, Method::GET, "/timing", String::new()).await
}

async fn acknowledge(State(server): Shared) -> Answered {
    passed(&server, Method::POST, "/status/acknowledge", String::new()).await
}

async fn record_incident(State(server): Shared, _body: Bytes) -> Answered {
    passed(&server, Method::POST, "/incidents", String::new()).await
}

async fn list_incidents(State(server): Shared) -> Answered {
    let found = blocking(move || incidents::list(&server.cell)).await?;
    Ok(Json(found).into_response())
}

async fn incident(State(server): Shared, Path(file): Path<String>) -> Answered {
    let _turn = server.replays.acquire().await;
    let cell = server.cell.clone();
    let found = blocking(move || incidents::ports(&cell, &file)).await?;
    Ok(Json(found).into_response())
}

#[derive(Deserialize)]
struct ValuesQuery {
    ports: String,
}

async fn incident_values(
    State(server): Shared,
    Path(file): Path<String>,
    Query(query): Query<ValuesQuery>,
) -> Answered {
    let _turn = server.replays.acquire().await;
    let cell = server.cell.clone();
    let patterns: Vec<String> = query.ports.split(',').map(str::to_owned).collect();
    let found = blocking(move || incidents::values(&cell, &file, &patterns)).await?;
    Ok(Json(found).into_response())
}
