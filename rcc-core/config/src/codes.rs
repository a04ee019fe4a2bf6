//! All faults of a configuration with their stable codes. A plain table; the tests iterate over it and require a test
//! case for every row.

/// A kind of fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Code {
    /// Stable code, never reused for another kind of fault.
    pub code: &'static str,
    /// Short description.
    pub meaning: &'static str,
}

const fn code(code: &'static str, meaning: &'static str) -> Code {
    Code { code, meaning }
}

/// The file cannot be read.
pub const UNREADABLE: Code = code("RCC2001", "a file cannot be read");
/// A key is not known at this place.
pub const UNKNOWN_KEY: Code = code("RCC2002", "a key has no meaning there");
/// A required key is missing.
pub const MISSING_KEY: Code = code("RCC2003", "a key is missing");
/// A value has the wrong type, such as a list instead of a mapping.
pub const WRONG_SHAPE: Code = code("RCC2004", "a value has the wrong type");
/// A text is not a number with a unit.
pub const NOT_A_QUANTITY: Code = code("RCC2005", "a text is not a number with a unit");
/// A number without its unit.
pub const MISSING_UNIT: Code = code("RCC2006", "a number lacks its unit");
/// The unit belongs to another quantity.
pub const WRONG_UNIT: Code = code("RCC2007", "a unit belongs to another quantity");
/// A value is outside of what is possible or sensible.
pub const OUT_OF_RANGE: Code = code("RCC2008", "a value is out of range");
/// A name does not follow its rule.
pub const BAD_NAME: Code = code("RCC2009", "a name is invalid");
/// Two outputs have the same address.
pub const ADDRESS_TAKEN: Code = code("RCC2010", "two outputs have the same address");
/// More elements than the limit.
pub const TOO_MANY: Code = code("RCC2011", "a device or cell has too many of something");
/// A keyword is not one of the known ones.
pub const UNKNOWN_KIND: Code = code("RCC2012", "a keyword is unknown");
/// An output does not define what it does on release.
pub const NO_ON_RELEASE: Code = code(
    "RCC2013",
    "an output does not define what it does on release",
);
/// A key that only applies to other kinds of entries.
pub const KEY_OF_OTHER_KIND: Code = code("RCC2014", "a key does not fit the kind of its entry");
/// `${name}` does not name a port.
pub const UNKNOWN_PORT: Code = code("RCC2015", "a text names a port that is not declared");
/// An automatic port has no number.
pub const PORT_NOT_CHOSEN: Code = code("RCC2016", "an automatic port has no number");
/// A number was given for a port that the cell does not have.
pub const PORT_NOT_DECLARED: Code = code(
    "RCC2017",
    "a number was given for a port that is not declared",
);
/// A lower bound is not less than its upper bound.
pub const REVERSED: Code = code("RCC2018", "a lower bound is not below its upper bound");
/// The number of joints does not match the kinematics.
pub const JOINT_COUNT: Code = code("RCC2019", "the joints do not match the kinematics");
/// The delay is longer than the driver's buffer of set-points.
pub const DELAY_TOO_LONG: Code = code(
    "RCC2020",
    "the delay is longer than the buffer of set-points",
);
/// The output would refuse its own safe value.
pub const UNSAFE_VALUE: Code = code("RCC2021", "a safe value is outside of the channel's range");
/// A port declaration is invalid.
pub const BAD_PORT: Code = code("RCC2022", "a port is neither a number nor automatic");
/// `${` without a closing brace.
pub const BROKEN_PLACEHOLDER: Code = code("RCC2023", "a placeholder is not closed");
/// A text is not an address with a port.
pub const BAD_ADDRESS: Code = code("RCC2024", "a text is not an address with a port");
/// An address that other machines can reach, without explicit permission.
pub const REMOTE_ADDRESS: Code = code("RCC2025", "other machines can reach an address");
/// A device with this name does not exist.
pub const UNKNOWN_DEVICE: Code = code("RCC2026", "a device is not in the cell");

/// All kinds, in the order of their codes.
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
