//! LOAD, START and CANCEL as services of the protocol, for `--control`. Each call blocks a thread of its own until the
//! loader has answered.

use std::time::Duration;

use rcc_api::bodies::{CommandView, Done};
use rcc_client::{Cell, ClientError, LoaderClient, RequestError, segment};
use serde::Deserialize;
use serde_json::{Value, json};

use crate::protocol::{JSON, ServiceCall};

/// Time limit of a request to the loader.
pub const TIMEOUT: Duration = Duration::from_secs(5);

/// A service.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Service {
    /// Loads a net.
    Load,
    /// Starts a loaded net.
    Start,
    /// Cancels a running net.
    Cancel,
}

/// Every service, by its id in the protocol.
pub const SERVICES: [Service; 3] = [Service::Load, Service::Start, Service::Cancel];

/// Why a call has failed.
#[derive(Debug, thiserror::Error)]
pub enum CallError {
    /// There is no such service, or it was not offered.
    #[error("no such service: LOAD, START and CANCEL are offered by `rcc-foxglove --control` only")]
    Unknown,
    /// The request has another encoding.
    #[error("requests in `{0}` are not understood: send JSON")]
    Encoding(String),
    /// The request is not what the service needs.
    #[error("the request is not understood ({0}): send {1}")]
    Request(serde_json::Error, Value),
    /// The loader refuses.
    #[error(transparent)]
    Refused(#[from] RequestError),
    /// The net has errors, or the loader does not answer.
    #[error(transparent)]
    Client(#[from] ClientError),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct LoadRequest {
    text: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct NetRequest {
    net: String,
}

/// A JSON Schema of an object with these fields.
fn schema(fields: &[(&str, &str)]) -> Value {
    let properties = fields.iter().map(|(name, ty)| {
        let of = json!({"type": ty});
        ((*name).to_owned(), of)
    });
    let properties: serde_json::Map<String, Value> = properties.collect();
    let required: Vec<&str> = fields.iter().map(|(name, _)| *name).collect();
    json!({"type": "object", "properties": properties, "required": required})
}

impl Service {
    /// Returns the service with this id.
    ///
    /// # Errors
    /// Fails if there is none.
    pub fn of(id: u32) -> Result<Service, CallError> {
        let found = SERVICES.get(id as usize);
        found.copied().ok_or(CallError::Unknown)
    }

    /// Returns its row for the announcement: id, name, type, schemas of request and answer.
    #[must_use]
    pub fn row(self) -> (u32, &'static str, &'static str, Value, Value) {
        let done = schema(&[("net", "string"), ("id", "integer"), ("cycle", "integer")]);
        let net = schema(&[("net", "string")]);
        match self {
            Service::Load => {
                let loaded = schema(&[("net", "string"), ("id", "integer")]);
                (
                    0,
                    "/rcc/load",
                    "rcc/Load",
                    schema(&[("text", "string")]),
                    loaded,
                )
            }
            Service::Start => (1, "/rcc/start", "rcc/Start", net, done),
            Service::Cancel => (2, "/rcc/cancel", "rcc/Cancel", net, done),
        }
    }

    /// Carries out a call at the loader of a cell.
    ///
    /// # Errors
    /// Fails if the request is not understood, or the loader refuses it.
    pub fn call(self, cell: &str, call: &ServiceCall) -> Result<Value, CallError> {
        if call.encoding != JSON {
            return Err(CallError::Encoding(call.encoding.clone()));
        }
        let (.., wanted, _) = self.row();
        match self {
            Service::Load => {
                let request: LoadRequest = read(call, &wanted)?;
                let cell = Cell::local(cell)?;
                let view: CommandView = cell.load(&request.text)?.state()?;
                Ok(json!({"net": view.net, "id": view.id}))
            }
            Service::Start => operate(cell, &read(call, &wanted)?, "start"),
            Service::Cancel => operate(cell, &read(call, &wanted)?, "cancel"),
        }
    }
}

fn read<'a, T: Deserialize<'a>>(call: &'a ServiceCall, wanted: &Value) -> Result<T, CallError> {
    serde_json::from_slice(&call.payload)
        .map_err(|error| CallError::Request(error, wanted["properties"].clone()))
}

/// Sends an operation on the net of this name, `net#id` or id. Nothing is asked before: CANCEL must not wait.
fn operate(cell: &str, request: &NetRequest, operation: &str) -> Result<Value, CallError> {
    let client = loader(cell)?;
    let path = format!("/commands/{}/{operation}", segment(&request.net));
    let done: Done = client.post(&path, String::new())?;
    Ok(json!({"net": done.net, "id": done.id, "cycle": done.cycle}))
}

/// Returns a client of the loader of a cell, which need not run.
///
/// # Errors
/// Fails if the system refuses an event queue.
pub fn loader(cell: &str) -> Result<LoaderClient, RequestError> {
    LoaderClient::local(cell, TIMEOUT)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn call(encoding: &str, payload: &str) -> ServiceCall {
        ServiceCall {
            service: 0,
            call: 1,
            encoding: encoding.into(),
            payload: payload.into(),
        }
    }

    #[test]
    fn the_id_of_each_service_is_its_place() {
        for (place, service) in SERVICES.into_iter().enumerate() {
            assert_eq!(service.row().0 as usize, place);
            assert_eq!(Service::of(place as u32).ok(), Some(service));
        }
        assert!(matches!(Service::of(3), Err(CallError::Unknown)));
    }

    #[test]
    fn a_request_that_is_not_understood_is_refused_before_the_loader_is_asked() {
        let cell = "no-such-cell";
        for (encoding, payload) in [
            ("cdr", "{}"),
            ("json", ""),
            ("json", "{}"),
            ("json", r#"{"net": 3}"#),
            ("json", r#"{"net": "line", "force": true}"#),
        ] {
            let refused = Service::Start.call(cell, &call(encoding, payload));
            let is_refused = matches!(
                refused,
                Err(CallError::Encoding(_) | CallError::Request(..))
            );
            assert!(is_refused, "{encoding} {payload}: {refused:?}");
        }
        let valid = call("json", r#"{"net": "line"}"#);
        let unreachable = Service::Cancel.call(cell, &valid);
        assert!(matches!(unreachable, Err(CallError::Refused(_))));
    }
}
