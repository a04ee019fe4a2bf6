//! The routes of what a cell has recorded: events of its log, monitored values, and incident files. Run by the one thread that serves
//! connections.

use std::io::{Seek, SeekFrom};

use axum::Router;
use axum::body::Body;
use axum::extract::{Extension, Path, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
#[cfg(test)]
use rcc_api::bodies::{ErrorBody, EventPage, HistoryPage, IncidentView, WrittenIncident};
use rcc_api::codes;
use rcc_api::error::ApiError;
use serde::Deserialize;

use super::interface::Query;
use super::requests::{answering, blocking, reading};
use super::{ServerState, ValuesQuery};
use crate::server::caller::Caller;
use crate::server::error::ErrorResponse;
use crate::server::file_body::FileBody;
use crate::server::service::Service;
use crate::server::service::history::HistoryRequest;

/// The part of the OpenAPI document about these routes.
#[cfg(test)]
#[derive(utoipa::OpenApi)]
#[openapi(paths(events, history, incidents, incident, download))]
pub(super) struct RecordsDocument;

/// Creates the router of these routes.
pub(super) fn router() -> Router<ServerState> {
    Router::new()
        .route("/events", get(events))
        .route("/history", get(history))
        .route("/incidents", get(incidents).post(incident))
        .route("/incidents/{file}", get(download))
}

#[derive(Deserialize)]
struct EventsQuery {
    /// Position of an earlier answer.
    after: Option<String>,
    /// Maximum number of events.
    limit: Option<usize>,
}

/// Returns the newest events of the cell's log, or those after a position: ask with the `next` of the last answer to
/// follow the log.
#[cfg_attr(test, utoipa::path(get, path = "/events", operation_id = "listEvents", tag = "records",
    params(("after" = Option<String>, Query, description = "`next` of an earlier answer: only the events that follow"),
        ("limit" = Option<usize>, Query, description = "at most as many; the loader keeps the newest 4096")),
    responses((status = 200, body = EventPage), (status = 400, body = ErrorBody))))]
async fn events(
    State(state): State<ServerState>,
    Query(query): Query<EventsQuery>,
) -> Result<Response, ErrorResponse> {
    reading(state, move |service| {
        service.events(query.after.as_deref(), query.limit)
    })
    .await
}

#[derive(Deserialize)]
struct HistoryQuery {
    /// Patterns, separated by commas.
    #[serde(default)]
    ports: Option<String>,
    /// Position of an earlier answer.
    after: Option<String>,
    /// Only the last seconds.
    seconds: Option<f64>,
    /// Maximum number of values.
    limit: Option<usize>,
}

/// Returns values that nets have published with `Monitor`, each with its cycle: the newest ones, those of the last
/// seconds, or those after a position. Ask with the `next` of the last answer to follow them without a gap, at the full
/// rate of the monitors; `limit=0` gives the position of now. The loader keeps the newest 65536 records, also of
/// commands that have been unloaded.
#[cfg_attr(test, utoipa::path(get, path = "/history", operation_id = "getHistory", tag = "values",
    params(("ports" = Option<String>, Query,
            description = "patterns such as `line/move.pose,*/ik.joints[2]`; without, all monitored values"),
        ("after" = Option<String>, Query, description = "`next` of an earlier answer: only the values that follow"),
        ("seconds" = Option<f64>, Query, description = "only this long before the newest value"),
        ("limit" = Option<usize>, Query, description = "at most as many values, up to 10000; 1000 by default")),
    responses((status = 200, body = HistoryPage), (status = 400, body = ErrorBody))))]
async fn history(
    State(state): State<ServerState>,
    Query(query): Query<HistoryQuery>,
) -> Result<Response, ErrorResponse> {
    let ports = ValuesQuery { ports: query.ports };
    let request = HistoryRequest {
        ports: ports.patterns(),
        after: query.after,
        seconds: query.seconds,
        limit: query.limit,
    };
    reading(state, move |service| service.history(&request)).await
}

/// Lists the incident files, oldest first.
#[cfg_attr(test, utoipa::path(get, path = "/incidents", operation_id = "listIncidents", tag = "records",
    responses((status = 200, body = Vec<IncidentView>), (status = 500, body = ErrorBody))))]
async fn incidents(State(state): State<ServerState>) -> Result<Response, ErrorResponse> {
    reading(state, Service::incidents).await
}

/// Writes the last seconds of the flight recorder to a file.
#[cfg_attr(test, utoipa::path(post, path = "/incidents", operation_id = "recordIncident", tag = "records",
    responses((status = 200, body = WrittenIncident), (status = 409, body = ErrorBody), (status = 503, body = ErrorBody))))]
async fn incident(
    State(state): State<ServerState>,
    Extension(caller): Extension<Caller>,
) -> Result<Response, ErrorResponse> {
    answering(state, move |service| service.freeze(&caller)).await
}

/// Downloads an incident file. `range: bytes=N-` continues a download that was interrupted.
#[cfg_attr(test, utoipa::path(get, path = "/incidents/{file}", operation_id = "downloadIncident", tag = "records",
    params(("file" = String, Path, description = "name of the file: the last part of the path in the list")),
    responses((status = 200, description = "The file.", body = [u8], content_type = "application/octet-stream"),
        (status = 206, description = "The rest of the file.", body = [u8], content_type = "application/octet-stream"),
        (status = 400, body = ErrorBody), (status = 404, body = ErrorBody))))]
async fn download(
    State(state): State<ServerState>,
    Path(name): Path<String>,
    headers: HeaderMap,
) -> Result<Response, ErrorResponse> {
    let from = match headers.get(header::RANGE) {
        Some(range) => Some(first_byte(range.as_bytes()).ok_or_else(bad_range)?),
        None => None,
    };
    let (file, length) = blocking(state, move |service| {
        let (mut file, length) = service.open_incident(&name)?;
        let start = from.unwrap_or(0);
        if start > length || file.seek(SeekFrom::Start(start)).is_err() {
            return Err(bad_range());
        }
        Ok((file, length))
    })
    .await?;
    let start = from.unwrap_or(0);
    let body = Body::new(FileBody::new(file, length - start));
    let kind = (header::CONTENT_TYPE, "application/octet-stream".to_owned());
    Ok(match from {
        None => (StatusCode::OK, [kind], body).into_response(),
        Some(_) => {
            let last = length.saturating_sub(1);
            let part = (
                header::CONTENT_RANGE,
                format!("bytes {start}-{last}/{length}"),
            );
            (StatusCode::PARTIAL_CONTENT, [kind, part], body).into_response()
        }
    })
}

/// Parses `bytes=N-` (RFC 9110, section 14.1.2).
fn first_byte(range: &[u8]) -> Option<u64> {
    let text = std::str::from_utf8(range).ok()?;
    text.strip_prefix("bytes=")?.strip_suffix('-')?.parse().ok()
}

fn bad_range() -> ApiError {
    ApiError::new(
        codes::BAD_REQUEST,
        "the header `range` is not `bytes=N-` with an N inside the file",
        "omit the header to get the whole file",
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_range_goes_from_a_byte_to_the_end() {
        assert_eq!(first_byte(b"bytes=17-"), Some(17));
        for range in [
            "bytes=1-2",
            "bytes=-5",
            "bytes=1-,7-",
            "17-",
            "bytes=x-",
            "\u{fc}",
        ] {
            assert_eq!(first_byte(range.as_bytes()), None, "{range}");
        }
    }
}
