//! Encoding of one value in an FRI datagram: little-endian, at a fixed offset, without padding.
//! Pure functions without allocation; run by whichever thread calls the codec.

use super::WireError;

/// A type with a fixed size in a datagram.
pub(super) trait WireValue: Sized {
    /// Name of one element, as printed in the layout.
    const KIND: &'static str;
    /// Number of elements.
    const COUNT: usize;
    /// Size of the whole value in bytes.
    const SIZE: usize;

    /// Writes the value; `bytes` is exactly `SIZE` long.
    fn put(&self, bytes: &mut [u8]);

    /// Reads the value; `bytes` is exactly `SIZE` long, `field` names it in an error.
    fn get(bytes: &[u8], field: &'static str) -> Result<Self, WireError>;
}

/// Implements the codec of a number, whose size is the same in memory and on the wire.
macro_rules! number {
    ($($number:ty),*) => {$(
        impl WireValue for $number {
            const KIND: &'static str = stringify!($number);
            const COUNT: usize = 1;
            const SIZE: usize = size_of::<$number>();

            fn put(&self, bytes: &mut [u8]) {
                bytes.copy_from_slice(&self.to_le_bytes());
            }

            fn get(bytes: &[u8], field: &'static str) -> Result<Self, WireError> {
                let raw = bytes.try_into().map_err(|_| WireError::Size {
                    datagram: field,
                    want: Self::SIZE,
                    have: bytes.len(),
                })?;
                Ok(Self::from_le_bytes(raw))
            }
        }
    )*};
}

number!(u16, u32, i32, f32);

impl<T: WireValue + Default + Copy, const N: usize> WireValue for [T; N] {
    const KIND: &'static str = T::KIND;
    const COUNT: usize = N;
    const SIZE: usize = N * T::SIZE;

    fn put(&self, bytes: &mut [u8]) {
        for (element, place) in self.iter().zip(bytes.chunks_exact_mut(T::SIZE)) {
            element.put(place);
        }
    }

    fn get(bytes: &[u8], field: &'static str) -> Result<Self, WireError> {
        let mut values = [T::default(); N];
        for (value, place) in values.iter_mut().zip(bytes.chunks_exact(T::SIZE)) {
            *value = T::get(place, field)?;
        }
        Ok(values)
    }
}

/// Defines an enumeration that is sent as a u16; an undefined value is a typed error.
macro_rules! wire_enum {
    ($(#[$doc:meta])* $name:ident { $($(#[$variant_doc:meta])* $variant:ident = $code:literal),* $(,)? }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
        #[repr(u16)]
        pub enum $name {
            $($(#[$variant_doc])* $variant = $code),*
        }

        impl $crate::fri_lwr::wire::value::WireValue for $name {
            const KIND: &'static str = "u16";
            const COUNT: usize = 1;
            const SIZE: usize = 2;

            fn put(&self, bytes: &mut [u8]) {
                (*self as u16).put(bytes);
            }

            fn get(bytes: &[u8], field: &'static str) -> Result<Self, WireError> {
                match u16::get(bytes, field)? {
                    $($code => Ok(Self::$variant),)*
                    value => Err(WireError::UnknownValue { field, value }),
                }
            }
        }
    };
}

pub(super) use wire_enum;
