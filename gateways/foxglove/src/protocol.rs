//! The messages of the Foxglove WebSocket protocol, `foxglove.websocket.v1`
//! (<https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md>), as far as a cell needs them: JSON texts with the
//! field `op`, and binary frames, little-endian, that begin with a byte for the kind. Pure.

use serde::Deserialize;
use serde_json::{Value, json};
use tokio_tungstenite::tungstenite::{Bytes, Message};

/// Kind of a binary frame with the message of a channel.
const MESSAGE_DATA: u8 = 1;
/// Kind of a binary frame with the answer of a service.
const SERVICE_RESPONSE: u8 = 3;
/// Kind of a client's binary frame with the request to a service.
const SERVICE_REQUEST: u8 = 2;
/// The encoding of requests to services, and of their answers.
pub const JSON: &str = "json";

/// A client's request in text.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(tag = "op", rename_all = "camelCase", rename_all_fields = "camelCase")]
pub enum Request {
    /// Subscribes to channels.
    Subscribe {
        /// Subscriptions.
        subscriptions: Vec<Subscription>,
    },
    /// Ends subscriptions.
    Unsubscribe {
        /// Their ids.
        subscription_ids: Vec<u32>,
    },
    /// Asks for parameters.
    GetParameters {
        /// Their names; all if it is empty.
        parameter_names: Vec<String>,
        /// Returned with the answer.
        #[serde(default)]
        id: Option<String>,
    },
    /// Sets parameters.
    SetParameters {
        /// Names and values.
        parameters: Vec<Parameter>,
        /// Returned with the answer, which is sent only if there is an id.
        #[serde(default)]
        id: Option<String>,
    },
    /// Asks to be told changes of parameters.
    SubscribeParameterUpdates {
        /// Their names.
        parameter_names: Vec<String>,
    },
    /// Ends that.
    UnsubscribeParameterUpdates {
        /// Their names.
        parameter_names: Vec<String>,
    },
    /// An operation that this server does not offer.
    #[serde(other)]
    Unknown,
}

/// A subscription of a client.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Subscription {
    /// Id that the client has chosen; the messages carry it.
    pub id: u32,
    /// Channel.
    pub channel_id: u32,
}

/// A parameter.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Parameter {
    /// Name.
    pub name: String,
    /// Value; a parameter without a value does not exist.
    #[serde(default)]
    pub value: Option<Value>,
    /// `float64` or `float64_array`, for numbers that JSON may take for integers.
    #[serde(default, rename = "type")]
    pub ty: Option<String>,
}

impl Parameter {
    fn json(&self) -> Value {
        let mut row = json!({"name": self.name});
        if let Some(value) = &self.value {
            row["value"] = value.clone();
        }
        if let Some(ty) = &self.ty {
            row["type"] = ty.as_str().into();
        }
        row
    }
}

/// The request of a client to a service.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ServiceCall {
    /// The service.
    pub service: u32,
    /// Id that the client has chosen; the answer carries it.
    pub call: u32,
    /// Encoding of the request.
    pub encoding: String,
    /// The request.
    pub payload: Vec<u8>,
}

impl ServiceCall {
    /// Reads a binary frame of a client; `None` if it is not the request to a service.
    #[must_use]
    pub fn read(frame: &[u8]) -> Option<ServiceCall> {
        let rest = frame.strip_prefix(&[SERVICE_REQUEST])?;
        let (service, rest) = number(rest)?;
        let (call, rest) = number(rest)?;
        let (length, rest) = number(rest)?;
        let (encoding, payload) = rest.split_at_checked(usize::try_from(length).ok()?)?;
        Some(ServiceCall {
            service,
            call,
            encoding: String::from_utf8(encoding.to_vec()).ok()?,
            payload: payload.to_vec(),
        })
    }
}

fn number(bytes: &[u8]) -> Option<(u32, &[u8])> {
    let (first, rest) = bytes.split_first_chunk()?;
    Some((u32::from_le_bytes(*first), rest))
}

/// A channel as it is announced.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Announcement<'a> {
    /// Id.
    pub id: u32,
    /// Topic.
    pub topic: &'a str,
    /// Name of its type.
    pub schema_name: &'a str,
    /// The type, `ros2msg`.
    pub schema: &'a str,
}

/// Level of a status.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StatusLevel {
    /// Worth a look.
    Warning = 1,
    /// Something was not done.
    Error = 2,
}

fn text(value: &Value) -> Message {
    Message::text(value.to_string())
}

/// The server's first message.
#[must_use]
pub fn server_info(name: &str, capabilities: &[&str], session: &str, version: &str) -> Message {
    text(&json!({
        "op": "serverInfo", "name": name, "capabilities": capabilities, "supportedEncodings": [JSON],
        "metadata": {"rcc": version}, "sessionId": session,
    }))
}

/// Announces channels.
#[must_use]
pub fn advertise<'a>(channels: impl Iterator<Item = Announcement<'a>>) -> Message {
    let rows = channels.map(|one| {
        json!({
            "id": one.id, "topic": one.topic, "encoding": "cdr", "schemaName": one.schema_name,
            "schema": one.schema, "schemaEncoding": "ros2msg",
        })
    });
    text(&json!({"op": "advertise", "channels": rows.collect::<Value>()}))
}

/// Takes channels back.
#[must_use]
pub fn unadvertise(ids: &[u32]) -> Message {
    text(&json!({"op": "unadvertise", "channelIds": ids}))
}

/// Announces services: id, name, type, schemas of request and answer.
#[must_use]
pub fn advertise_services<'a>(
    services: impl Iterator<Item = (u32, &'a str, &'a str, Value, Value)>,
) -> Message {
    let side = |name: String, schema: &Value| json!({"encoding": JSON, "schemaName": name, "schemaEncoding": "jsonschema", "schema": schema.to_string()});
    let rows = services.map(|(id, name, ty, request, response)| {
        json!({
            "id": id, "name": name, "type": ty,
            "request": side(format!("{ty}_Request"), &request),
            "response": side(format!("{ty}_Response"), &response),
        })
    });
    text(&json!({"op": "advertiseServices", "services": rows.collect::<Value>()}))
}

/// Tells something to the person who looks. A later status with the same id replaces it.
#[must_use]
pub fn status(level: StatusLevel, id: Option<&str>, message: &str) -> Message {
    let mut status = json!({"op": "status", "level": level as u8, "message": message});
    if let Some(id) = id {
        status["id"] = id.into();
    }
    text(&status)
}

/// Takes a status back.
#[must_use]
pub fn remove_status(id: &str) -> Message {
    text(&json!({"op": "removeStatus", "statusIds": [id]}))
}

/// Tells values of parameters; those without a value do not exist any more.
#[must_use]
pub fn parameter_values<'a>(
    parameters: impl Iterator<Item = &'a Parameter>,
    id: Option<&str>,
) -> Message {
    let rows: Value = parameters.map(Parameter::json).collect();
    let mut values = json!({"op": "parameterValues", "parameters": rows});
    if let Some(id) = id {
        values["id"] = id.into();
    }
    text(&values)
}

/// The answer of a service.
#[must_use]
pub fn service_response(call: &ServiceCall, answer: &Value) -> Message {
    let answer = answer.to_string();
    let mut frame = vec![SERVICE_RESPONSE];
    frame.extend(call.service.to_le_bytes());
    frame.extend(call.call.to_le_bytes());
    frame.extend((JSON.len() as u32).to_le_bytes());
    frame.extend(JSON.as_bytes());
    frame.extend(answer.as_bytes());
    Message::binary(frame)
}

/// Says why a service has not done what it was asked for.
#[must_use]
pub fn service_failure(call: &ServiceCall, message: &str) -> Message {
    text(&json!({
        "op": "serviceCallFailure", "serviceId": call.service, "callId": call.call, "message": message,
    }))
}

/// The message of a channel, for one subscription; its time is ns since 1970.
#[must_use]
pub fn message_data(subscription: u32, time_ns: u64, message: &[u8]) -> Bytes {
    let mut frame = Vec::with_capacity(13 + message.len());
    frame.push(MESSAGE_DATA);
    frame.extend(subscription.to_le_bytes());
    frame.extend(time_ns.to_le_bytes());
    frame.extend(message);
    frame.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_of_viewers_are_read_and_unknown_ones_are_named_so() {
        let read = |text: &str| serde_json::from_str::<Request>(text).ok();
        let subscriptions = vec![Subscription {
            id: 0,
            channel_id: 3,
        }];
        assert_eq!(
            read(r#"{"op": "subscribe", "subscriptions": [{"id": 0, "channelId": 3}]}"#),
            Some(Request::Subscribe { subscriptions })
        );
        let set = r#"{"op": "setParameters", "parameters": [{"name": "belt/speed", "value": 0.2, "type": "float64"}], "id": "7"}"#;
        let parameter = Parameter {
            name: "belt/speed".into(),
            value: Some(json!(0.2)),
            ty: Some("float64".into()),
        };
        assert_eq!(
            read(set),
            Some(Request::SetParameters {
                parameters: vec![parameter],
                id: Some("7".into())
            })
        );
        assert_eq!(
            read(r#"{"op": "fetchAsset", "uri": "x"}"#),
            Some(Request::Unknown)
        );
        assert_eq!(read(r#"{"op": "subscribe"}"#), None);
    }

    #[test]
    fn a_request_to_a_service_of_any_length_is_read_or_refused() {
        let mut frame = vec![SERVICE_REQUEST];
        for number in [4_u32, 9, 4] {
            frame.extend(number.to_le_bytes());
        }
        frame.extend(b"json{}");
        let call = ServiceCall {
            service: 4,
            call: 9,
            encoding: "json".into(),
            payload: b"{}".to_vec(),
        };
        assert_eq!(ServiceCall::read(&frame), Some(call));
        for length in 0..17 {
            assert_eq!(ServiceCall::read(&frame[..length]), None, "{length}");
        }
        frame[9..13].copy_from_slice(&u32::MAX.to_le_bytes());
        assert_eq!(ServiceCall::read(&frame), None);
    }

    #[test]
    fn the_message_of_a_channel_has_its_subscription_and_its_time_before_it() {
        let frame = message_data(0x0102, 0x0304, b"cdr");
        assert_eq!(&*frame, b"\x01\x02\x01\0\0\x04\x03\0\0\0\0\0\0cdr");
    }
}
