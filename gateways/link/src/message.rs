//! A value of a topic on the wire: JSON, so that any program of the network can read it. Pure.

use serde::{Deserialize, Serialize};
use serde_json::Value;

/// Version of the format; another one is refused.
pub const VERSION: u32 = 1;
/// Longest message, bytes: the largest topic is an array of 64 numbers.
pub const BYTES_MAX: usize = 8192;

/// The newest value of a topic.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TopicMessage {
    /// [`VERSION`].
    pub version: u32,
    /// One life of the sender, 16 hexadecimal digits: sequence and time begin again in the next one.
    pub sender: String,
    /// Number of the message of this topic, from 1 without gaps.
    pub sequence: u64,
    /// Monotonic clock of the sender when it sent this, ns; only differences have a meaning.
    pub sent_ns: u64,
    /// Age of the value at that time, ns.
    pub age_ns: u64,
    /// Type, such as `Real` or `Bool`.
    #[serde(rename = "type")]
    pub ty: String,
    /// Unit; none for types without one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// The value, SI; null is null.
    pub value: Value,
}

/// Why bytes are no message.
#[derive(Debug, thiserror::Error)]
pub enum MessageError {
    /// Longer than [`BYTES_MAX`].
    #[error("{0} bytes, the limit is {BYTES_MAX}")]
    TooLong(usize),
    /// Not JSON, or without a key.
    #[error("not a message: {0}")]
    Json(#[from] serde_json::Error),
    /// Another version.
    #[error("version {0} of the link, expected {VERSION}: use the same build on both sides")]
    Version(u32),
}

impl TopicMessage {
    /// Reads a message.
    ///
    /// # Errors
    /// Fails for everything else.
    pub fn read(bytes: &[u8]) -> Result<TopicMessage, MessageError> {
        if bytes.len() > BYTES_MAX {
            return Err(MessageError::TooLong(bytes.len()));
        }
        let message: TopicMessage = serde_json::from_slice(bytes)?;
        match message.version {
            VERSION => Ok(message),
            other => Err(MessageError::Version(other)),
        }
    }

    /// Returns the bytes of the message.
    ///
    /// # Errors
    /// Fails for a value that JSON does not have; a topic never has one.
    pub fn bytes(&self) -> Result<Vec<u8>, MessageError> {
        Ok(serde_json::to_vec(self)?)
    }

    /// Returns the type and unit, for example `Real in N`.
    #[must_use]
    pub fn kind(&self) -> String {
        kind(&self.ty, self.unit.as_deref())
    }
}

/// Returns type and unit in words.
#[must_use]
pub fn kind(ty: &str, unit: Option<&str>) -> String {
    match unit.filter(|unit| !unit.is_empty()) {
        None => ty.to_owned(),
        Some(unit) => format!("{ty} in {unit}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_is_read_as_it_was_written() {
        let message = TopicMessage {
            version: VERSION,
            sender: "00ff".to_owned(),
            sequence: 3,
            sent_ns: u64::MAX,
            age_ns: 7,
            ty: "Real".to_owned(),
            unit: Some("N".to_owned()),
            value: serde_json::json!(0.1),
        };
        let bytes = message.bytes().expect("bytes");
        assert_eq!(TopicMessage::read(&bytes).expect("a message"), message);
        assert_eq!(message.kind(), "Real in N");
    }

    #[test]
    fn whatever_else_arrives_is_refused() {
        let other = br#"{"version": 2, "sender": "a", "sequence": 1, "sent_ns": 1, "age_ns": 0, "type": "Bool", "value": true}"#;
        assert!(matches!(
            TopicMessage::read(other),
            Err(MessageError::Version(2))
        ));
        assert!(matches!(
            TopicMessage::read(&[b' '; BYTES_MAX + 1]),
            Err(MessageError::TooLong(_))
        ));
        for bytes in [&b""[..], b"{}", b"\xff\xfe", b"[1, 2]", b"null"] {
            assert!(
                matches!(TopicMessage::read(bytes), Err(MessageError::Json(_))),
                "{bytes:?}"
            );
        }
    }
}
