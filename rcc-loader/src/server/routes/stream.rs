//! The route of streams: values, states and events as server-sent events, for as long as the client reads. Run by the
//! serving thread.

use axum::extract::{Extension, State};
use axum::response::Response;
#[cfg(test)]
use rcc_api::{bodies::ErrorBody, streams::StreamValues};
use serde::Deserialize;

use super::interface::Query;
use super::requests::{blocking, too_many_streams};
use super::{ServerState, ValuesQuery};
use crate::server::error::ErrorResponse;
use crate::server::live;
use crate::server::peer::ClientPeer;
use crate::server::quota::QuotaLimits;
use crate::server::service::{Service, StreamRequest, USUAL_RATE_MAX};

/// Limits of streams.
pub const STREAMS: QuotaLimits = QuotaLimits {
    all: 8,
    of_peer: 6,
    reserve: 4,
    small: 1,
};
/// Limits of streams that sample faster than [`USUAL_RATE_MAX`]: each may use a request to the executor in every cycle.
pub const FAST_STREAMS: QuotaLimits = QuotaLimits {
    all: 2,
    of_peer: 1,
    reserve: 0,
    small: 0,
};
/// Rate of a stream that names none, samples per second.
const RATE_DEFAULT: f64 = 10.0;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct StreamQuery {
    /// Patterns, separated by commas.
    #[serde(default)]
    ports: Option<String>,
    #[serde(default)]
    rate: Option<f64>,
    #[serde(default)]
    monitors: Option<String>,
    #[serde(default)]
    states: bool,
    #[serde(default)]
    events: bool,
}

/// Stream: values of ports of up to eight nets at a rate, changes of states, and events, as server-sent events over one
/// connection: `ports` (types and units, before the first values of a command), `values` (as shown), `state`, `event`,
/// `monitored` (every value of the nets' `Monitor`s, in batches), and `lost` (how many samples, events and records the
/// client was too slow for). A name stands for the newest command of that
/// name, also for one that is loaded later; `#7` and `line#7` stand for one command, and a stream of nothing but such ports
/// ends with `end` when all of these commands have ended. A net is sent only if it was evaluated since the last sample.
#[cfg_attr(test, utoipa::path(get, path = "/stream", operation_id = "openStream", tag = "values",
    params(("ports" = Option<String>, Query, description = "patterns such as `belt/soft.out,line/ik.*`"),
        ("rate" = Option<f64>, Query, description = "samples per second, 0.1 to the rate of the cell; 10 by default; two clients at a time may ask for more than 250. States and values of monitors are looked at 50 times a second, or at this rate up to 250 if it is higher"),
        ("monitors" = Option<String>, Query,
            description = "patterns of ports that a `Monitor` observes, such as `line/*`: every value at its rate"),
        ("states" = Option<bool>, Query, description = "also the state of each command, now and at each change"),
        ("events" = Option<bool>, Query, description = "also the events of the event log from now on")),
    responses(
        (status = 200, description = "server-sent events; the data of `values` as shown", body = StreamValues,
            content_type = "text/event-stream"),
        (status = 400, description = "no subject, or no possible rate", body = ErrorBody),
        (status = 404, description = "no such net or port", body = ErrorBody),
        (status = 429, description = "too many streams", body = ErrorBody))))]
pub(super) async fn stream(
    State(state): State<ServerState>,
    Query(query): Query<StreamQuery>,
    Extension(peer): Extension<ClientPeer>,
) -> Result<Response, ErrorResponse> {
    let place = state.streams.take(peer, 1);
    let place = place.ok_or_else(|| too_many_streams(STREAMS, "streams"))?;
    let ports = ValuesQuery { ports: query.ports };
    let monitors = ValuesQuery {
        ports: query.monitors,
    };
    let request = StreamRequest {
        ports: ports.patterns(),
        rate: query.rate.unwrap_or(RATE_DEFAULT),
        monitors: monitors.patterns(),
        states: query.states,
        events: query.events,
    };
    let is_fast = request.rate > USUAL_RATE_MAX && !request.ports.is_empty();
    let fast = is_fast.then(|| {
        let place = state.fast_streams.take(peer, 1);
        place.ok_or_else(|| too_many_streams(FAST_STREAMS, "streams above 250 samples per second"))
    });
    let fast = fast.transpose()?;
    let opened = move |service: &Service| service.open_stream(&request);
    let stream = blocking(state.clone(), opened).await?;
    let (client, response) = live::answer("text/event-stream", place);
    // It ends when the connection does, or when nothing can follow.
    tokio::task::spawn_blocking(move || {
        stream.serve(&state.service, client);
        drop(fast);
    });
    Ok(response)
}
