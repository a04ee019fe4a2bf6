//! WebSocket frames (RFC 6455, section 5) as the library sends them: its frames are not masked, and neither are ours.
//! Run by the threads of a connection.

use std::io::{self, Read};

/// Largest message of a client in bytes; the largest net that was seen has 105 kB.
pub const MESSAGE_MAX: usize = 4 << 20;

/// The answer to a client's `Sec-WebSocket-Key`. The library sends a constant key, the example of RFC 6455, section 1.3.
pub const CLIENT_KEY: &str = "dGhlIHNhbXBsZSBub25jZQ==";
/// The value of `Sec-WebSocket-Accept` for [`CLIENT_KEY`].
pub const ACCEPT: &str = "s3pPLMBiTxaQ9kYGzzhZRbK+xOo=";

const CONTINUATION: u8 = 0;
const TEXT: u8 = 1;
const BINARY: u8 = 2;
const CLOSE: u8 = 8;
const PING: u8 = 9;
const PONG: u8 = 10;

/// A message of a client.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ClientMessage {
    /// A text, whole.
    Text(String),
    /// A ping; its payload must be sent back.
    Ping(Vec<u8>),
    /// The client closes the connection.
    Close,
}

/// Why a connection cannot be read any further.
#[derive(Debug, thiserror::Error)]
pub enum FrameError {
    /// The connection is lost or was closed without a close frame.
    #[error("the connection ended: {0}")]
    Ended(#[from] io::Error),
    /// A message is too long.
    #[error("a message of {0} bytes, at most {MESSAGE_MAX} are read")]
    TooLong(u64),
    /// Not a frame of RFC 6455. The library counts characters for the length but sends bytes: a text with other than
    /// ASCII characters ends up here.
    #[error(
        "invalid frame ({0}); texts with other than ASCII characters break the library's framing"
    )]
    Invalid(&'static str),
}

/// Reads messages from a connection.
#[derive(Debug)]
pub struct MessageReader<R> {
    from: R,
    /// Payload of a fragmented message so far.
    begun: Option<Vec<u8>>,
}

struct Frame {
    is_final: bool,
    opcode: u8,
    payload: Vec<u8>,
}

impl<R: Read> MessageReader<R> {
    /// Reads from behind the head of the request.
    pub fn new(from: R) -> MessageReader<R> {
        MessageReader { from, begun: None }
    }

    /// Returns the next message; pongs are skipped.
    ///
    /// # Errors
    /// Returns an error if the connection ended or what comes is not a frame; nothing more can be read then.
    pub fn read(&mut self) -> Result<ClientMessage, FrameError> {
        loop {
            let frame = self.frame()?;
            let is_control = frame.opcode >= CLOSE;
            if is_control && (!frame.is_final || frame.payload.len() > 125) {
                return Err(FrameError::Invalid("a long or fragmented control frame"));
            }
            match frame.opcode {
                PING => return Ok(ClientMessage::Ping(frame.payload)),
                PONG => {}
                CLOSE => return Ok(ClientMessage::Close),
                TEXT if self.begun.is_none() => self.begun = Some(frame.payload),
                CONTINUATION if self.begun.is_some() => {
                    let begun = self.begun.get_or_insert_default();
                    begun.extend(frame.payload);
                    if begun.len() > MESSAGE_MAX {
                        return Err(FrameError::TooLong(begun.len() as u64));
                    }
                }
                BINARY => return Err(FrameError::Invalid("a binary frame")),
                _ => return Err(FrameError::Invalid("an unknown or misplaced opcode")),
            }
            if !is_control && frame.is_final {
                let text = String::from_utf8(self.begun.take().unwrap_or_default());
                return text
                    .map(ClientMessage::Text)
                    .map_err(|_| FrameError::Invalid("a text that is not UTF-8"));
            }
        }
    }

    fn frame(&mut self) -> Result<Frame, FrameError> {
        let [first, second] = self.bytes::<2>()?;
        if first & 0x70 != 0 {
            return Err(FrameError::Invalid("reserved bits"));
        }
        let length = match second & 0x7f {
            126 => u64::from(u16::from_be_bytes(self.bytes()?)),
            127 => u64::from_be_bytes(self.bytes()?),
            short => u64::from(short),
        };
        let count = usize::try_from(length)
            .ok()
            .filter(|count| *count <= MESSAGE_MAX);
        let count = count.ok_or(FrameError::TooLong(length))?;
        let mask = match second & 0x80 {
            0 => [0; 4],
            _ => self.bytes()?,
        };
        // Grows with what arrives: a length alone must not claim memory.
        let mut payload = Vec::new();
        let read = (&mut self.from).take(length).read_to_end(&mut payload)?;
        if read < count {
            return Err(FrameError::Ended(io::ErrorKind::UnexpectedEof.into()));
        }
        for (byte, mask) in payload.iter_mut().zip(mask.iter().cycle()) {
            *byte ^= mask;
        }
        Ok(Frame {
            is_final: first & 0x80 != 0,
            opcode: first & 0x0f,
            payload,
        })
    }

    fn bytes<const N: usize>(&mut self) -> Result<[u8; N], FrameError> {
        let mut bytes = [0; N];
        self.from.read_exact(&mut bytes)?;
        Ok(bytes)
    }
}

/// Returns a text as one frame: the library appends the payload of a fragment twice.
#[must_use]
pub fn text_frame(text: &str) -> Vec<u8> {
    frame(TEXT, text.as_bytes())
}

/// Returns the answer to a ping.
#[must_use]
pub fn pong_frame(payload: &[u8]) -> Vec<u8> {
    frame(PONG, payload)
}

/// Returns the answer to a close frame.
#[must_use]
pub fn close_frame() -> Vec<u8> {
    frame(CLOSE, &[])
}

fn frame(opcode: u8, payload: &[u8]) -> Vec<u8> {
    let mut frame = vec![0x80 | opcode];
    match payload.len() {
        short @ 0..=125 => frame.push(short as u8),
        medium @ 126..=0xffff => {
            frame.push(126);
            frame.extend((medium as u16).to_be_bytes());
        }
        long => {
            frame.push(127);
            frame.extend((long as u64).to_be_bytes());
        }
    }
    frame.extend_from_slice(payload);
    frame
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(bytes: &[u8]) -> Result<ClientMessage, FrameError> {
        MessageReader::new(bytes).read()
    }

    #[test]
    fn frames_of_every_length_are_read_without_a_mask() {
        for length in [0, 1, 125, 126, 127, 0xffff, 0x1_0000, 105_000] {
            let text = "x".repeat(length);
            let frame = text_frame(&text);
            assert_eq!(read(&frame).expect("a text"), ClientMessage::Text(text));
        }
    }

    #[test]
    fn a_masked_frame_is_read_too() {
        let mut frame = vec![0x81, 0x82, 1, 2, 3, 4];
        frame.extend([b'o' ^ 1, b'k' ^ 2]);
        assert_eq!(
            read(&frame).expect("a text"),
            ClientMessage::Text("ok".to_owned())
        );
    }

    #[test]
    fn a_ping_may_come_between_fragments() {
        let mut bytes = vec![0x01, 1, b'a'];
        bytes.extend(frame(PING, b"p7"));
        bytes.extend([0x80, 1, b'b']);
        let mut reader = MessageReader::new(&*bytes);
        assert_eq!(
            reader.read().expect("a ping"),
            ClientMessage::Ping(b"p7".to_vec())
        );
        assert_eq!(
            reader.read().expect("a text"),
            ClientMessage::Text("ab".to_owned())
        );
        assert!(matches!(reader.read(), Err(FrameError::Ended(_))));
    }

    #[test]
    fn what_is_no_frame_is_refused() {
        let too_long = [0x81, 127, 0, 0, 0, 1, 0, 0, 0, 0];
        assert!(matches!(read(&too_long), Err(FrameError::TooLong(_))));
        for bytes in [
            &[0xf1, 0][..],
            &[0x82, 0],
            &[0x80, 0],
            &[0x09, 0],
            &[0x81, 1, 0xff],
        ] {
            assert!(
                matches!(read(bytes), Err(FrameError::Invalid(_))),
                "{bytes:?}"
            );
        }
        assert!(matches!(read(&[0x81, 5, b'a']), Err(FrameError::Ended(_))));
    }
}
