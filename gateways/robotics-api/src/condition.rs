//! Conditions of synchronization rules: `t`, `net.key`, `!`, `&`, `|` and parentheses, in three-valued logic. Pure
//! functions.

use std::collections::BTreeSet;

use crate::text_reader::{TextReader, Unexpected};

/// Deepest nesting of parentheses and negations.
const DEPTH_MAX: usize = 32;

/// A condition.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Condition {
    /// `t`.
    Always,
    /// The value with this key, of this net.
    Value {
        /// Name of the net.
        net: String,
        /// Key with its prefix: `out_2`.
        key: String,
    },
    /// Not.
    Not(Box<Condition>),
    /// All of them.
    All(Vec<Condition>),
    /// Any of them.
    Any(Vec<Condition>),
}

/// The text is not a condition.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected {wanted} at character {at} of the condition")]
pub struct ConditionError {
    wanted: &'static str,
    at: usize,
}

impl From<Unexpected> for ConditionError {
    fn from(Unexpected { wanted, at }: Unexpected) -> ConditionError {
        ConditionError { wanted, at }
    }
}

impl Condition {
    /// Parses a condition.
    ///
    /// # Errors
    /// Returns the first position at which the text is not a condition.
    pub fn parse(text: &str) -> Result<Condition, ConditionError> {
        let mut reader = TextReader::new(text);
        let condition = reader.any(0)?;
        reader.blanks();
        match reader.peek() {
            None => Ok(condition),
            Some(_) => Err(reader.wanted("`&`, `|` or the end").into()),
        }
    }

    /// Returns the value of the condition; `None` if it is indeterminate.
    pub fn value(&self, of: &impl Fn(&str, &str) -> Option<bool>) -> Option<bool> {
        match self {
            Condition::Always => Some(true),
            Condition::Value { net, key } => of(net, key),
            Condition::Not(inner) => inner.value(of).map(|value| !value),
            Condition::All(parts) => combine(parts, of, false),
            Condition::Any(parts) => combine(parts, of, true),
        }
    }

    /// Returns the values that the condition reads, as net and key.
    #[must_use]
    pub fn reads(&self) -> BTreeSet<(&str, &str)> {
        match self {
            Condition::Always => BTreeSet::new(),
            Condition::Value { net, key } => BTreeSet::from([(net.as_str(), key.as_str())]),
            Condition::Not(inner) => inner.reads(),
            Condition::All(parts) | Condition::Any(parts) => {
                parts.iter().flat_map(Condition::reads).collect()
            }
        }
    }
}

/// Returns `decisive` if one part has this value, nothing if one is indeterminate, and else the opposite.
fn combine(
    parts: &[Condition],
    of: &impl Fn(&str, &str) -> Option<bool>,
    decisive: bool,
) -> Option<bool> {
    let values: Vec<Option<bool>> = parts.iter().map(|part| part.value(of)).collect();
    if values.contains(&Some(decisive)) {
        return Some(decisive);
    }
    (!values.contains(&None)).then_some(!decisive)
}

/// The grammar: `any` of `all` of `one`.
impl TextReader<'_> {
    fn any(&mut self, depth: usize) -> Result<Condition, Unexpected> {
        let mut parts = vec![self.all(depth)?];
        while self.take(b'|') {
            parts.push(self.all(depth)?);
        }
        Ok(only(parts, Condition::Any))
    }

    fn all(&mut self, depth: usize) -> Result<Condition, Unexpected> {
        let mut parts = vec![self.one(depth)?];
        while self.take(b'&') {
            parts.push(self.one(depth)?);
        }
        Ok(only(parts, Condition::All))
    }

    fn one(&mut self, depth: usize) -> Result<Condition, Unexpected> {
        if depth > DEPTH_MAX {
            return Err(self.wanted("a condition that is nested less deeply"));
        }
        if self.take(b'!') {
            return Ok(Condition::Not(Box::new(self.one(depth + 1)?)));
        }
        if self.take(b'(') {
            let inner = self.any(depth + 1)?;
            self.expect(b')', "`)`")?;
            return Ok(inner);
        }
        let net = self.name("`t` or a net")?;
        match self.take(b'.') {
            true => Ok(Condition::Value {
                net,
                key: self.name("a key")?,
            }),
            false if net == "t" => Ok(Condition::Always),
            false => Err(self.wanted("`.` and a key")),
        }
    }

    fn name(&mut self, wanted: &'static str) -> Result<String, Unexpected> {
        self.blanks();
        let is_part = |byte: u8| byte.is_ascii_alphanumeric() || byte == b'_' || byte == b':';
        match self.while_byte(is_part) {
            "" => Err(self.wanted(wanted)),
            name => Ok(name.to_owned()),
        }
    }
}

fn only(mut parts: Vec<Condition>, many: impl Fn(Vec<Condition>) -> Condition) -> Condition {
    match parts.len() {
        1 => parts.swap_remove(0),
        _ => many(parts),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `a.y` is true, `a.n` false, `a.u` indeterminate.
    fn value(text: &str) -> Option<bool> {
        let condition = Condition::parse(text).expect(text);
        condition.value(&|_, key| match key {
            "y" => Some(true),
            "n" => Some(false),
            _ => None,
        })
    }

    #[test]
    fn logic_has_three_values() {
        for (text, expected) in [
            ("t", Some(true)),
            ("!t", Some(false)),
            ("a.y", Some(true)),
            ("a.u", None),
            ("!a.u", None),
            ("a.y & a.u", None),
            ("a.n&a.u", Some(false)),
            ("a.y|a.u", Some(true)),
            ("a.n|a.u", None),
            ("a.n|a.y&a.y", Some(true)),
            ("(a.n|a.y)&!a.n", Some(true)),
            ("t.y", Some(true)),
        ] {
            assert_eq!(value(text), expected, "{text}");
        }
    }

    #[test]
    fn values_are_found_and_what_is_no_condition_is_refused() {
        let condition =
            Condition::parse("rpinet1.out_2 & !rpinet2.out_3 & rpinet1.out_2").expect("one");
        let reads: Vec<_> = condition.reads().into_iter().collect();
        assert_eq!(reads, [("rpinet1", "out_2"), ("rpinet2", "out_3")]);
        let deep = "!".repeat(1000) + "t";
        for text in [
            "",
            "a",
            "a.",
            "a.b &",
            "(a.b",
            "a.b)",
            "t t",
            "REJECTED.out",
            &deep,
        ] {
            let refused = Condition::parse(text);
            assert_eq!(refused.is_err(), text != "REJECTED.out", "{text}");
        }
    }
}
