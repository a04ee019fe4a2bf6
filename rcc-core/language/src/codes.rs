//! The codes of all diagnostics of nets. A code never changes its meaning, because people search for it. Used by the
//! loader's threads and by `rcc-cli check`.

/// Description of a diagnostic code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FaultDescription {
    /// The code as printed.
    pub code: &'static str,
    /// Meaning, one sentence.
    pub meaning: &'static str,
    /// Help text for diagnostics that have none of their own.
    pub remedy: &'static str,
}

macro_rules! descriptions {
    ($($name:ident = $code:expr, $meaning:literal, $remedy:literal;)*) => {
        $(#[doc = $meaning] pub const $name: &str = $code;)*
        /// All codes, sorted.
        pub const DESCRIPTIONS: &[FaultDescription] = &[$(FaultDescription { code: $name, meaning: $meaning, remedy: $remedy }),*];
    };
}

descriptions! {
    BROKEN = rcc_config::yaml::BROKEN, "The text is not YAML, JSON or DirectIONet.",
        "correct the text at the place shown";
    DUPLICATE_KEY = rcc_config::yaml::DUPLICATE_KEY, "A key, for example the id of a primitive, occurs twice.",
        "rename one of the two";
    TEXT_TOO_LARGE = rcc_config::yaml::TOO_LARGE, "The text is too long or nested too deeply.",
        "split the net, or flatten the lists";
    NOT_SUPPORTED = rcc_config::yaml::NOT_SUPPORTED, "The text uses a part of YAML that has no meaning here.",
        "write the value out";
    UNPRINTABLE = rcc_config::yaml::UNPRINTABLE, "A text has a control character or an invisible character.",
        "remove the character; line feeds and tabs are allowed";
    UNKNOWN_KEY = "RCC1101", "A key is unknown at this place.",
        "remove the key";
    WRONG_SHAPE = "RCC1102", "A value has the wrong shape.",
        "write it as the message says";
    MISSING_KEY = "RCC1103", "A required key is missing.",
        "add the key";
    BAD_NAME = "RCC1104", "A name contains characters that names may not have.",
        "use lowercase letters, digits and _ (in a net's name -), beginning with a letter";
    BAD_QUANTITY = "RCC1105", "A number with a unit cannot be read.",
        "write a number, or a number with a unit: `12 N`, `0.25 m/s`, `deg(30)`, `100 Hz`";
    NOT_NORMALISED = "RCC1106", "The length of a quaternion is not 1.",
        "divide all four elements by the length";
    DUPLICATE_FRAGMENT = "RCC1107", "Two fragments have the same name.",
        "rename one of the two";
    BAD_FORMULA = "RCC1108", "A formula cannot be read.",
        "docs/formulas.md has the notation of formulas";
    UNKNOWN_TYPE = "RCC1201", "A primitive has an unknown type.",
        "`rcc-cli primitives` lists all types";
    UNKNOWN_PRIMITIVE = "RCC1202", "A link names a primitive that the net does not have.",
        "add it under `primitives`, or read another output";
    UNKNOWN_OUTPUT = "RCC1203", "A link names an output that its primitive does not have.",
        "`rcc-cli primitives TYPE` lists the outputs of a type";
    UNKNOWN_INPUT = "RCC1204", "A primitive has no input of this name.",
        "`rcc-cli primitives TYPE` lists the inputs of a type";
    UNKNOWN_PARAMETER = "RCC1205", "A primitive has no parameter of this name.",
        "`rcc-cli primitives TYPE` lists the parameters of a type";
    BAD_ELEMENT = "RCC1206", "A link names an element that its output does not have.",
        "elements are counted from 0";
    UNKNOWN_DEVICE = "RCC1207", "The cell has no device of this name.",
        "`rcc-cli devices` lists the devices of a running cell";
    NO_ARM = "RCC1208", "A primitive for arms names a device that is not an arm.",
        "name a device with an arm";
    UNKNOWN_CHANNEL = "RCC1209", "A device has no channel of this name and kind.",
        "add the channel to the device in the cell's configuration, or name another one";
    UNKNOWN_FRAGMENT = "RCC1210", "An instance has an unknown fragment.",
        "write it under `fragments`, or name its library under `use`";
    NO_LIBRARY = "RCC1211", "A library cannot be read.",
        "the path is relative to the file that names it";
    NO_SUCH_PARAMETER = "RCC1212", "A constant names a parameter that no fragment around it has.",
        "add it to the `parameters` of the fragment, or write the value";
    UNKNOWN_FUNCTION = "RCC1213", "A formula calls a function that does not exist.",
        "docs/formulas.md lists the functions; what has a memory or parameters is a primitive of its own";
    MISSING_PARAMETER = "RCC1301", "A required parameter is missing.",
        "add it under `parameters`";
    OUT_OF_RANGE = "RCC1302", "A parameter, or a constant at an input, is out of range.",
        "choose a value within the range";
    TYPE_MISMATCH = "RCC1303", "A value has the wrong type.",
        "connect a value of the required type";
    UNIT_MISMATCH = "RCC1304", "A value has the wrong unit.",
        "connect a value in the required unit, or convert it with Multiply or Divide by a constant that has a unit";
    RATE_TOO_HIGH = "RCC1305", "A rate is faster than the cycle.",
        "choose a rate up to the cycle rate";
    NOT_A_MULTIPLE = "RCC1306", "The period or phase of a net is not a whole number of the cell's cycles.",
        "choose a multiple of the cell's period";
    SLOW_ARM = "RCC1307", "A net that commands joints is not evaluated in every cycle.",
        "remove `period`, `rate` and `phase` from the net";
    CONTRADICTION = "RCC1308", "Two settings exclude each other.",
        "remove one of the two";
    NOT_CONNECTED = "RCC1401", "A required input is not connected.",
        "connect it: `inputs: {NAME: primitive.output}`, or give it a constant";
    NOT_READ = "RCC1402", "An output is neither read nor discarded.",
        "connect it, or name it under `discard`";
    DISCARDED_BUT_READ = "RCC1403", "An output is discarded and read.",
        "remove it from `discard`";
    BAD_DISCARD = "RCC1404", "`discard` names an unknown output, or one twice.",
        "remove it from `discard`";
    LOOP_WITHOUT_DELAY = "RCC1405", "A loop has no delayed link.",
        "delay one link of the loop: `{from: a.out, delayed: true, initial: 0}`";
    LOOP_WITHOUT_INITIAL = "RCC1406", "A delayed link that closes a loop has no initial value.",
        "add `initial:` to the delayed link";
    LOOP_STAYS_NULL = "RCC1407", "A loop could never recover from null.",
        "insert an OrElse into the loop, so that it gets a value again";
    NOT_USED = "RCC1408", "A parameter or input of a fragment, or an input of a formula, is not used in it.",
        "use it, or remove it";
    RECURSIVE_FRAGMENT = "RCC1409", "A fragment contains itself.",
        "remove one of the instances";
    DELAYED_TWICE = "RCC1410", "A link is delayed in a fragment and at its instance.",
        "remove one of the two `delayed: true`";
    NEVER_NULL = "RCC1411", "A constant or `Input` inside an instance with `active:` is read outside of it.",
        "read it only inside that instance, or move it out of it";
    ALWAYS_NULL = "RCC1412", "A command is null in every cycle.",
        "give the first primitive of the chain a value, or replace null: `{type: OrElse, inputs: {in: …, other: …}}`";
    NO_TERMINATION = "RCC1501", "The net has no Termination.",
        "add `end: {type: Termination, inputs: {done: …}}`";
    MANY_TERMINATIONS = "RCC1502", "The net has more than one Termination.",
        "keep one, and give it both conditions by name: `done: {arrived: move.done, touched: touch.out}`";
    CLAIMED_TWICE = "RCC1503", "Two primitives command the same resource.",
        "keep one, and choose what it commands with Select";
    TOO_WIDE = "RCC1504", "A value has more elements than a monitor can show.",
        "monitor some elements";
    NET_TOO_LARGE = "RCC1505", "The net exceeds a limit of the executor.",
        "split the net";
    OWN_TOPIC = "RCC1506", "A net subscribes to a topic that it publishes itself.",
        "read the value by a link";
    NO_COUNTERPART = "RCC1601", "A part of a net of the predecessor has no counterpart.",
        "docs/from-the-predecessor.md lists the counterpart of each type";
    WRONG_ARM = "RCC1602", "A net of the predecessor was made for another arm.",
        "name the arm that it was made for: `# devices: NAME=DEVICE` before the net";
    NOT_CANCELABLE = "RCC1901", "The net commands an arm and has no Cancel (warning).",
        "add `cancel: {type: Cancel}` and let `cancel.requested` stop the motion";
    RATE_ROUNDED = "RCC1902", "A rate does not divide the cycle rate and was rounded (warning).",
        "choose a rate that divides the cycle rate";
    FRAGMENT_NOT_USED = "RCC1903", "A fragment is not used (warning).",
        "remove it, or move it to a library";
    NO_HISTORY = "RCC1911", "A debug history is not kept (warning).",
        "`rcc-cli watch` shows any port";
    NEVER_ENDS = "RCC1912", "A net of the predecessor never terminates (warning).",
        "name the results that end it: `# end: _1, _2` before the net";
}

/// Returns the general help text of a code.
#[must_use]
pub fn remedy(code: &str) -> Option<&'static str> {
    let description = DESCRIPTIONS
        .iter()
        .find(|description| description.code == code);
    description.map(|description| description.remedy)
}

#[cfg(test)]
mod tests {
    use super::DESCRIPTIONS;

    #[test]
    fn codes_are_sorted_and_free_of_duplicates() {
        assert!(
            DESCRIPTIONS
                .windows(2)
                .all(|pair| pair[0].code < pair[1].code)
        );
    }
}
