//! Messages and plans as bytes: the one place that knows which encoder is used (bincode), so that it can be replaced here.
//! Run by any thread that may allocate; never a file format.
//!
//! Types derive [`Encode`] and [`Decode`], or only serde's traits (`encode_serde`, `decode_serde`) where a package
//! must not know this one. The derive macros have to be told where their crate is:
//!
//! ```
//! use rcc_ipc::wire::{Decode, Encode, decode, encode};
//! #[derive(Encode, Decode, PartialEq, Debug)]
//! #[bincode(crate = "rcc_ipc::wire::bincode")]
//! struct Start { command: u32 }
//! let bytes = encode(&Start { command: 7 })?;
//! assert_eq!(decode::<Start>(&bytes)?, Start { command: 7 });
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub use bincode;
pub use bincode::{Decode, Encode};

/// The largest number of bytes that one decoded message may claim, in memory as well; more is refused before allocating.
pub const DECODED_SIZE_MAX: usize = 64 << 20;

/// Why a value could not be written as bytes.
#[derive(Debug, thiserror::Error)]
#[error("this value cannot be encoded: {0}")]
pub struct EncodeError(#[from] bincode::error::EncodeError);

/// Why bytes are not the expected message.
#[derive(Debug, thiserror::Error)]
pub enum DecodeError {
    /// The bytes end early, claim more than allowed, or hold a value that the type does not have.
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

fn configuration() -> impl bincode::config::Config {
    bincode::config::standard().with_limit::<DECODED_SIZE_MAX>()
}

/// The bytes of `value`.
///
/// # Errors
/// When the type itself refuses to be encoded (none of ours does).
pub fn encode<T: Encode>(value: &T) -> Result<Vec<u8>, EncodeError> {
    Ok(bincode::encode_to_vec(value, configuration())?)
}

/// The value that `bytes` hold, all of them.
///
/// # Errors
/// Anything that is not exactly one encoded `T` within [`DECODED_SIZE_MAX`].
pub fn decode<T: Decode<()>>(bytes: &[u8]) -> Result<T, DecodeError> {
    whole(bytes, bincode::decode_from_slice(bytes, configuration()))
}

/// As [`encode`], for a type that only knows serde.
///
/// # Errors
/// As [`encode`].
pub fn encode_serde<T: serde::Serialize>(value: &T) -> Result<Vec<u8>, EncodeError> {
    Ok(bincode::serde::encode_to_vec(value, configuration())?)
}

/// As [`decode`], for a type that only knows serde.
///
/// # Errors
/// As [`decode`].
pub fn decode_serde<T: serde::de::DeserializeOwned>(bytes: &[u8]) -> Result<T, DecodeError> {
    whole(
        bytes,
        bincode::serde::decode_from_slice(bytes, configuration()),
    )
}

fn whole<T>(
    bytes: &[u8],
    decoded: Result<(T, usize), bincode::error::DecodeError>,
) -> Result<T, DecodeError> {
    match decoded {
        Ok((value, used)) if used == bytes.len() => Ok(value),
        Ok((_, used)) => Err(DecodeError::TrailingBytes {
            used,
            size: bytes.len(),
        }),
        Err(cause) => Err(DecodeError::Malformed {
            size: bytes.len(),
            cause,
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    type Message = (u32, Vec<f64>, Option<String>);

    fn message() -> Message {
        (
            7,
            vec![1.0, f64::NEG_INFINITY, -0.0],
            Some("lwr".to_owned()),
        )
    }

    #[test]
    fn what_is_encoded_comes_back() -> Result<(), Box<dyn std::error::Error>> {
        assert_eq!(decode::<Message>(&encode(&message())?)?, message());
        assert_eq!(
            decode_serde::<Message>(&encode_serde(&message())?)?,
            message()
        );
        Ok(())
    }

    #[test]
    fn every_shortened_message_is_refused() -> Result<(), EncodeError> {
        let bytes = encode(&message())?;
        for size in 0..bytes.len() {
            assert!(
                matches!(
                    decode::<Message>(&bytes[..size]),
                    Err(DecodeError::Malformed { .. })
                ),
                "{size}"
            );
        }
        Ok(())
    }

    #[test]
    fn trailing_bytes_are_refused() -> Result<(), EncodeError> {
        let mut bytes = encode(&message())?;
        let used = bytes.len();
        bytes.push(0);
        let error = decode::<Message>(&bytes);
        assert!(
            matches!(error, Err(DecodeError::TrailingBytes { used: u, size }) if u == used && size == used + 1)
        );
        Ok(())
    }

    #[test]
    fn a_length_beyond_the_limit_is_refused_without_allocating_it() {
        // Variable length integer 253 announces eight bytes: a Vec<u8> of 2^40 elements.
        let bytes = [253, 0, 0, 0, 0, 0, 1, 0, 0];
        assert!(matches!(
            decode::<Vec<u8>>(&bytes),
            Err(DecodeError::Malformed { .. })
        ));
    }
}
