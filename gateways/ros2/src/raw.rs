//! Messages that are encoded already: `rcc-recording` writes the same CDR as recordings have. Pure.

use serde::ser::{Serialize, SerializeTuple, Serializer};

/// Bytes before the fields of a CDR message: the encapsulation header, which the DDS writer adds itself.
const HEADER: usize = 4;

/// The fields of one message in little-endian CDR.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RawMessage(Vec<u8>);

impl RawMessage {
    /// Takes a message with its encapsulation header, as `CdrWriter` makes it.
    #[must_use]
    pub fn of(message: &[u8]) -> RawMessage {
        RawMessage(message.get(HEADER..).unwrap_or_default().to_vec())
    }
}

/// A tuple has no length in CDR, and a byte no alignment, so the bytes go out as they are.
impl Serialize for RawMessage {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut tuple = serializer.serialize_tuple(self.0.len())?;
        for byte in &self.0 {
            tuple.serialize_element(byte)?;
        }
        tuple.end()
    }
}

#[cfg(test)]
mod tests {
    use rcc_recording::cdr::CdrWriter;
    use ros2_client::dds::rustdds::cdr_encoding::to_vec;

    use super::*;

    #[test]
    fn the_bytes_of_a_message_go_out_as_they_are() {
        let mut out = CdrWriter::new();
        out.string("ab");
        out.f64(1.5);
        let raw = RawMessage::of(out.bytes());
        let sent = to_vec::<_, byteorder::LittleEndian>(&raw).expect("it is encoded");
        assert_eq!(sent, &out.bytes()[HEADER..]);
        // As the encoder writes the same fields.
        let fields = to_vec::<_, byteorder::LittleEndian>(&("ab", 1.5)).expect("it is encoded");
        assert_eq!(sent, fields);
    }
}
