//! Encoding of messages and plans as bytes. Runs on any thread that may allocate; never used as a file format.
//!
//! **Replacing the encoder.** Only this module names bincode (2.0.1, no longer maintained). Messages know only serde's
//! traits, so another encoder with serde support (`postcard`, `wincode`) can replace it: change the bodies of
//! the functions `to_bytes` and `from_bytes` below and one line in each of the two `Cargo.toml`, and regenerate the corpora
//! `fuzz/corpus/{requests,wire}`. No file holds such bytes, and loader and executor of one cell are from one build, so
//! nothing has to be converted.
//!
//! **Untrusted input.** The bytes come from another process and may be anything. A message is refused before any byte
//! is examined if it is longer than its type allows; before anything is allocated if it claims more than its bytes can
//! hold; and if it ends early or late. Decoding takes memory and time proportional to the bytes received
//! (`tests/wire.rs` measures the memory). Depth needs no bound of its own, because no message type contains itself.

use serde::Serialize;
use serde::de::DeserializeOwned;

/// A message between loader and executor.
///
/// An implementation promises that its type does not contain itself (no `Box<Self>`), and that every element of its
/// lists takes at least one byte (no list of units). The number of elements is then bounded by the length of the
/// message.
pub trait Message: Serialize + DeserializeOwned {
    /// Maximum length of an encoded message, bytes.
    const BYTES_MAX: usize;

    /// Encodes. `once!` compiles this and [`Message::from_bytes`] in the package of the message, not in each program.
    ///
    /// # Errors
    /// Returns the encoder's error.
    fn to_bytes(&self) -> Result<Vec<u8>, bincode::error::EncodeError> {
        to_bytes(self)
    }

    /// Decodes from the beginning of `bytes`; returns also the number of bytes that were used.
    ///
    /// # Errors
    /// Returns the decoder's error.
    fn from_bytes(bytes: &[u8]) -> Result<(Self, usize), bincode::error::DecodeError> {
        from_bytes(bytes)
    }
}

/// The methods of [`Message`], written out: a decoder of a large message is 20,000 lines of the compiler's code.
macro_rules! once {
    () => {
        fn to_bytes(&self) -> Result<Vec<u8>, bincode::error::EncodeError> {
            $crate::wire::to_bytes(self)
        }

        fn from_bytes(bytes: &[u8]) -> Result<(Self, usize), bincode::error::DecodeError> {
            $crate::wire::from_bytes(bytes)
        }
    };
}
pub(crate) use once;

/// A value could not be encoded.
#[derive(Debug, thiserror::Error)]
#[error("cannot encode this value: {0}")]
pub struct EncodeError(#[from] bincode::error::EncodeError);

/// Bytes could not be decoded as the expected message.
#[derive(Debug, thiserror::Error)]
pub enum DecodeError {
    /// The message is longer than any message of its type.
    #[error(
        "message too long: {size} bytes, the limit is {max}; are both programs of the same build?"
    )]
    TooLong {
        /// Number of bytes received.
        size: usize,
        /// [`Message::BYTES_MAX`].
        max: usize,
    },
    /// The bytes end early, claim more than they hold, or hold a value that the type does not have.
    #[error("malformed message of {size} bytes: {cause}; are both programs of the same build?")]
    Malformed {
        /// Number of bytes received.
        size: usize,
        /// Error of the decoder.
        cause: bincode::error::DecodeError,
    },
    /// Bytes follow after a complete message.
    #[error("the message ends after {used} of {size} bytes; are both programs of the same build?")]
    TrailingBytes {
        /// Length of the message, bytes.
        used: usize,
        /// Number of bytes received.
        size: usize,
    },
}

/// Encodes `value`. The sender checks the length.
///
/// # Errors
/// Returns an error if the type itself refuses to be encoded (none of ours does).
pub fn encode<T: Message>(value: &T) -> Result<Vec<u8>, EncodeError> {
    Ok(value.to_bytes()?)
}

/// Decodes a value from exactly these bytes.
///
/// # Errors
/// Returns an error unless the bytes are exactly one encoded `T` of at most [`Message::BYTES_MAX`] bytes.
pub fn decode<T: Message>(bytes: &[u8]) -> Result<T, DecodeError> {
    let (size, max) = (bytes.len(), T::BYTES_MAX);
    if size > max {
        return Err(DecodeError::TooLong { size, max });
    }
    match T::from_bytes(bytes) {
        Ok((value, used)) if used == size => Ok(value),
        Ok((_, used)) => Err(DecodeError::TrailingBytes { used, size }),
        Err(cause) => Err(DecodeError::Malformed { size, cause }),
    }
}

pub(crate) fn to_bytes<T: Serialize>(value: &T) -> Result<Vec<u8>, bincode::error::EncodeError> {
    bincode::serde::encode_to_vec(value, bincode::config::standard())
}

/// Decodes a `T` from the beginning of `bytes`; ignores what follows.
///
/// # Errors
/// Returns an error if the bytes do not begin with an encoded `T`.
pub fn decode_beginning<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, DecodeError> {
    match from_bytes(bytes) {
        Ok((value, _)) => Ok(value),
        Err(cause) => Err(DecodeError::Malformed {
            size: bytes.len(),
            cause,
        }),
    }
}

/// Decodes with a limit on claimed memory of 16 times the length. One encoded byte stands for at most sixteen in
/// memory; without the limit a text of nine bytes could claim, and allocate, as much as the longest message. bincode
/// takes the limit as a constant, hence the steps.
pub(crate) fn from_bytes<T: DeserializeOwned>(
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
        // Variable-length integer 253 is followed by eight bytes: a text of 2^40 bytes; 252 by four: one of 16 MiB.
        for bytes in [&[253, 0, 0, 0, 0, 0, 1, 0, 0][..], &[252, 0, 0, 0, 1]] {
            let cause = decode::<String>(bytes).err().map(|error| error.to_string());
            let cause = cause.unwrap_or_default();
            assert!(cause.contains("LimitExceeded"), "{cause}");
        }
    }
}
