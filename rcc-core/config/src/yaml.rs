//! The common parser of nets and configurations, for hand-written YAML and generated JSON, into a tree with positions.
//! Refuses what would silently be misread (duplicate keys) or needs unbounded resources. Never used on the real-time
//! thread.

pub mod annotated;
mod common_forms;
pub mod layout;
pub mod scalar;
mod tree;

use compact_str::CompactString;
use granit_parser::Parser;
use rcc_core::printable::first_unprintable;

use crate::diagnostic::{Diagnostic, Span};
use tree::TreeBuilder;

/// Maximum length of a text, bytes.
pub const BYTES_MAX: usize = 4 << 20;
/// Maximum nesting of lists and mappings.
pub const DEPTH_MAX: usize = 32;

/// The text is not YAML or JSON.
pub const BROKEN: &str = "RCC1001";
/// A key occurs twice in one mapping.
pub const DUPLICATE_KEY: &str = "RCC1002";
/// The text is too long or nested too deeply.
pub const TOO_LARGE: &str = "RCC1003";
/// YAML that is not supported: anchors, aliases, tags, several documents, keys that are not text.
pub const NOT_SUPPORTED: &str = "RCC1004";
/// A key or a text contains an unprintable character, which could control the terminal of a reader.
pub const UNPRINTABLE: &str = "RCC1005";

/// A text of the tree. Most are names and links of at most 24 bytes, which need no memory of their own.
pub type ShortText = CompactString;

/// A value and its position.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// The value.
    pub value: Value,
    /// Position; for a list or mapping from its first to its last character.
    pub span: Span,
}

/// A parsed value. Numbers follow JSON and YAML 1.2, except that octal, hexadecimal and leading zeros stay text.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// `null`, `~` or an empty value.
    Null,
    /// `true` or `false`; `yes`, `on` and similar words are text.
    Bool(bool),
    /// An integer that fits into 64 bits.
    Int(i64),
    /// Any other finite number.
    Real(f64),
    /// Everything else, and every quoted value.
    Text(ShortText),
    /// A list.
    List(Vec<Node>),
    /// A mapping, in the order of the text, without duplicate keys.
    Map(Vec<Entry>),
}

/// A key with its value.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// The key.
    pub key: Key,
    /// The value.
    pub value: Node,
}

/// A key and its position.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Key {
    /// The text.
    pub name: ShortText,
    /// Position.
    pub span: Span,
}

impl Node {
    /// Returns the type for messages: `a number`, `a mapping`, …
    #[must_use]
    pub fn kind(&self) -> &'static str {
        match self.value {
            Value::Null => "null",
            Value::Bool(_) => "a truth value",
            Value::Int(_) | Value::Real(_) => "a number",
            Value::Text(_) => "text",
            Value::List(_) => "a list",
            Value::Map(_) => "a mapping",
        }
    }

    /// Returns the text, if the value is text.
    #[must_use]
    pub fn text(&self) -> Option<&str> {
        match &self.value {
            Value::Text(text) => Some(text),
            _ => None,
        }
    }

    /// Returns the elements, if the value is a list.
    #[must_use]
    pub fn list(&self) -> Option<&[Node]> {
        match &self.value {
            Value::List(nodes) => Some(nodes),
            _ => None,
        }
    }

    /// Returns the entries, if the value is a mapping.
    #[must_use]
    pub fn map(&self) -> Option<&[Entry]> {
        match &self.value {
            Value::Map(entries) => Some(entries),
            _ => None,
        }
    }

    /// Returns the value of a key, if the value is a mapping that has it.
    #[must_use]
    pub fn get(&self, key: &str) -> Option<&Node> {
        let entry = self.map()?.iter().find(|entry| entry.key.name == key)?;
        Some(&entry.value)
    }

    /// Returns the keys of a mapping that are not in `known`.
    pub fn unknown_keys<'a>(&'a self, known: &'a [&str]) -> impl Iterator<Item = &'a Key> {
        let entries = self.map().unwrap_or(&[]).iter();
        entries
            .map(|entry| &entry.key)
            .filter(|key| !known.contains(&key.name.as_str()))
    }

    /// Returns the value without positions.
    #[must_use]
    pub fn to_json(&self) -> serde_json::Value {
        use serde_json::Value as Json;
        match &self.value {
            Value::Null => Json::Null,
            Value::Bool(value) => Json::from(*value),
            Value::Int(value) => Json::from(*value),
            Value::Real(value) => Json::from(*value),
            Value::Text(text) => Json::from(text.as_str()),
            Value::List(nodes) => nodes.iter().map(Node::to_json).collect(),
            Value::Map(entries) => {
                let pairs = entries.iter();
                let pairs = pairs.map(|entry| (entry.key.name.to_string(), entry.value.to_json()));
                Json::Object(pairs.collect())
            }
        }
    }
}

/// Parses one document of YAML or JSON.
///
/// # Errors
/// Returns [`BROKEN`], [`TOO_LARGE`] or [`NOT_SUPPORTED`] at the first place where parsing fails, and all
/// [`DUPLICATE_KEY`] and [`UNPRINTABLE`] faults up to there.
pub fn parse(text: &str) -> Result<Node, Vec<Diagnostic>> {
    match read(text) {
        (Some(node), faults) if faults.is_empty() => Ok(node),
        (_, faults) => Err(faults),
    }
}

/// Like [`parse`], but also returns the tree of a text whose only faults are duplicate keys (the first of each counts)
/// or unprintable characters, so that a caller can go on and report further faults.
#[must_use]
pub fn read(text: &str) -> (Option<Node>, Vec<Diagnostic>) {
    if text.len() > BYTES_MAX {
        let length = text.len();
        let message = format!("the text has {length} bytes, the limit is {BYTES_MAX}");
        let fault = Diagnostic::error(TOO_LARGE, Span::default(), message).anywhere();
        return (None, vec![fault]);
    }
    match common_forms::read(text) {
        Some(root) => (Some(root), Vec::new()),
        None => read_any_form(text),
    }
}

/// Reads with the general parser.
fn read_any_form(text: &str) -> (Option<Node>, Vec<Diagnostic>) {
    let mut builder = TreeBuilder::new(text);
    for next in Parser::new_from_str(text) {
        let step = match next {
            Ok((event, span)) => builder.take(event, span),
            Err(error) => {
                let at = error.marker().byte_offset().unwrap_or(0);
                Err(Box::new(broken(text, at, &error.info())))
            }
        };
        if let Err(fault) = step {
            builder.faults.push(*fault);
            return (None, builder.faults);
        }
    }
    builder.finish()
}

fn broken(text: &str, at: usize, message: &str) -> Diagnostic {
    let at = (0..=at.min(text.len()))
        .rev()
        .find(|at| text.is_char_boundary(*at))
        .unwrap_or(0);
    let line = message.split('\n').next().unwrap_or_default();
    // The character at the position; empty at the end of the text.
    let length = text[at..].chars().next().map_or(0, char::len_utf8);
    let fault = Diagnostic::error(BROKEN, Span::new(at, at + length), "not valid YAML or JSON");
    let fault = fault.label(line.to_string());
    let tab = text.get(..at).is_some_and(|before| {
        let line = before.rsplit('\n').next().unwrap_or_default();
        line.contains('\t')
    }) || text.get(at..).is_some_and(|rest| rest.starts_with('\t'));
    fault.help(if tab {
        "YAML is indented with spaces, not with tabs".to_owned()
    } else if let Some(part) = unquoted_part(text, at) {
        format!("within `{{…}}` and `[…]` a part of a value is written in quotes: \"{part}\"")
    } else {
        "check the indentation, unclosed brackets and quotes, and the `: ` after keys".to_owned()
    })
}

/// Returns the text such as `a.out[2]` whose bracket is at this position.
fn unquoted_part(text: &str, bracket: usize) -> Option<&str> {
    let rest = text.get(bracket..)?.strip_prefix('[')?;
    let is_name = |c: char| c.is_ascii_alphanumeric() || "._/-".contains(c);
    let before = text.get(..bracket)?;
    let begin = before.trim_end_matches(is_name).len();
    let end = rest.find(']').filter(|end| {
        rest[..*end]
            .chars()
            .all(|c| c.is_ascii_digit() || "., ".contains(c))
    })?;
    (begin < bracket).then(|| &text[begin..bracket + end + 2])
}

/// Reports an unprintable character: names from nets and configurations are printed by every program of a cell.
fn unprintable(text: &str, span: Span) -> Option<Diagnostic> {
    // Nearly all texts are ASCII, which is checked faster.
    if text.bytes().all(|byte| matches!(byte, b' '..=b'~')) {
        return None;
    }
    let (_, character) = first_unprintable(text)?;
    let message = format!(
        "the text contains the unprintable character U+{:04X}",
        u32::from(character)
    );
    let fault = Diagnostic::error(UNPRINTABLE, span, message);
    Some(fault.help("remove it; line feeds and tabs are allowed"))
}

fn plain(text: &str) -> Value {
    match text {
        "" | "~" | "null" => return Value::Null,
        "true" => return Value::Bool(true),
        "false" => return Value::Bool(false),
        _ => {}
    }
    number(text).unwrap_or_else(|| Value::Text(ShortText::new(text)))
}

/// Parses a number as in JSON, also with a leading `+` or with digits on only one side of the point.
fn number(text: &str) -> Option<Value> {
    // Most texts are names.
    if !matches!(text.as_bytes().first()?, b'+' | b'-' | b'.' | b'0'..=b'9') {
        return None;
    }
    let digits = text.strip_prefix(['+', '-']).unwrap_or(text);
    let (mantissa, exponent) = match digits.split_once(['e', 'E']) {
        Some((mantissa, exponent)) => (mantissa, Some(exponent)),
        None => (digits, None),
    };
    let all_digits = |part: &str| part.bytes().all(|byte| byte.is_ascii_digit());
    let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    let well_formed = !(whole.is_empty() && fraction.is_empty())
        && all_digits(whole)
        && all_digits(fraction)
        && (whole.len() <= 1 || !whole.starts_with('0'))
        && exponent.is_none_or(|exponent| {
            let exponent = exponent.strip_prefix(['+', '-']).unwrap_or(exponent);
            !exponent.is_empty() && all_digits(exponent)
        });
    if !well_formed {
        return None;
    }
    if exponent.is_none() && !mantissa.contains('.') {
        // i64::MIN represents the null of an Int.
        if let Ok(value) = text.parse::<i64>()
            && value != i64::MIN
        {
            return Some(Value::Int(value));
        }
    }
    let value: f64 = text.parse().ok()?;
    value.is_finite().then_some(Value::Real(value))
}

#[cfg(test)]
mod tests;
