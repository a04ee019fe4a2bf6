//! The address of a channel: a terminal by its name, and a place in its process data.
//! Read once, when the driver is opened.
//!
//! `lamps channel 1` · `lamps bit 0` · `other byte 4 i16` · `pressures 0x6000:11 i16`

use super::terminal_settings::TerminalSettings;
use crate::terminals::{Channels, Model};

/// How a value is stored; numbers are little-endian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// One bit.
    Bit,
    /// 8 bits without sign.
    U8,
    /// 8 bits with sign.
    I8,
    /// 16 bits without sign.
    U16,
    /// 16 bits with sign.
    I16,
    /// 32 bits without sign.
    U32,
    /// 32 bits with sign.
    I32,
    /// IEEE 754, 32 bits.
    F32,
}

/// Names of the formats of numbers.
const NUMBERS: [(&str, Format); 7] = [
    ("u8", Format::U8),
    ("i8", Format::I8),
    ("u16", Format::U16),
    ("i16", Format::I16),
    ("u32", Format::U32),
    ("i32", Format::I32),
    ("f32", Format::F32),
];

impl Format {
    /// Returns its length, bits.
    #[must_use]
    pub fn bits(self) -> usize {
        match self {
            Format::Bit => 1,
            Format::U8 | Format::I8 => 8,
            Format::U16 | Format::I16 => 16,
            Format::U32 | Format::I32 | Format::F32 => 32,
        }
    }

    /// Returns the smallest and the largest number that it holds.
    #[must_use]
    pub fn bounds(self) -> [f64; 2] {
        match self {
            Format::Bit => [0.0, 1.0],
            Format::U8 => [0.0, f64::from(u8::MAX)],
            Format::I8 => [f64::from(i8::MIN), f64::from(i8::MAX)],
            Format::U16 => [0.0, f64::from(u16::MAX)],
            Format::I16 => [f64::from(i16::MIN), f64::from(i16::MAX)],
            Format::U32 => [0.0, f64::from(u32::MAX)],
            Format::I32 => [f64::from(i32::MIN), f64::from(i32::MAX)],
            Format::F32 => [f64::from(f32::MIN), f64::from(f32::MAX)],
        }
    }
}

/// A place in the process data of a terminal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// Index of the terminal, from 0.
    pub terminal: usize,
    /// First bit in its inputs or outputs.
    pub bit: usize,
    /// How the value is stored.
    pub format: Format,
    /// First byte of the status word that belongs to an analog input.
    pub status: Option<usize>,
}

impl Place {
    /// Returns true if two places of outputs share a bit.
    #[must_use]
    pub fn overlaps(&self, other: &Place) -> bool {
        let end = |place: &Place| place.bit + place.format.bits();
        self.terminal == other.terminal && self.bit < end(other) && other.bit < end(self)
    }

    /// Returns the number of bytes of process data that it needs.
    #[must_use]
    pub fn bytes(&self) -> usize {
        (self.bit + self.format.bits()).div_ceil(8)
    }
}

/// Reads an address of a channel that is an output or an input.
///
/// # Errors
/// Returns the cause in words.
pub fn read(
    text: &str,
    output: bool,
    digital: bool,
    terminals: &[TerminalSettings],
) -> Result<Place, String> {
    let words: Vec<&str> = text.split_whitespace().collect();
    let (name, rest) = words.split_first().ok_or("the address is empty")?;
    let terminal = terminals
        .iter()
        .position(|terminal| terminal.name == *name)
        .ok_or_else(|| format!("there is no terminal '{name}' in settings.terminals"))?;
    let model = terminals.get(terminal).and_then(|one| one.model);
    let (bit, format, status) = match rest {
        ["bit", number] => (parse(number)?, Format::Bit, None),
        ["byte", number, format] => (8 * parse(number)?, number_format(format)?, None),
        ["channel", number] => channel(known(model, name)?, parse(number)?)?,
        [object] => entry((known(model, name)?, output), object, None)?,
        [object, format] => {
            let format = Some(number_format(format)?);
            entry((known(model, name)?, output), object, format)?
        }
        _ => return Err(format!("`{text}` has too few or too many words")),
    };
    if digital != (format == Format::Bit) {
        let (is, wants) = match digital {
            true => ("a number", "one bit"),
            false => ("one bit", "a number"),
        };
        return Err(format!("`{text}` is {is}, the channel wants {wants}"));
    }
    let place = Place {
        terminal,
        bit,
        format,
        status,
    };
    if let Some(model) = model {
        let exchanges = match output {
            true => model.has_outputs(),
            false => model.has_inputs(),
        };
        if !exchanges {
            let (is, wants) = match output {
                true => ("inputs", "an output"),
                false => ("outputs", "an input"),
            };
            return Err(format!(
                "an {} has only {is}, the channel is {wants}",
                model.name
            ));
        }
        let size = usize::from(model.process_bytes(output));
        if place.bytes() > size {
            return Err(format!(
                "an {} has {size} bytes of process data in this direction",
                model.name
            ));
        }
    }
    Ok(place)
}

fn known<'a>(model: Option<&'a Model>, name: &str) -> Result<&'a Model, String> {
    let unknown = || format!("the type of '{name}' is not known: write `bit N` or `byte N FORMAT`");
    model.ok_or_else(unknown)
}

fn parse(number: &str) -> Result<usize, String> {
    let parsed = number.parse::<u16>();
    parsed
        .map(usize::from)
        .map_err(|_| format!("`{number}` is no number from 0 to 65535"))
}

fn number_format(name: &str) -> Result<Format, String> {
    let found = NUMBERS.iter().find(|(own, _)| *own == name);
    found
        .map(|(_, format)| *format)
        .ok_or_else(|| format!("`{name}` is no format of a number"))
}

/// Returns the value of a channel, from 1, of a known type.
fn channel(model: &Model, number: usize) -> Result<(usize, Format, Option<usize>), String> {
    let count = usize::from(model.count);
    if count == 0 {
        return Err(format!(
            "an {} has no channels: write an entry such as 0x6041:0 u16",
            model.name
        ));
    }
    let place = number.checked_sub(1).filter(|place| *place < count);
    let Some(place) = place else {
        return Err(format!("an {} has channels 1 to {count}", model.name));
    };
    let first = place * usize::from(model.channel_bits());
    Ok(match model.channels {
        Channels::DigitalInput | Channels::DigitalOutput => (first, Format::Bit, None),
        Channels::AnalogOutput | Channels::Drive => (first, Format::I16, None),
        Channels::AnalogInput => (first + 16, Format::I16, Some(first / 8)),
    })
}

/// Finds an entry of the process data objects, `0x6000:11` with a sub-index in hexadecimal digits.
fn entry(
    (model, output): (&Model, bool),
    object: &str,
    format: Option<Format>,
) -> Result<(usize, Format, Option<usize>), String> {
    let wrong = || {
        format!("`{object}` is no entry: write INDEX:SUB in hexadecimal digits, such as 0x6000:11")
    };
    let (index, sub_index) = object.split_once(':').ok_or_else(wrong)?;
    let index = index.strip_prefix("0x").ok_or_else(wrong)?;
    let index = u16::from_str_radix(index, 16).map_err(|_| wrong())?;
    let sub_index = u8::from_str_radix(sub_index, 16).map_err(|_| wrong())?;
    let mut bit = 0;
    let pdos = model.pdos().into_iter();
    for pdo in pdos.filter(|pdo| pdo.is_output() == output) {
        for entry in pdo.entries {
            let bits = usize::from(entry.bits);
            if (entry.index, entry.sub_index) != (index, sub_index) || index == 0 {
                bit += bits;
                continue;
            }
            let format = match (format, entry.data_type) {
                (Some(format), _) => format,
                (None, 1) => Format::Bit,
                (None, 3) => Format::I16,
                (None, _) => return Err(format!("give `{object}` a format, such as u16")),
            };
            if format.bits() != bits {
                return Err(format!("`{object}` has {bits} bits"));
            }
            return Ok((bit, format, None));
        }
    }
    Err(format!("an {} exchanges no entry {object}", model.name))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::terminals::MODELS;

    fn line() -> Vec<TerminalSettings> {
        let known = MODELS.iter().take(4).zip(["in", "out", "ain", "aout"]);
        let known = known.map(|(model, name)| TerminalSettings {
            name: name.to_owned(),
            vendor: 2,
            product: model.product,
            model: Some(model),
            sync0: false,
        });
        let other = TerminalSettings {
            name: "other".to_owned(),
            vendor: 5,
            product: 6,
            model: None,
            sync0: false,
        };
        known.chain([other]).collect()
    }

    #[test]
    fn every_form_gives_its_place() {
        let place = |text, output, digital| {
            let place = read(text, output, digital, &line()).unwrap();
            (place.terminal, place.bit, place.format, place.status)
        };
        assert_eq!(
            place("in channel 3", false, true),
            (0, 2, Format::Bit, None)
        );
        assert_eq!(place("out bit 7", true, true), (1, 7, Format::Bit, None));
        assert_eq!(
            place("ain channel 2", false, false),
            (2, 48, Format::I16, Some(4))
        );
        assert_eq!(
            place("ain 0x6010:11", false, false),
            (2, 48, Format::I16, None)
        );
        assert_eq!(
            place("ain 0x6010:1", false, true),
            (2, 32, Format::Bit, None)
        );
        assert_eq!(
            place("aout 0x7020:01 u16", true, false),
            (3, 32, Format::U16, None)
        );
        assert_eq!(
            place("other byte 4 f32", true, false),
            (4, 32, Format::F32, None)
        );
    }

    #[test]
    fn what_cannot_be_reached_is_told() {
        for (text, output, digital, words) in [
            ("no bit 1", true, true, "no terminal 'no'"),
            ("out", true, true, "too few"),
            ("out bit", true, true, "is no entry"),
            ("out bit 8", true, true, "has 1 bytes"),
            ("out channel 9", true, true, "has channels 1 to 8"),
            ("out bit 1", false, true, "has only outputs"),
            ("in bit 1", true, true, "has only inputs"),
            ("ain channel 1", false, true, "wants one bit"),
            ("in bit 1", false, false, "wants a number"),
            ("ain byte 0 i64", false, false, "no format"),
            ("ain 0x6000:11 u32", false, false, "has 16 bits"),
            ("ain 0x6000:12", false, false, "exchanges no entry"),
            ("ain 0x6000:3", false, false, "a format"),
            ("in 0x7000:1", false, true, "exchanges no entry"),
            ("other channel 1", false, true, "is not known"),
            ("other bit -1", false, true, "no number"),
        ] {
            let error = read(text, output, digital, &line()).unwrap_err();
            assert!(error.contains(words), "{text}: {error}");
        }
    }

    #[test]
    fn places_that_share_a_bit_overlap() {
        let place = |bit, format| Place {
            terminal: 1,
            bit,
            format,
            status: None,
        };
        assert!(place(16, Format::I16).overlaps(&place(31, Format::Bit)));
        assert!(!place(16, Format::I16).overlaps(&place(32, Format::I16)));
        let elsewhere = Place {
            terminal: 2,
            ..place(16, Format::I16)
        };
        assert!(!place(16, Format::I16).overlaps(&elsewhere));
    }
}
