//! Conditions of synchronization rules: `t`, `net.key`, `!`, `&`, `|` and parentheses, in three-valued logic. Pure
//! functions.

use std::collections::BTreeSet;

use crate::text_reader::{SyntaxError, TextReader};

/// Deepest nesting of parentheses and negations.
const DEPTH_MAX: usize = 32;

/// A condition.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Condition {
    /// `t`.
    #[default]
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

impl Condition {
    /// Parses a condition.
    ///
    /// # Errors
    /// Returns the first position at which the text is not a condition.
    pub fn parse(text: &str) -> Result<Condition, SyntaxError> {
        let mut reader = TextReader::new(text);
        let condition = reader.any(0)?;
        reader.blanks();
        match reader.peek() {
            None => Ok(condition),
            Some(_) => Err(reader.wanted("`&`, `|` or the end")),
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

/// Writes a condition as the core's rules have it; `port` names the port of a value, and has no name for one that the core
/// cannot read.
pub fn core_text(
    condition: &Condition,
    port: &impl Fn(&str, &str) -> Option<String>,
) -> Option<String> {
    let joined = |parts: &[Condition], word: &str| {
        let parts = parts.iter().map(|part| core_text(part, port));
        let parts: Option<Vec<String>> = parts.collect();
        Some(format!("({})", parts?.join(word)))
    };
    match condition {
        Condition::Always => Some("true".to_owned()),
        Condition::Value { net, key } => Some(format!("{net}.{}", port(net, key)?)),
        Condition::Not(inner) => Some(format!("not {}", core_text(inner, port)?)),
        Condition::All(parts) => joined(parts, " and "),
        Condition::Any(parts) => joined(parts, " or "),
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
    fn any(&mut self, depth: usize) -> Result<Condition, SyntaxError> {
        let mut parts = vec![self.all(depth)?];
        while self.take(b'|') {
            parts.push(self.all(depth)?);
        }
        Ok(only(parts, Condition::Any))
    }

    fn all(&mut self, depth: usize) -> Result<Condition, SyntaxError> {
        let mut parts = vec![self.one(depth)?];
        while self.take(b'&') {
            parts.push(self.one(depth)?);
        }
        Ok(only(parts, Condition::All))
    }

    fn one(&mut self, depth: usize) -> Result<Condition, SyntaxError> {
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

    fn name(&mut self, wanted: &'static str) -> Result<String, SyntaxError> {
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
    fn the_core_judges_the_same_condition() {
        for (text, expected) in [
            ("t", Some("true")),
            ("a.y", Some("a.p.y")),
            ("!a.y&b.n|a.y", Some("((not a.p.y and b.p.n) or a.p.y)")),
            ("!(a.y|!b.n)", Some("not (a.p.y or not b.p.n)")),
            ("a.y&b.constant", None),
        ] {
            let condition = Condition::parse(text).expect(text);
            let port = |_: &str, key: &str| (key != "constant").then(|| format!("p.{key}"));
            let written = core_text(&condition, &port);
            assert_eq!(written.as_deref(), expected, "{text}");
            // It is one that the core reads.
            let read = written.map(|written| rcc_language::condition::parse(&written).is_ok());
            assert_eq!(read, expected.map(|_| true), "{text}");
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
