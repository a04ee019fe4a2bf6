//! Numbers in registers: eight types, four byte orders, range checks.
//! Pure; used by the host's thread in each exchange.

use std::fmt;

/// Most registers of one number.
pub const WIDTH_MAX: usize = 4;

/// Type of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NumberType {
    /// 16 bits, unsigned.
    U16,
    /// 16 bits, two's complement.
    I16,
    /// 32 bits, unsigned.
    U32,
    /// 32 bits, two's complement.
    I32,
    /// 64 bits, unsigned; beyond 2^53 an `f64` cannot represent every integer.
    U64,
    /// 64 bits, two's complement; as above.
    I64,
    /// IEEE 754 single.
    F32,
    /// IEEE 754 double.
    F64,
}

/// Name and number of registers of each type.
const NUMBERS: [(&str, NumberType, u16); 8] = [
    ("u16", NumberType::U16, 1),
    ("i16", NumberType::I16, 1),
    ("u32", NumberType::U32, 2),
    ("i32", NumberType::I32, 2),
    ("u64", NumberType::U64, 4),
    ("i64", NumberType::I64, 4),
    ("f32", NumberType::F32, 2),
    ("f64", NumberType::F64, 4),
];

/// Byte orders by number of registers; A is the most significant byte, and each register is sent high byte first.
const ORDERS: [(u16, [(&str, ByteOrder); 4]); 3] = [
    (1, orders(["AB", "AB", "BA", "BA"])),
    (2, orders(["ABCD", "CDAB", "BADC", "DCBA"])),
    (4, orders(["ABCDEFGH", "GHEFCDAB", "BADCFEHG", "HGFEDCBA"])),
];

const fn orders(names: [&'static str; 4]) -> [(&'static str, ByteOrder); 4] {
    let [plain, words, bytes, both] = names;
    [
        (
            plain,
            ByteOrder {
                words_reversed: false,
                bytes_swapped: false,
            },
        ),
        (
            words,
            ByteOrder {
                words_reversed: true,
                bytes_swapped: false,
            },
        ),
        (
            bytes,
            ByteOrder {
                words_reversed: false,
                bytes_swapped: true,
            },
        ),
        (
            both,
            ByteOrder {
                words_reversed: true,
                bytes_swapped: true,
            },
        ),
    ]
}

/// Order of a number's bytes in its registers; the default is the standard's, most significant first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ByteOrder {
    /// The least significant register comes first.
    pub words_reversed: bool,
    /// In each register, the low byte comes first.
    pub bytes_swapped: bool,
}

/// Type and byte order of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RegisterFormat {
    /// Type.
    pub number: NumberType,
    /// Byte order.
    pub order: ByteOrder,
}

/// The registers of one number, in the order of their addresses; those beyond its width are 0.
pub type RegisterWords = [u16; WIDTH_MAX];

impl NumberType {
    /// Returns the type with this name.
    #[must_use]
    pub fn parse(name: &str) -> Option<NumberType> {
        NUMBERS.iter().find(|row| row.0 == name).map(|row| row.1)
    }

    /// Returns the name in an address.
    #[must_use]
    pub fn name(self) -> &'static str {
        let mut rows = NUMBERS.iter();
        rows.find(|row| row.1 == self).map_or("", |row| row.0)
    }

    /// Returns the number of registers.
    #[must_use]
    pub fn width(self) -> u16 {
        let mut rows = NUMBERS.iter();
        rows.find(|row| row.1 == self).map_or(1, |row| row.2)
    }

    /// Returns the byte order with these letters, such as `CDAB`.
    #[must_use]
    pub fn order(self, letters: &str) -> Option<ByteOrder> {
        let mut rows = self.order_rows();
        rows.find(|row| row.0 == letters).map(|row| row.1)
    }

    /// Returns the letters of all distinct byte orders.
    #[must_use]
    pub fn orders(self) -> Vec<&'static str> {
        let mut names: Vec<_> = self.order_rows().map(|row| row.0).collect();
        names.dedup();
        names
    }

    fn order_rows(self) -> impl Iterator<Item = &'static (&'static str, ByteOrder)> {
        let width = self.width();
        let mut rows = ORDERS.iter();
        rows.find(move |row| row.0 == width)
            .into_iter()
            .flat_map(|row| &row.1)
    }

    /// Returns the smallest and largest value, as closely as an `f64` can represent them.
    #[must_use]
    pub fn limits(self) -> [f64; 2] {
        match self {
            NumberType::U16 => [0.0, f64::from(u16::MAX)],
            NumberType::I16 => [f64::from(i16::MIN), f64::from(i16::MAX)],
            NumberType::U32 => [0.0, f64::from(u32::MAX)],
            NumberType::I32 => [f64::from(i32::MIN), f64::from(i32::MAX)],
            // The largest f64 below 2^64 and 2^63.
            NumberType::U64 => [0.0, 18_446_744_073_709_549_568.0],
            NumberType::I64 => [-9_223_372_036_854_775_808.0, 9_223_372_036_854_774_784.0],
            NumberType::F32 => [f64::from(f32::MIN), f64::from(f32::MAX)],
            NumberType::F64 => [f64::MIN, f64::MAX],
        }
    }
}

impl RegisterFormat {
    /// Returns the number of registers.
    #[must_use]
    pub fn width(self) -> u16 {
        self.number.width()
    }

    /// Returns the raw value of registers; NaN if it is not finite, or if there are too few registers.
    #[must_use]
    pub fn decode(self, registers: &[u16]) -> f64 {
        let width = usize::from(self.width());
        let Some(registers) = registers.get(..width) else {
            return f64::NAN;
        };
        let mut bits = 0_u64;
        for place in 0..width {
            let from = if self.order.words_reversed {
                width - 1 - place
            } else {
                place
            };
            bits = bits << 16 | u64::from(self.register(registers[from]));
        }
        let value = match self.number {
            NumberType::U16 | NumberType::U32 | NumberType::U64 => bits as f64,
            NumberType::I16 => f64::from(bits as u16 as i16),
            NumberType::I32 => f64::from(bits as u32 as i32),
            NumberType::I64 => bits as i64 as f64,
            NumberType::F32 => f64::from(f32::from_bits(bits as u32)),
            NumberType::F64 => f64::from_bits(bits),
        };
        if value.is_finite() { value } else { f64::NAN }
    }

    /// Returns the registers of a raw value, rounded for integer types; `None` if it is out of range or NaN.
    #[must_use]
    pub fn encode(self, raw: f64) -> Option<RegisterWords> {
        let raw = match self.number {
            NumberType::F32 | NumberType::F64 => raw,
            _ => raw.round(),
        };
        let [lower, upper] = self.number.limits();
        if !(raw >= lower && raw <= upper) {
            return None;
        }
        // Within the limits, so nothing is truncated.
        let mut bits = match self.number {
            NumberType::U16 | NumberType::U32 | NumberType::U64 => raw as u64,
            NumberType::I16 | NumberType::I32 | NumberType::I64 => (raw as i64).cast_unsigned(),
            NumberType::F32 => u64::from((raw as f32).to_bits()),
            NumberType::F64 => raw.to_bits(),
        };
        let width = usize::from(self.width());
        let mut words = [0; WIDTH_MAX];
        for place in 0..width {
            // From the least significant register on.
            let to = if self.order.words_reversed {
                place
            } else {
                width - 1 - place
            };
            words[to] = self.register(bits as u16);
            bits >>= 16;
        }
        Some(words)
    }

    fn register(self, word: u16) -> u16 {
        if self.order.bytes_swapped {
            word.swap_bytes()
        } else {
            word
        }
    }
}

impl fmt::Display for RegisterFormat {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.number.name())?;
        let mut rows = self.number.order_rows();
        match rows.find(|row| row.1 == self.order) {
            Some((letters, order)) if *order != ByteOrder::default() => {
                write!(formatter, " {letters}")
            }
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn format(number: NumberType, letters: &str) -> RegisterFormat {
        let order = number.order(letters).unwrap();
        RegisterFormat { number, order }
    }

    #[test]
    fn bytes_lie_as_the_letters_say() {
        // 0x0A0B0C0D as u32, and 123456.0 as f32 = 0x47F12000.
        for (letters, words) in [
            ("ABCD", [0x0A0B, 0x0C0D]),
            ("CDAB", [0x0C0D, 0x0A0B]),
            ("BADC", [0x0B0A, 0x0D0C]),
            ("DCBA", [0x0D0C, 0x0B0A]),
        ] {
            let format = format(NumberType::U32, letters);
            assert_eq!(format.decode(&words), f64::from(0x0A0B_0C0D_u32));
            assert_eq!(
                format.encode(f64::from(0x0A0B_0C0D_u32)),
                Some([words[0], words[1], 0, 0])
            );
        }
        assert_eq!(
            format(NumberType::F32, "ABCD").decode(&[0x47F1, 0x2000]),
            123_456.0
        );
        let wide = 0x0102_0304_0506_0700_u64 as f64;
        for (letters, words) in [
            ("ABCDEFGH", [0x0102, 0x0304, 0x0506, 0x0700]),
            ("GHEFCDAB", [0x0700, 0x0506, 0x0304, 0x0102]),
            ("BADCFEHG", [0x0201, 0x0403, 0x0605, 0x0007]),
            ("HGFEDCBA", [0x0007, 0x0605, 0x0403, 0x0201]),
        ] {
            // 2^56 and more: the lowest byte is 0, so that an f64 can represent it.
            assert_eq!(
                format(NumberType::U64, letters).encode(wide),
                Some(words),
                "{letters}"
            );
            assert_eq!(format(NumberType::U64, letters).decode(&words), wide);
        }
        assert_eq!(
            format(NumberType::U16, "BA").encode(258.0),
            Some([0x0201, 0, 0, 0])
        );
    }

    #[test]
    fn every_type_gives_back_its_limits_in_every_order_and_refuses_what_lies_beyond() {
        for (name, number, _) in NUMBERS {
            let [lower, upper] = number.limits();
            for letters in number.orders() {
                let format = format(number, letters);
                for value in [lower, upper, 0.0, 1.0] {
                    let words = format.encode(value).unwrap();
                    assert_eq!(format.decode(&words), value, "{name} {letters}");
                }
                let [below, beyond] = match number {
                    NumberType::F64 => [f64::NEG_INFINITY, f64::INFINITY],
                    // One f64 step beyond the limit.
                    _ if lower == 0.0 => [-1.0, upper.next_up().max(upper + 1.0)],
                    _ => [
                        lower.next_down().min(lower - 1.0),
                        upper.next_up().max(upper + 1.0),
                    ],
                };
                for value in [below, beyond, f64::NAN] {
                    assert_eq!(format.encode(value), None, "{name} {value}");
                }
            }
        }
    }

    #[test]
    fn registers_without_a_finite_number_are_unknown() {
        let single = format(NumberType::F32, "ABCD");
        for words in [[0x7FC0, 0], [0x7F80, 0], [0xFF80, 0]] {
            assert!(single.decode(&words).is_nan());
        }
        assert!(single.decode(&[0x47F1]).is_nan());
    }
}
