//! Extracts values from a parsed tree and collects all diagnostics, so that all faults of a file are reported together.
//! Used at start-up by programs that read a configuration; nothing here is real-time.

use std::f64::consts::PI;
use std::fmt::Display;

use rcc_core::counted::Counted;
use rcc_core::unit::Unit;

use crate::codes::{self, Code};
use crate::diagnostic::{Diagnostic, Span, closest};
use crate::file_kind::FileKind;
use crate::quantity::{self, QuantityError};
use crate::yaml::{Entry, Key, Node, Value};

/// Maximum length of a name, characters.
const NAME_LENGTH_MAX: usize = 32;

/// Collects the faults of one file. Every method that returns `None` has reported the reason.
#[derive(Debug, Default)]
pub(crate) struct ConfigReader {
    pub faults: Vec<Diagnostic>,
}

/// A mapping with a known set of keys.
#[derive(Clone, Copy)]
pub(crate) struct Fields<'n> {
    node: &'n Node,
    /// Position of the key before the mapping.
    pub place: Span,
    what: &'static str,
}

impl<'n> Fields<'n> {
    /// Returns an optional value; null counts as absent.
    pub fn get(&self, key: &str) -> Option<&'n Node> {
        let node = self.node.get(key)?;
        (node.value != Value::Null).then_some(node)
    }

    /// Returns the position of a key, or of the mapping if the key is absent.
    pub fn place_of(&self, key: &str) -> Span {
        self.entry(key).map_or(self.place, |entry| entry.key.span)
    }

    /// Returns a key with its value, unless it is absent or null.
    pub fn entry(&self, key: &str) -> Option<&'n Entry> {
        let mut entries = self.node.map()?.iter();
        entries.find(|entry| entry.key.name == key && entry.value.value != Value::Null)
    }
}

/// A unit with inclusive bounds.
#[derive(Clone, Copy)]
pub(crate) struct QuantityRange {
    pub unit: Unit,
    pub least: f64,
    pub most: f64,
}

impl QuantityRange {
    /// Accepts any finite number with this unit.
    pub const fn any(unit: Unit) -> QuantityRange {
        QuantityRange {
            unit,
            least: f64::MIN,
            most: f64::MAX,
        }
    }

    /// Accepts numbers greater than 0.
    pub const fn positive(unit: Unit) -> QuantityRange {
        QuantityRange {
            unit,
            least: f64::MIN_POSITIVE,
            most: f64::MAX,
        }
    }
}

/// Rule for a name: characters allowed at the beginning and after it, and a description.
#[derive(Clone, Copy)]
pub(crate) struct NameRule {
    pub first: fn(char) -> bool,
    pub further: fn(char) -> bool,
    pub words: &'static str,
}

/// Rule for names of cells.
pub(crate) const CELL_NAME: NameRule = NameRule {
    first: |c| c.is_ascii_lowercase() || c.is_ascii_digit(),
    further: |c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_' || c == '-',
    words: "1 to 32 of a-z 0-9 _ -, beginning with a letter or digit",
};

/// Rule for names of devices, drivers and simulators.
pub(crate) const DEVICE_NAME: NameRule = NameRule {
    first: |c| c.is_ascii_lowercase(),
    words: "1 to 32 of a-z 0-9 _ -, beginning with a letter",
    ..CELL_NAME
};

/// Rule for names of channels and ports.
pub(crate) const ID: NameRule = NameRule {
    first: |c| c.is_ascii_lowercase(),
    further: |c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_',
    words: "1 to 32 of a-z 0-9 _, beginning with a letter",
};

/// Rule for names of joints.
pub(crate) const JOINT_NAME: NameRule = NameRule {
    first: |c| c.is_ascii_alphabetic(),
    further: |c| c.is_ascii_alphanumeric() || c == '_',
    words: "1 to 32 of A-Z a-z 0-9 _, beginning with a letter",
};

impl ConfigReader {
    /// Adds a diagnostic.
    pub fn report(&mut self, fault: Diagnostic) {
        self.faults.push(fault);
    }

    /// Refuses a file of another kind with one fault, instead of one for each key that it lacks.
    pub fn expect_kind(&mut self, root: &Node, wanted: FileKind) -> Option<()> {
        let Some((kind, span)) = FileKind::of_tree(root).filter(|(kind, _)| *kind != wanted) else {
            return Some(());
        };
        let message = format!(
            "expected {}, found {}",
            wanted.described(),
            kind.described()
        );
        self.report(error(codes::WRONG_SHAPE, span, message).help(kind.usage()));
        None
    }

    /// Reads a mapping with these keys; reports others.
    pub fn fields<'n>(
        &mut self,
        node: &'n Node,
        place: Span,
        what: &'static str,
        keys: &[&'static str],
    ) -> Option<Fields<'n>> {
        self.fields_or(node, place, what, keys, ("", ""))
    }

    /// Like [`ConfigReader::fields`]; `gone` is a key from older files with its remedy.
    pub fn fields_or<'n>(
        &mut self,
        node: &'n Node,
        place: Span,
        what: &'static str,
        keys: &[&'static str],
        gone: (&str, &str),
    ) -> Option<Fields<'n>> {
        self.entries(node, what)?;
        for key in node.unknown_keys(keys) {
            let message = format!("{what} has no key `{}`", key.name);
            let help = match closest(&key.name, keys.iter().copied()) {
                _ if key.name == gone.0 => gone.1.to_owned(),
                Some(near) => format!("did you mean `{near}`?"),
                None => format!("its keys are: {}", keys.join(", ")),
            };
            self.report(error(codes::UNKNOWN_KEY, key.span, message).help(help));
        }
        Some(Fields { node, place, what })
    }

    /// Reads the entries of a mapping.
    pub fn entries<'n>(&mut self, node: &'n Node, what: &str) -> Option<&'n [Entry]> {
        let entries = node.map();
        if entries.is_none() {
            self.wrong_type(node, what, "a mapping (`key: value`)");
        }
        entries
    }

    /// Reads a required value.
    pub fn require<'n>(&mut self, fields: &Fields<'n>, key: &str) -> Option<&'n Node> {
        let node = fields.get(key);
        if node.is_none() {
            let message = format!("{} needs a key `{key}`", fields.what);
            self.report(
                error(codes::MISSING_KEY, fields.place, message).help(format!(
                    "add `{key}: …`; see the files in configs/ for examples"
                )),
            );
        }
        node
    }

    /// Reads a text.
    pub fn text<'n>(&mut self, node: &'n Node, what: &str) -> Option<&'n str> {
        let text = node.text();
        if text.is_none() {
            self.wrong_type(node, what, "text");
        }
        text
    }

    /// Reads the elements of a list.
    pub fn list<'n>(&mut self, node: &'n Node, what: &str) -> Option<&'n [Node]> {
        let list = node.list();
        if list.is_none() {
            self.wrong_type(node, what, "a list (`[a, b]`)");
        }
        list
    }

    /// Reads a list of exactly `N` elements.
    pub fn array<'n, const N: usize>(
        &mut self,
        node: &'n Node,
        what: &str,
    ) -> Option<&'n [Node; N]> {
        let list = self.list(node, what)?;
        let array = list.try_into().ok();
        if array.is_none() {
            let have = Counted::of(list.len(), "element");
            let message = format!("{what} has {have}, expected {N}");
            self.report(error(codes::WRONG_SHAPE, node.span, message));
        }
        array
    }

    /// Reads `true` or `false`.
    pub fn bool(&mut self, node: &Node, what: &str) -> Option<bool> {
        if let Value::Bool(value) = node.value {
            return Some(value);
        }
        self.wrong_type(node, what, "`true` or `false`");
        None
    }

    /// Reads an integer without unit, with inclusive bounds.
    pub fn integer(&mut self, node: &Node, what: &str, least: i64, most: i64) -> Option<i64> {
        let Value::Int(value) = node.value else {
            self.wrong_type(node, what, "a whole number");
            return None;
        };
        if (least..=most).contains(&value) {
            return Some(value);
        }
        let message = format!("{what} is {value}, but must be from {least} to {most}");
        self.report(error(codes::OUT_OF_RANGE, node.span, message));
        None
    }

    /// Reads a number with its unit; returns it in SI.
    pub fn quantity(&mut self, node: &Node, what: &str, wanted: QuantityRange) -> Option<f64> {
        let unit = wanted.unit;
        let quantity = match quantity::of(node) {
            Ok(quantity) => quantity,
            Err(QuantityError::NotANumber { .. }) => {
                self.wrong_type(node, what, format!("a number with a unit ({unit})"));
                return None;
            }
            Err(other) => {
                let help = format!(
                    "write a number and its unit, for example `{}`",
                    sample(unit)
                );
                self.report(error(codes::NOT_A_QUANTITY, node.span, other.to_string()).help(help));
                return None;
            }
        };
        match quantity.unit {
            None if unit != Unit::ONE => {
                let message = format!("{what} has no unit");
                let help = format!(
                    "add the unit, for example `{}`",
                    sample_of(quantity.value, unit)
                );
                let fault = error(codes::MISSING_UNIT, node.span, message);
                self.report(fault.label(format!("{unit}? {}?", scaled(unit))).help(help));
                return None;
            }
            Some(have) if have != unit => {
                let message = format!("{what} is measured in {unit}, not in {have}");
                let help = format!("for example `{}`", sample(unit));
                self.report(error(codes::WRONG_UNIT, node.span, message).help(help));
                return None;
            }
            _ => {}
        }
        let value = quantity.value;
        if (wanted.least..=wanted.most).contains(&value) {
            return Some(value);
        }
        self.out_of_range(node, what, value, wanted);
        None
    }

    fn out_of_range(&mut self, node: &Node, what: &str, value: f64, wanted: QuantityRange) {
        let QuantityRange { unit, least, most } = wanted;
        let range = match (least, most) {
            (f64::MIN_POSITIVE, f64::MAX) => "greater than 0".to_owned(),
            (f64::MIN_POSITIVE, _) => {
                format!("greater than 0 and at most {}", display_value(most, unit))
            }
            (_, f64::MAX) => format!("at least {}", display_value(least, unit)),
            _ => format!(
                "from {} to {}",
                display_value(least, unit),
                display_value(most, unit)
            ),
        };
        let message = format!(
            "{what} is {}, but must be {range}",
            display_value(value, unit)
        );
        self.report(error(codes::OUT_OF_RANGE, node.span, message));
    }

    /// Reads a time in whole nanoseconds, with inclusive bounds.
    pub fn nanoseconds(&mut self, node: &Node, what: &str, least: u64, most: u64) -> Option<u64> {
        let value = self.quantity(node, what, QuantityRange::any(Unit::SECOND))?;
        // Round before comparing: 100 us is slightly less than 1e-4 s. The cast saturates beyond its range.
        let ns = (value * 1e9).round();
        if ns >= 0.0 && (least..=most).contains(&(ns as u64)) {
            return Some(ns as u64);
        }
        let wanted = QuantityRange {
            unit: Unit::SECOND,
            least: least as f64 * 1e-9,
            most: most as f64 * 1e-9,
        };
        self.out_of_range(node, what, ns * 1e-9, wanted);
        None
    }

    /// Reads a lower and an upper bound.
    pub fn bounds(&mut self, node: &Node, what: &str, unit: Unit) -> Option<[f64; 2]> {
        let [lower, upper] = self.array(node, what)?;
        let lower = self.quantity(lower, what, QuantityRange::any(unit));
        let upper = self.quantity(upper, what, QuantityRange::any(unit));
        let (lower, upper) = (lower?, upper?);
        if lower < upper {
            return Some([lower, upper]);
        }
        let message = format!("{what}: the lower bound must be less than the upper one");
        let label = format!(
            "{} is not less than {}",
            display_value(lower, unit),
            display_value(upper, unit)
        );
        let fault = error(codes::REVERSED, node.span, message).label(label);
        self.report(fault.help("write the lower bound first: `[lower, upper]`"));
        None
    }

    /// Checks a name that is a key.
    pub fn key_name(&mut self, key: &Key, what: &str, form: NameRule) -> Option<String> {
        self.name(&key.name, key.span, what, form)
    }

    /// Checks a name.
    pub fn name(&mut self, name: &str, span: Span, what: &str, form: NameRule) -> Option<String> {
        let mut characters = name.chars();
        let fits = characters.next().is_some_and(form.first)
            && characters.all(form.further)
            && name.len() <= NAME_LENGTH_MAX;
        if fits {
            return Some(name.to_owned());
        }
        let message = format!("invalid name `{name}` for {what}");
        self.report(error(codes::BAD_NAME, span, message).help(format!("use {}", form.words)));
        None
    }

    /// Reports more than `most` elements, at the first one too many.
    pub fn at_most(&mut self, most: usize, what: &str, places: &[Span]) {
        if let Some(place) = places.get(most) {
            let message = format!("{} {what}, the maximum is {most}", places.len());
            self.report(error(codes::TOO_MANY, *place, message).label("the first one too many"));
        }
    }

    /// Reads one of several keywords.
    pub fn keyword<T: Copy>(&mut self, node: &Node, what: &str, words: &[(&str, T)]) -> Option<T> {
        let text = self.text(node, what)?;
        if let Some((_, value)) = words.iter().find(|(word, _)| *word == text) {
            return Some(*value);
        }
        let known = words.iter().map(|(word, _)| *word);
        let help = match closest(text, known.clone()) {
            Some(near) => format!("did you mean `{near}`?"),
            None => format!("known values: {}", known.collect::<Vec<_>>().join(", ")),
        };
        let message = format!("unknown {what} `{text}`");
        self.report(error(codes::UNKNOWN_KIND, node.span, message).help(help));
        None
    }

    /// Reports a value of the wrong type.
    pub fn wrong_type(&mut self, node: &Node, what: &str, expected: impl Display) {
        let message = format!("{what} must be {expected}, found {}", node.kind());
        self.report(error(codes::WRONG_SHAPE, node.span, message));
    }
}

/// Creates an error of this kind.
pub(crate) fn error(code: Code, place: Span, message: impl Into<String>) -> Diagnostic {
    Diagnostic::error(code.code, place, message)
}

/// Formats a value in common units, without rounding noise from the conversion to SI.
pub(crate) fn display_value(value: f64, unit: Unit) -> String {
    let (scale, name) = match unit {
        Unit::SECOND if value == 0.0 || value.abs() >= 0.9995 => (1.0, "s".to_owned()),
        Unit::SECOND => (1e3, "ms".to_owned()),
        _ if unit.to_string().contains("rad") => (180.0 / PI, scaled(unit)),
        _ => (1.0, unit.to_string()),
    };
    let value = value * scale;
    let rounded = (value * 1e6).round() / 1e6;
    let value = if rounded == 0.0 { value } else { rounded };
    format!("{value} {name}")
}

/// Returns the common form of a unit.
fn scaled(unit: Unit) -> String {
    match unit {
        Unit::SECOND => "ms".to_owned(),
        Unit::METRE => "mm".to_owned(),
        _ => unit.to_string().replace("rad", "deg"),
    }
}

fn sample_of(value: f64, unit: Unit) -> String {
    if unit == Unit::RADIAN {
        format!("deg({value})")
    } else {
        format!("{value} {}", scaled(unit))
    }
}

fn sample(unit: Unit) -> String {
    sample_of(10.0, unit)
}
