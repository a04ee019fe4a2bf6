//! Messages and plans as bytes. Run by any thread that may allocate; never a file format.
//!
//! **Replacing the encoder.** This module alone names bincode (2.0.1, which nobody maintains any more). Messages know only
//! serde's traits, so another encoder with serde support (`postcard`, `wincode`) takes its place by other bodies of
//! `to_bytes` and `from_bytes` below, another line in the two `Cargo.toml`, and the corpora `fuzz/corpus/{door,wire}` made
//! anew. No file holds such bytes, and loader and executor of one cell are of one build: nothing has to be converted.
//!
//! **What may come in.** Anything: the bytes are another process' word. A message is refused when it is longer than its
//! type allows, before a byte of it is looked at; when it claims more than its bytes can hold, before that is allocated;
//! and when it ends early or late. Decoding takes memory and time in proportion to the bytes that came
//! (`tests/wire.rs` measures the memory). Depth needs no bound of its own, because no message type contains itself.

use serde::Serialize;
use serde::de::DeserializeOwned;

/// What loader and executor send each other.
///
/// An implementation promises that its type does not contain itself (no `Box<Self>`), and that every element of its lists
/// takes at least one byte (no list of units): the number of elements is then bounded by the length of the message.
pub trait Message: Serialize + DeserializeOwned {
    /// Longest encoded message, bytes.
    const BYTES_MAX: usize;
}

/// Why a value could not be written as bytes.
#[derive(Debug, thiserror::Error)]
#[error("this value cannot be encoded: {0}")]
pub struct EncodeError(#[from] bincode::error::EncodeError);

/// Why bytes are not the expected message.
#[derive(Debug, thiserror::Error)]
pub enum DecodeError {
    /// Longer than any message of the type.
    #[error("{size} bytes are no message of at most {max}; are both programs of the same build?")]
    TooLong {
        /// Bytes received.
        size: usize,
        /// [`Message::BYTES_MAX`].
        max: usize,
    },
    /// The bytes end early, claim more than they hold, or hold a value that the type does not have.
    #[error(
        "{size} bytes are not the expected message: {cause}; are both programs of the same build?"
    )]
    Malformed {
        /// Bytes received.
        size: usize,
        /// What the decoder stumbled over.
        cause: bincode::error::DecodeError,
    },
    /// A whole message, and then more.
    #[error("the message ends after {used} of {size} bytes; are both programs of the same build?")]
    TrailingBytes {
        /// Bytes the message took.
        used: usize,
        /// Bytes received.
        size: usize,
    },
}

/// The bytes of `value`. Whoever sends them says when they are too many.
///
/// # Errors
/// When the type itself refuses to be encoded (none of ours does).
pub fn encode<T: Message>(value: &T) -> Result<Vec<u8>, EncodeError> {
    Ok(to_bytes(value)?)
}

/// The value that `bytes` hold, all of them.
///
/// # Errors
/// Anything that is not exactly one encoded `T` of at most [`Message::BYTES_MAX`] bytes.
pub fn decode<T: Message>(bytes: &[u8]) -> Result<T, DecodeError> {
    let (size, max) = (bytes.len(), T::BYTES_MAX);
    if size > max {
        return Err(DecodeError::TooLong { size, max });
    }
    match from_bytes(bytes) {
        Ok((value, used)) if used == size => Ok(value),
        Ok((_, used)) => Err(DecodeError::TrailingBytes { used, size }),
        Err(cause) => Err(DecodeError::Malformed { size, cause }),
    }
}

fn to_bytes<T: Serialize>(value: &T) -> Result<Vec<u8>, bincode::error::EncodeError> {
    bincode::serde::encode_to_vec(value, bincode::config::standard())
}

/// What `bytes` begin with, as [`decode`]; what follows is not looked at.
///
/// # Errors
/// They do not begin with an encoded `T`.
pub fn decode_beginning<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, DecodeError> {
    match from_bytes(bytes) {
        Ok((value, _)) => Ok(value),
        Err(cause) => Err(DecodeError::Malformed {
            size: bytes.len(),
            cause,
        }),
    }
}

/// A number of one byte counts up to sixteen times of it, so a message may claim sixteen times its length and not more:
/// otherwise a text of nine bytes could claim, and have allocated, as much as the longest message holds. bincode takes its
/// limit as a constant, hence the steps.
fn from_bytes<T: DeserializeOwned>(
    bytes: &[u8],
) -> Result<(T, usize), bincode::error::DecodeError> {
    const SMALL: usize = 16 << 10;
    const MIDDLE: usize = 256 << 10;
    const LARGE: usize = 4 << 20;
    let standard = bincode::config::standard();
    if bytes.len() <= SMALL {
        let limited = standard.with_limit::<{ 16 * SMALL }>();
        bincode::serde::decode_from_slice(bytes, limited)
    } else if bytes.len() <= MIDDLE {
        let limited = standard.with_limit::<{ 16 * MIDDLE }>();
        bincode::serde::decode_from_slice(bytes, limited)
    } else {
        let limited = standard.with_limit::<{ 16 * LARGE }>();
        bincode::serde::decode_from_slice(bytes, limited)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    type Sample = (u32, Vec<f64>, Option<String>);

    impl Message for Sample {
        const BYTES_MAX: usize = 64;
    }

    impl Message for String {
        const BYTES_MAX: usize = 1 << 20;
    }

    fn sample() -> Sample {
        (
            7,
            vec![1.0, f64::NEG_INFINITY, -0.0],
            Some("lwr".to_owned()),
        )
    }

    #[test]
    fn what_is_encoded_comes_back() -> Result<(), Box<dyn std::error::Error>> {
        assert_eq!(decode::<Sample>(&encode(&sample())?)?, sample());
        Ok(())
    }

    #[test]
    fn every_shortened_message_is_refused() -> Result<(), EncodeError> {
        let bytes = encode(&sample())?;
        for size in 0..bytes.len() {
            let refused = decode::<Sample>(&bytes[..size]);
            assert!(
                matches!(refused, Err(DecodeError::Malformed { .. })),
                "{size}"
            );
        }
        Ok(())
    }

    #[test]
    fn trailing_bytes_are_refused() -> Result<(), EncodeError> {
        let mut bytes = encode(&sample())?;
        let used = bytes.len();
        bytes.push(0);
        let error = decode::<Sample>(&bytes);
        assert!(
            matches!(error, Err(DecodeError::TrailingBytes { used: u, size }) if u == used && size == used + 1)
        );
        Ok(())
    }

    #[test]
    fn more_bytes_than_the_type_has_are_refused() {
        let refused = decode::<Sample>(&[0; 65]);
        assert!(matches!(
            refused,
            Err(DecodeError::TooLong { size: 65, max: 64 })
        ));
    }

    #[test]
    fn a_length_beyond_the_limit_is_refused_without_allocating_it() {
        // Variable length integer 253 announces eight bytes: a text of 2^40 bytes; 252 announces four: one of 16 MiB.
        for bytes in [&[253, 0, 0, 0, 0, 0, 1, 0, 0][..], &[252, 0, 0, 0, 1]] {
            let cause = decode::<String>(bytes).err().map(|error| error.to_string());
            let cause = cause.unwrap_or_default();
            assert!(cause.contains("LimitExceeded"), "{cause}");
        }
    }
}
