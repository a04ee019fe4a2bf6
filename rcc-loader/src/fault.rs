//! The codes of all faults that a net can have. A code keeps its meaning for ever; people search for it.
//! Used by the loader's threads and by `rcc-cli check`.

/// A kind of fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rule {
    /// As printed.
    pub code: &'static str,
    /// What it stands for, one sentence.
    pub meaning: &'static str,
}

macro_rules! rules {
    ($($name:ident = $code:expr, $meaning:literal;)*) => {
        $(#[doc = $meaning] pub const $name: &str = $code;)*
        /// Every kind of fault, sorted by code.
        pub const RULES: &[Rule] = &[$(Rule { code: $name, meaning: $meaning }),*];
    };
}

rules! {
    BROKEN = rcc_config::yaml::BROKEN, "The text is not YAML or JSON.";
    DUPLICATE_KEY = rcc_config::yaml::DUPLICATE_KEY, "A key, for example the id of a primitive, is given twice.";
    TEXT_TOO_LARGE = rcc_config::yaml::TOO_LARGE, "The text is too long or nested too deeply.";
    NOT_SUPPORTED = rcc_config::yaml::NOT_SUPPORTED, "The text uses a part of YAML that has no meaning here.";
    UNKNOWN_KEY = "RCC1101", "A key has no meaning where it stands.";
    WRONG_SHAPE = "RCC1102", "A value is of another shape than its place needs.";
    MISSING_KEY = "RCC1103", "A key that must be given is missing.";
    BAD_NAME = "RCC1104", "A name contains characters that names may not have.";
    BAD_QUANTITY = "RCC1105", "A number with a unit cannot be read.";
    NOT_NORMALISED = "RCC1106", "A quaternion is not of length 1.";
    UNKNOWN_TYPE = "RCC1201", "There is no primitive of this type.";
    UNKNOWN_PRIMITIVE = "RCC1202", "A link names a primitive that the net does not have.";
    UNKNOWN_OUTPUT = "RCC1203", "A link names an output that its primitive does not have.";
    UNKNOWN_INPUT = "RCC1204", "A primitive has no input of this name.";
    UNKNOWN_PARAMETER = "RCC1205", "A primitive has no parameter of this name.";
    BAD_ELEMENT = "RCC1206", "A link names an element that its output does not have.";
    UNKNOWN_DEVICE = "RCC1207", "The cell has no device of this name.";
    NO_ARM = "RCC1208", "A primitive for arms names a device that is none.";
    UNKNOWN_CHANNEL = "RCC1209", "A device has no channel of this name and kind.";
    MISSING_PARAMETER = "RCC1301", "A parameter that must be given is missing.";
    OUT_OF_RANGE = "RCC1302", "A parameter is outside of its range.";
    TYPE_MISMATCH = "RCC1303", "A value is of another type than its place needs.";
    UNIT_MISMATCH = "RCC1304", "A value is in another unit than its place needs.";
    RATE_TOO_HIGH = "RCC1305", "A rate is faster than the cycle.";
    NOT_CONNECTED = "RCC1401", "An input that must be connected is not.";
    NOT_READ = "RCC1402", "An output is neither read nor discarded.";
    DISCARDED_BUT_READ = "RCC1403", "An output is discarded and read.";
    BAD_DISCARD = "RCC1404", "`discard` names no output, or one twice.";
    LOOP_WITHOUT_DELAY = "RCC1405", "Primitives wait for each other in a circle.";
    LOOP_WITHOUT_INITIAL = "RCC1406", "A delayed link that closes a loop has no first value.";
    NULL_FOR_EVER = "RCC1407", "A loop could never lose null again.";
    NO_TERMINATION = "RCC1501", "The net has no Termination.";
    MANY_TERMINATIONS = "RCC1502", "The net has more than one Termination.";
    CLAIMED_TWICE = "RCC1503", "Two primitives command the same resource.";
    TOO_WIDE = "RCC1504", "A value has more elements than a monitor can show.";
    NET_TOO_LARGE = "RCC1505", "The net needs more than an executor gives.";
    NOT_CANCELABLE = "RCC1901", "The net commands devices and cannot be cancelled (warning).";
    RATE_ROUNDED = "RCC1902", "A rate does not divide the cycle's and was rounded (warning).";
}

#[cfg(test)]
mod tests {
    use super::RULES;

    #[test]
    fn codes_are_sorted_and_free_of_duplicates() {
        assert!(RULES.windows(2).all(|pair| pair[0].code < pair[1].code));
    }
}
