//! Every fault that a configuration can have, with its stable code.
//! A table without behaviour; the tests walk over it and demand a case for every row.

/// A kind of fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Code {
    /// Never given to another kind of fault.
    pub code: &'static str,
    /// What it means, in a few words.
    pub meaning: &'static str,
}

const fn code(code: &'static str, meaning: &'static str) -> Code {
    Code { code, meaning }
}

/// The file cannot be read.
pub const UNREADABLE: Code = code("RCC2001", "a file cannot be read");
/// A key that has no meaning there.
pub const UNKNOWN_KEY: Code = code("RCC2002", "a key has no meaning there");
/// A key that must be given.
pub const MISSING_KEY: Code = code("RCC2003", "a key is missing");
/// A list where a mapping is expected and the like.
pub const WRONG_SHAPE: Code = code("RCC2004", "a value is of another kind");
/// A text that is no number with a unit.
pub const NOT_A_QUANTITY: Code = code("RCC2005", "a text is no number with a unit");
/// A number without its unit.
pub const MISSING_UNIT: Code = code("RCC2006", "a number lacks its unit");
/// The unit of something else.
pub const WRONG_UNIT: Code = code("RCC2007", "a unit is of another quantity");
/// Beyond what is possible or sensible.
pub const OUT_OF_RANGE: Code = code("RCC2008", "a value is out of range");
/// A name of another form.
pub const BAD_NAME: Code = code("RCC2009", "a name has another form");
/// Two outputs at one address.
pub const ADDRESS_TAKEN: Code = code("RCC2010", "two outputs have the same address");
/// More than there is room for.
pub const TOO_MANY: Code = code("RCC2011", "there are more than a device or cell can have");
/// Neither this nor that.
pub const UNKNOWN_KIND: Code = code("RCC2012", "a kind is not known");
/// An output that does not say what becomes of it.
pub const NO_ON_RELEASE: Code = code(
    "RCC2013",
    "an output does not say what it does when released",
);
/// A key that means something for other kinds only.
pub const KEY_OF_OTHER_KIND: Code = code("RCC2014", "a key does not fit the kind of its entry");
/// `${name}` of no port.
pub const UNKNOWN_PORT: Code = code("RCC2015", "a text names a port that is not declared");
/// An automatic port without a number.
pub const PORT_NOT_CHOSEN: Code = code("RCC2016", "an automatic port has no number");
/// A number for a port that the cell does not have.
pub const PORT_NOT_DECLARED: Code = code(
    "RCC2017",
    "a number was given for a port that is not declared",
);
/// The lower bound is not below the upper one.
pub const REVERSED: Code = code("RCC2018", "a lower bound is not below its upper bound");
/// Not the number of joints of the kinematics.
pub const JOINT_COUNT: Code = code("RCC2019", "the joints do not match the kinematics");
/// More delay than the set-points that a driver finds.
pub const DELAY_TOO_LONG: Code = code(
    "RCC2020",
    "the delay is longer than the set-points that a driver finds",
);
/// A safe value that the output refuses.
pub const UNSAFE_VALUE: Code = code("RCC2021", "a safe value is outside of the channel's range");
/// Not a port.
pub const BAD_PORT: Code = code("RCC2022", "a port is neither a number nor automatic");
/// A `$` that begins nothing.
pub const BROKEN_PLACEHOLDER: Code = code("RCC2023", "a placeholder is not closed");
/// Not an address with a port.
pub const BAD_ADDRESS: Code = code("RCC2024", "a text is no address with a port");
/// An address that other machines reach, without a word that this is wanted.
pub const REMOTE_ADDRESS: Code = code("RCC2025", "other machines can reach an address");
/// No device of that name.
pub const UNKNOWN_DEVICE: Code = code("RCC2026", "a device is not in the cell");

/// All kinds, in order.
pub const CODES: &[Code] = &[
    UNREADABLE,
    UNKNOWN_KEY,
    MISSING_KEY,
    WRONG_SHAPE,
    NOT_A_QUANTITY,
    MISSING_UNIT,
    WRONG_UNIT,
    OUT_OF_RANGE,
    BAD_NAME,
    ADDRESS_TAKEN,
    TOO_MANY,
    UNKNOWN_KIND,
    NO_ON_RELEASE,
    KEY_OF_OTHER_KIND,
    UNKNOWN_PORT,
    PORT_NOT_CHOSEN,
    PORT_NOT_DECLARED,
    REVERSED,
    JOINT_COUNT,
    DELAY_TOO_LONG,
    UNSAFE_VALUE,
    BAD_PORT,
    BROKEN_PLACEHOLDER,
    BAD_ADDRESS,
    REMOTE_ADDRESS,
    UNKNOWN_DEVICE,
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_are_consecutive_and_unique() {
        for (code, number) in CODES.iter().zip(2001..) {
            assert_eq!(code.code, format!("RCC{number}"));
        }
    }
}
