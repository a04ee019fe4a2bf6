//! Messages of the protocol "DirectIO" 2.0: `tag=command(value,…)`, the same in both directions. Pure functions; run by
//! the threads of the connections and of the engine.

use std::fmt::{self, Write as _};

use crate::text_reader::{SyntaxError, TextReader};

/// Deepest nesting of lists and maps in a message.
const DEPTH_MAX: usize = 16;

/// A value in a message.
#[derive(Clone, Debug, PartialEq)]
pub enum DioValue {
    /// A text in quotes.
    Text(String),
    /// A number without a point. The protocol has neither sign nor exponent.
    Integer(u64),
    /// A number with a point.
    Float(f64),
    /// `[a,b]`.
    List(Vec<DioValue>),
    /// `{key:a}`, in the order of the text.
    Map(Vec<(String, DioValue)>),
}

impl DioValue {
    /// Returns a text.
    #[must_use]
    pub fn text(&self) -> Option<&str> {
        match self {
            DioValue::Text(text) => Some(text),
            _ => None,
        }
    }

    /// Returns a number, with or without a point.
    #[must_use]
    pub fn number(&self) -> Option<f64> {
        match self {
            DioValue::Integer(number) => Some(*number as f64),
            DioValue::Float(number) => Some(*number),
            _ => None,
        }
    }

    /// Returns the texts of a list of texts.
    #[must_use]
    pub fn texts(&self) -> Option<Vec<String>> {
        match self {
            DioValue::List(values) => values
                .iter()
                .map(|value| value.text().map(str::to_owned))
                .collect(),
            _ => None,
        }
    }
}

/// A message.
#[derive(Clone, Debug, PartialEq)]
pub struct DioMessage {
    /// Names the request that a message answers, or the subscription that it belongs to.
    pub tag: String,
    /// The request, answer or push.
    pub command: String,
    /// Its values.
    pub values: Vec<DioValue>,
}

impl DioMessage {
    /// Returns a message.
    #[must_use]
    pub fn new(tag: &str, command: &str, values: Vec<DioValue>) -> DioMessage {
        DioMessage {
            tag: tag.to_owned(),
            command: command.to_owned(),
            values,
        }
    }
}

/// Parses a message.
///
/// # Errors
/// Returns the first position at which the text is not a message.
pub fn parse(text: &str) -> Result<DioMessage, SyntaxError> {
    let mut reader = TextReader::new(text);
    let tag = reader.identifier("a tag")?;
    reader.expect(b'=', "`=`")?;
    let command = reader.identifier("a command")?;
    reader.expect(b'(', "`(`")?;
    let values = reader.separated(b')', "`,` or `)`", |reader| reader.value(0))?;
    reader.blanks();
    match reader.peek() {
        None => Ok(DioMessage {
            tag,
            command,
            values,
        }),
        Some(_) => Err(reader.wanted("the end of the message")),
    }
}

/// The grammar.
impl TextReader<'_> {
    fn identifier(&mut self, wanted: &'static str) -> Result<String, SyntaxError> {
        self.blanks();
        if !self.peek().is_some_and(begins_identifier) {
            return Err(self.wanted(wanted));
        }
        Ok(self.while_byte(continues_identifier).to_owned())
    }

    /// Reads what stands between an opening bracket, which was taken, and `end`.
    fn separated<T>(
        &mut self,
        end: u8,
        wanted: &'static str,
        mut one: impl FnMut(&mut Self) -> Result<T, SyntaxError>,
    ) -> Result<Vec<T>, SyntaxError> {
        let mut all = Vec::new();
        if self.take(end) {
            return Ok(all);
        }
        loop {
            all.push(one(self)?);
            if self.take(end) {
                return Ok(all);
            }
            self.expect(b',', wanted)?;
        }
    }

    fn value(&mut self, depth: usize) -> Result<DioValue, SyntaxError> {
        self.blanks();
        match self.peek() {
            Some(b'[' | b'{') if depth >= DEPTH_MAX => {
                Err(self.wanted("a value that is nested less deeply"))
            }
            Some(b'[') => {
                self.at += 1;
                let values =
                    self.separated(b']', "`,` or `]`", |reader| reader.value(depth + 1))?;
                Ok(DioValue::List(values))
            }
            Some(b'{') => {
                self.at += 1;
                let entries = self.separated(b'}', "`,` or `}`", |reader| {
                    let key = match reader.take(b'"') {
                        true => reader.rest_of_text()?,
                        false => reader.identifier("a key")?,
                    };
                    reader.expect(b':', "`:`")?;
                    Ok((key, reader.value(depth + 1)?))
                })?;
                Ok(DioValue::Map(entries))
            }
            Some(b'"') => {
                self.at += 1;
                self.rest_of_text().map(DioValue::Text)
            }
            _ => self.number(),
        }
    }

    fn number(&mut self) -> Result<DioValue, SyntaxError> {
        let refused = self.wanted("a value");
        let text = self.while_byte(|byte| byte.is_ascii_digit() || byte == b'.');
        let parsed = match text.contains('.') {
            true => text.parse().ok().map(DioValue::Float),
            false => text.parse().ok().map(DioValue::Integer),
        };
        parsed.ok_or(refused)
    }

    /// Reads a text behind its first quote.
    fn rest_of_text(&mut self) -> Result<String, SyntaxError> {
        let mut text = String::new();
        let rest = self.text.get(self.at..).unwrap_or_default();
        let mut characters = rest.char_indices();
        while let Some((at, character)) = characters.next() {
            match character {
                '"' => {
                    self.at += at + 1;
                    return Ok(text);
                }
                '\\' => match characters.next() {
                    Some((_, escaped @ ('"' | '\\'))) => text.push(escaped),
                    _ => {
                        self.at += at;
                        return Err(self.wanted("`\\\"` or `\\\\`"));
                    }
                },
                other => text.push(other),
            }
        }
        self.at = self.text.len();
        Err(self.wanted("`\"`"))
    }
}

fn begins_identifier(byte: u8) -> bool {
    byte.is_ascii_alphabetic() || byte == b'_'
}

fn continues_identifier(byte: u8) -> bool {
    byte.is_ascii_alphanumeric() || byte == b'_'
}

/// Returns true for a text that may be a tag, a command or the name of a net.
#[must_use]
pub fn is_identifier(text: &str) -> bool {
    text.bytes().next().is_some_and(begins_identifier) && text.bytes().all(continues_identifier)
}

impl fmt::Display for DioMessage {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}={}(", self.tag, self.command)?;
        write_separated(formatter, &self.values, |formatter, value| {
            write!(formatter, "{value}")
        })?;
        formatter.write_char(')')
    }
}

impl fmt::Display for DioValue {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            DioValue::Text(text) => quoted(formatter, text),
            DioValue::Integer(number) => write!(formatter, "{number}"),
            // Always with a point, without an exponent.
            DioValue::Float(number) => write!(formatter, "{number:.6}"),
            DioValue::List(values) => {
                formatter.write_char('[')?;
                write_separated(formatter, values, |formatter, value| {
                    write!(formatter, "{value}")
                })?;
                formatter.write_char(']')
            }
            DioValue::Map(entries) => {
                formatter.write_char('{')?;
                write_separated(formatter, entries, |formatter, (key, value)| {
                    match is_identifier(key) {
                        true => formatter.write_str(key)?,
                        false => quoted(formatter, key)?,
                    }
                    write!(formatter, ":{value}")
                })?;
                formatter.write_char('}')
            }
        }
    }
}

fn write_separated<T>(
    formatter: &mut fmt::Formatter<'_>,
    all: &[T],
    one: impl Fn(&mut fmt::Formatter<'_>, &T) -> fmt::Result,
) -> fmt::Result {
    for (index, value) in all.iter().enumerate() {
        if index > 0 {
            formatter.write_char(',')?;
        }
        one(formatter, value)?;
    }
    Ok(())
}

/// Writes a text in quotes, in ASCII: the client reads another encoding on each platform.
fn quoted(formatter: &mut fmt::Formatter<'_>, text: &str) -> fmt::Result {
    formatter.write_char('"')?;
    for character in text.chars() {
        match character {
            '"' => formatter.write_str("\\\"")?,
            '\\' => formatter.write_str("\\\\")?,
            other if other.is_ascii() => formatter.write_char(other)?,
            _ => formatter.write_char('?')?,
        }
    }
    formatter.write_char('"')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_is_read_and_written_alike() {
        let text = r#"c3=snc({rpinet1:{in_28:"1.0"},"a b":{}},[1,2.500000],"a \"quote\" \\ and a
line break")"#;
        let message = parse(text).expect("a message");
        assert_eq!((&*message.tag, &*message.command), ("c3", "snc"));
        assert_eq!(message.values.len(), 3);
        assert_eq!(message.to_string(), text);
        assert_eq!(
            parse(" c0 = gde ( ) ").expect("blanks").to_string(),
            "c0=gde()"
        );
    }

    #[test]
    fn numbers_have_neither_sign_nor_exponent() {
        let values = parse("c=x(0.02,.5,5.,7)").expect("numbers").values;
        let numbers: Vec<f64> = values.iter().filter_map(DioValue::number).collect();
        assert_eq!(numbers, [0.02, 0.5, 5.0, 7.0]);
        for wrong in [
            "c=x(-1)",
            "c=x(1e3)",
            "c=x(1.2.3)",
            "c=x(.)",
            "c=x(99999999999999999999)",
        ] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn what_is_no_message_is_refused_with_its_place() {
        for (text, at) in [
            ("", 0),
            ("c0", 2),
            ("0c=x()", 0),
            ("c0=x(", 5),
            ("c0=x(1", 6),
            ("c0=x(1,)", 7),
            ("c0=x() y", 7),
            ("c0=x(\"a)", 8),
            ("c0=x(\"\\n\")", 6),
            ("c0=x({a})", 7),
        ] {
            assert_eq!(parse(text).expect_err(text).at, at, "{text}");
        }
        let deep = format!("c0=x({}{})", "[".repeat(100), "]".repeat(100));
        assert!(parse(&deep).is_err());
    }

    #[test]
    fn texts_are_sent_in_ascii() {
        let message = DioMessage::new(
            "c1",
            "err",
            vec![DioValue::Text("90\u{b0} \"a\"".to_owned())],
        );
        assert_eq!(message.to_string(), r#"c1=err("90? \"a\"")"#);
    }
}
