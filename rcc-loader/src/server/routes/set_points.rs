//! The route of set-point channels: a request whose body is lines of input values, sent while they arise, and whose
//! answer is lines about them. Run by the serving thread, which copies lines and parses nothing.

use std::sync::Arc;
use std::time::Duration;

use axum::body::{Body, Bytes};
use axum::extract::{Extension, Path, State};
use axum::response::Response;
use http_body_util::BodyExt;
#[cfg(test)]
use rcc_api::bodies::ErrorBody;
use rcc_api::codes;
use rcc_api::error::ApiError;
#[cfg(test)]
use rcc_api::streams::ChannelEnd;
use serde::Deserialize;

use super::ServerState;
use super::interface::Query;
use super::requests::{blocking, too_many_streams};
use crate::server::bodies::SET_TEXT_MAX;
use crate::server::error::ErrorResponse;
use crate::server::live;
use crate::server::peer::ClientPeer;
use crate::server::quota::QuotaLimits;
use crate::server::service::LineQueue;

/// Limits of set-point channels; each may use one of the eight requests that the executor takes in a cycle.
pub const CHANNELS: QuotaLimits = QuotaLimits {
    all: 4,
    of_peer: 3,
    reserve: 2,
    small: 1,
};
/// Time after which a channel without a line is closed.
pub const CHANNEL_IDLE_MAX: Duration = Duration::from_secs(60);

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ChannelQuery {
    /// The sets of values that are answered.
    #[serde(default)]
    answers: AnswerKind,
}

#[derive(Clone, Copy, Default, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
enum AnswerKind {
    #[default]
    Errors,
    All,
}

/// Set-point channel: sets inputs of a ready or active net at up to the rate of the cell, over one connection. Each line
/// of the body is a mapping from inputs to values, as for `PUT /commands/{name}/inputs`; the newest value of each input
/// takes effect in the next cycle, and older ones that no cycle has seen are superseded. Send the body in chunks
/// (`transfer-encoding: chunked`), and end it to close the channel. The answer begins at once and has lines of JSON:
/// `{id, net}` first, `{line, error}` for each line that was refused, and at last what became of all lines.
#[cfg_attr(test, utoipa::path(post, path = "/commands/{name}/inputs/stream", operation_id = "openSetPointChannel", tag = "values",
    params(("name" = String, Path, description = "id or name"),
        ("answers" = Option<String>, Query,
            description = "`errors` (default), or `all`: also `{line, cycle}` for each set of values that took effect")),
    request_body(content = String, content_type = "application/x-ndjson",
        description = "lines such as `{\"speed\": 0.2, \"lamp\": true}`"),
    responses(
        (status = 200, description = "lines of JSON; the last one as shown", body = ChannelEnd,
            content_type = "application/x-ndjson"),
        (status = 404, description = "no such command", body = ErrorBody),
        (status = 409, description = "the command takes no values", body = ErrorBody),
        (status = 429, description = "too many channels", body = ErrorBody))))]
pub(super) async fn set_points(
    State(state): State<ServerState>,
    Path(name): Path<String>,
    Query(query): Query<ChannelQuery>,
    Extension(peer): Extension<ClientPeer>,
    body: Body,
) -> Result<Response, ErrorResponse> {
    let place = state.channels.take(peer, 1);
    let place = place.ok_or_else(|| too_many_streams(CHANNELS, "set-point channels"))?;
    let opened = move |service: &crate::server::service::Service| service.open_channel(&name);
    let channel = blocking(state.clone(), opened).await?;
    let (client, response) = live::answer("application/x-ndjson", place);
    let lines = Arc::new(LineQueue::default());
    let taken = Arc::clone(&lines);
    let tells_all = query.answers == AnswerKind::All;
    // It ends when the body ends, at the latest when the connection does.
    tokio::task::spawn_blocking(move || {
        channel.serve(&state.service, &taken, client, tells_all);
    });
    tokio::spawn(read_lines(body, ClosingQueue(lines)));
    Ok(response)
}

/// Closes the queue when it is dropped, however the reading ends.
struct ClosingQueue(Arc<LineQueue>);

impl Drop for ClosingQueue {
    fn drop(&mut self) {
        self.0.close();
    }
}

/// Reads the body until it ends, the command takes no more values, a line is too long, or no line has come for too
/// long.
async fn read_lines(mut body: Body, lines: ClosingQueue) {
    let lines = &lines.0;
    let mut begun = Vec::new();
    loop {
        let frame = tokio::select! {
            frame = tokio::time::timeout(CHANNEL_IDLE_MAX, body.frame()) => frame,
            () = lines.closed() => return,
        };
        let bytes = match frame {
            Ok(Some(Ok(frame))) => frame.into_data().unwrap_or_default(),
            Ok(None) => {
                push(lines, begun);
                return;
            }
            // The client is gone.
            Ok(Some(Err(_))) => return,
            Err(_) => return lines.fail(idle()),
        };
        let mut parts = bytes.split(|byte| *byte == b'\n');
        begun.extend_from_slice(parts.next().unwrap_or_default());
        for part in parts {
            if !push(lines, std::mem::replace(&mut begun, part.to_vec())) {
                return;
            }
        }
        if begun.len() > SET_TEXT_MAX {
            return lines.fail(too_long());
        }
    }
}

/// Adds a line; returns false if it is too long, which ends the channel: nothing after it may take effect.
fn push(lines: &LineQueue, line: Vec<u8>) -> bool {
    if line.len() > SET_TEXT_MAX {
        lines.fail(too_long());
        return false;
    }
    if !line.trim_ascii().is_empty() {
        lines.push(Bytes::from(line));
    }
    true
}

fn too_long() -> ApiError {
    ApiError::new(
        codes::TOO_LARGE,
        format!("the line is too long: the maximum is {SET_TEXT_MAX} bytes"),
        "end each set of values with a line feed",
    )
}

fn idle() -> ApiError {
    ApiError::new(
        codes::TOO_SLOW,
        format!("no line came for {CHANNEL_IDLE_MAX:?}"),
        "open the channel again when there are values",
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the lines that a channel takes from a body.
    fn taken(body: Vec<u8>) -> Vec<Vec<u8>> {
        let lines = Arc::new(LineQueue::default());
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_time()
            .build();
        let reading = read_lines(Body::from(body), ClosingQueue(Arc::clone(&lines)));
        runtime.expect("a runtime").block_on(reading);
        lines.lines()
    }

    #[test]
    fn nothing_after_a_line_that_is_too_long_takes_effect() {
        let set = b"{\"speed\":0.2}\n";
        assert_eq!(taken(set.to_vec()), [b"{\"speed\":0.2}"]);
        let mut body = vec![b'x'; 70_000];
        body.push(b'\n');
        body.extend(set);
        assert!(taken(body).is_empty());
    }
}
