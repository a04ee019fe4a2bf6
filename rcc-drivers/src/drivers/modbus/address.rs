//! Addresses of channels in a Modbus server: `[SERVER/]TABLE NUMBER [TYPE [ORDER]]` or `… bit B`.
//! Pure; used once, when a driver is opened.

use std::fmt;

use thiserror::Error;

use super::value::{ByteOrder, NumberType, RegisterFormat};

/// The tables of the Modbus data model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Table {
    /// Coils: bits, read and written.
    Coil,
    /// Discrete inputs: bits, read-only.
    Discrete,
    /// Holding registers: 16 bits, read and written.
    Holding,
    /// Input registers: 16 bits, read-only.
    Input,
}

impl Table {
    /// All tables with their names in an address.
    pub const ALL: [(&'static str, Table); 4] = [
        ("coil", Table::Coil),
        ("discrete", Table::Discrete),
        ("holding", Table::Holding),
        ("input", Table::Input),
    ];

    /// Returns the name in an address.
    #[must_use]
    pub fn name(self) -> &'static str {
        let mut rows = Self::ALL.iter();
        rows.find(|row| row.1 == self).map_or("", |row| row.0)
    }

    /// Returns true if the points of the table are single bits.
    #[must_use]
    pub fn is_bits(self) -> bool {
        matches!(self, Table::Coil | Table::Discrete)
    }

    /// Returns true if the points of the table can be written.
    #[must_use]
    pub fn is_writable(self) -> bool {
        matches!(self, Table::Coil | Table::Holding)
    }
}

/// Data type at an address.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// A coil or a discrete input.
    Bit,
    /// One bit of a register; 0 is the lowest.
    RegisterBit(u8),
    /// A number in one or more registers.
    Number(RegisterFormat),
}

/// Address of a channel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Address {
    /// Name of the server, if given.
    pub server: Option<String>,
    /// Name of the table.
    pub table: Table,
    /// Number of the first point in its table, from 0, as on the wire.
    pub number: u16,
    /// Data type.
    pub form: Form,
}

impl Address {
    /// Returns the number of points (bits or registers) of the value; `number + width` is at most 65,536.
    #[must_use]
    pub fn width(&self) -> u16 {
        match self.form {
            Form::Bit | Form::RegisterBit(_) => 1,
            Form::Number(format) => format.width(),
        }
    }
}

impl fmt::Display for Address {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(server) = &self.server {
            write!(formatter, "{server}/")?;
        }
        write!(formatter, "{} {}", self.table.name(), self.number)?;
        match self.form {
            Form::Bit => Ok(()),
            Form::RegisterBit(bit) => write!(formatter, " bit {bit}"),
            Form::Number(format) => write!(formatter, " {format}"),
        }
    }
}

/// Why a text is not a valid address.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum AddressError {
    /// Unknown table.
    #[error("unknown table '{0}': write coil, discrete, holding or input")]
    Table(String),
    /// The number is missing or does not fit in 16 bits.
    #[error("invalid number '{0}': write 0 to 65535")]
    Number(String),
    /// Unknown type.
    #[error("unknown type '{0}': write u16, i16, u32, i32, u64, i64, f32, f64, or bit 0 to bit 15")]
    Type(String),
    /// A type for a table of bits.
    #[error("a {table} is a single bit: remove '{word}'")]
    TypeOfBit {
        /// The table.
        table: &'static str,
        /// The word after the number.
        word: String,
    },
    /// The byte order does not exist for this type.
    #[error("unknown byte order '{word}' of type {number}; available: {known}")]
    Order {
        /// The word in the address.
        word: String,
        /// Name of the type.
        number: &'static str,
        /// The byte orders of that type.
        known: String,
    },
    /// The value extends beyond the end of the table.
    #[error("its {width} registers extend beyond the last one, 65535")]
    Beyond {
        /// Number of registers of the value.
        width: u16,
    },
    /// A superfluous word after a complete address.
    #[error("unexpected '{0}' at the end")]
    TooMuch(String),
}

/// Parses an address.
///
/// # Errors
/// Returns an error for the first word that is not valid.
pub fn parse(text: &str) -> Result<Address, AddressError> {
    let (server, rest) = match text.split_once('/') {
        Some((server, rest)) => (Some(server.trim().to_owned()), rest),
        None => (None, text),
    };
    let mut words = rest.split_whitespace();
    let word = words.next().unwrap_or("");
    let table = Table::ALL.iter().find(|row| row.0 == word);
    let table = table.ok_or_else(|| AddressError::Table(word.to_owned()))?.1;
    let word = words.next().unwrap_or("");
    // Digits only: u16's own parser also accepts "+3".
    let digits = word.bytes().all(|byte| byte.is_ascii_digit());
    let number: Option<u16> = word.parse().ok().filter(|_| digits);
    let number = number.ok_or_else(|| AddressError::Number(word.to_owned()))?;
    let form = form(table, &mut words)?;
    if let Some(word) = words.next() {
        return Err(AddressError::TooMuch(word.to_owned()));
    }
    let address = Address {
        server,
        table,
        number,
        form,
    };
    let width = address.width();
    if u32::from(number) + u32::from(width) > 0x1_0000 {
        return Err(AddressError::Beyond { width });
    }
    Ok(address)
}

fn form<'t>(table: Table, words: &mut impl Iterator<Item = &'t str>) -> Result<Form, AddressError> {
    let word = words.next();
    if table.is_bits() {
        return match word {
            None => Ok(Form::Bit),
            Some(word) => Err(AddressError::TypeOfBit {
                table: table.name(),
                word: word.to_owned(),
            }),
        };
    }
    if word == Some("bit") {
        let word = words.next().unwrap_or("");
        let bit = word.parse().ok().filter(|bit| *bit < 16);
        return bit
            .map(Form::RegisterBit)
            .ok_or_else(|| AddressError::Type(format!("bit {word}")));
    }
    let number = match word {
        None => NumberType::U16,
        Some(word) => NumberType::parse(word).ok_or_else(|| AddressError::Type(word.to_owned()))?,
    };
    let order = match words.next() {
        None => ByteOrder::default(),
        Some(word) => number.order(word).ok_or_else(|| AddressError::Order {
            word: word.to_owned(),
            number: number.name(),
            known: number.orders().join(", "),
        })?,
    };
    Ok(Form::Number(RegisterFormat { number, order }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_is_written_as_it_is_read() {
        for text in [
            "coil 0",
            "discrete 65535",
            "holding 7 bit 15",
            "input 4 i32 CDAB",
            "press/holding 10 f64 GHEFCDAB",
            "holding 3 u16 BA",
            "input 65534 f32",
        ] {
            let address = parse(text).unwrap();
            assert_eq!(address.to_string(), text);
        }
        assert_eq!(parse("holding 7").unwrap().to_string(), "holding 7 u16");
        assert_eq!(
            parse(" input 7  f32 ABCD ").unwrap().to_string(),
            "input 7 f32"
        );
    }

    #[test]
    fn an_invalid_address_is_refused_with_its_first_invalid_word() {
        for (text, words) in [
            ("", "unknown table ''"),
            ("register 3", "unknown table 'register'"),
            ("coil", "invalid number ''"),
            ("coil 65536", "invalid number '65536'"),
            ("coil +3", "invalid number '+3'"),
            ("coil -1", "invalid number '-1'"),
            ("coil 3 u16", "a coil is a single bit"),
            ("discrete 3 bit 2", "a discrete is a single bit"),
            ("holding 3 bit 16", "unknown type 'bit 16'"),
            ("holding 3 bit", "unknown type 'bit '"),
            ("holding 3 u8", "unknown type 'u8'"),
            ("holding 3 f32 AB", "available: ABCD, CDAB, BADC, DCBA"),
            ("holding 3 u16 ABCD", "available: AB, BA"),
            ("holding 3 f32 ABCD now", "unexpected 'now'"),
            ("holding 65535 f32", "its 2 registers extend beyond"),
            ("a/b/coil 3", "unknown table 'b/coil'"),
        ] {
            let fault = parse(text).expect_err(text).to_string();
            assert!(fault.contains(words), "{text}: {fault}");
        }
    }
}
