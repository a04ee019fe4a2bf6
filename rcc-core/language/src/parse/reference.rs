//! `primitive.port`, `primitive.port[index]` and `primitive.port.x`. Runs on the loader's threads.

use rcc_config::diagnostic::{Diagnostic, Span};
use rcc_config::yaml::{Node, ShortText};

use crate::codes;
use crate::syntax::part::{self, ValuePart};
use crate::syntax::reference::Reference;

/// Reads `text`, the text of `node`.
pub fn read(node: &Node, text: &str, diagnostics: &mut Vec<Diagnostic>) -> Option<Reference> {
    let parsed = parse(text, node.span);
    if parsed.is_none() {
        let message = format!("`{text}` is not a reference to an output");
        let diagnostic = Diagnostic::error(codes::WRONG_SHAPE, node.span, message);
        diagnostics.push(diagnostic.help(
            "write an output as `primitive.port`, a part of it as `primitive.port[index]`, `[from..to]`, `[row,column]`, `[row,..]`, `.x` or `.position`",
        ));
    }
    parsed
}

/// Parses a reference. With escapes, or if the text is not written at the span as it is, its names have the whole span.
pub(crate) fn parse(text: &str, span: Span) -> Option<Reference> {
    let (primitive, rest) = word(text)?;
    let (port, rest) = match rest.strip_prefix('.') {
        Some(rest) => word(rest)?,
        None => ("", rest),
    };
    let part = match rest {
        "" => None,
        rest => Some(part(rest)?),
    };
    // Quotes are in the span but not in the text. With escapes the positions do not correspond, so the whole span is
    // used.
    let extra = (span.end - span.start).checked_sub(text.len());
    let split = match extra {
        Some(extra @ (0 | 2)) if !port.is_empty() => {
            let start = span.start + extra / 2;
            let dot = start + primitive.len();
            Some((
                Span::new(start, dot),
                Span::new(dot + 1, start + text.len()),
            ))
        }
        _ => None,
    };
    let (primitive_span, port_span) = split.unwrap_or((span, span));
    Some(Reference {
        primitive: ShortText::new(primitive),
        port: ShortText::new(port),
        part,
        span,
        primitive_span,
        port_span,
    })
}

/// Splits a text into the name with which it begins (letters, digits, `_` and `-`) and the rest; `None` if it begins with
/// another character.
fn word(text: &str) -> Option<(&str, &str)> {
    let is_of_word = |byte: &u8| byte.is_ascii_alphanumeric() || matches!(byte, b'_' | b'-');
    let ascii = text.bytes().take_while(is_of_word).count();
    let length = match text.as_bytes().get(ascii) {
        Some(0x80..) => {
            let is_other = |c: char| !(c.is_alphanumeric() || c == '_' || c == '-');
            text.find(is_other).unwrap_or(text.len())
        }
        _ => ascii,
    };
    (length > 0).then(|| text.split_at(length))
}

/// Parses a part: `.x`, `[2]`.
pub(crate) fn part(text: &str) -> Option<ValuePart> {
    match text.strip_prefix('[') {
        Some(inner) => bracket(inner.strip_suffix(']')?),
        None => part::member(text.strip_prefix('.')?),
    }
}

/// Parses the text in brackets.
fn bracket(text: &str) -> Option<ValuePart> {
    let number = |text: &str| {
        let text = text.trim();
        let digits = !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
        text.parse().ok().filter(|_| digits)
    };
    if let Some((row, column)) = text.split_once(',') {
        return Some(match column.trim() {
            ".." => ValuePart::Row(number(row)?),
            column => ValuePart::Cell(number(row)?, number(column)?),
        });
    }
    match text.split_once("..") {
        Some((from, to)) => Some(ValuePart::Slice(number(from)?, number(to)?)),
        None => Some(ValuePart::Element(number(text)?)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reference_has_two_names_and_an_optional_part() {
        let place = |text: &str| parse(text, Span::new(10, 10 + text.len()));
        let reference = place("traj.q[3]").unwrap();
        assert_eq!(
            (
                reference.primitive.as_str(),
                reference.port.as_str(),
                reference.part
            ),
            ("traj", "q", Some(ValuePart::Element(3)))
        );
        assert_eq!(reference.port_span, Span::new(15, 19));
        assert_eq!(reference.to_string(), "traj.q[3]");
        for (text, part) in [
            ("a.b[1..3]", ValuePart::Slice(1, 3)),
            ("a.b[1,2]", ValuePart::Cell(1, 2)),
            ("a.b[1,..]", ValuePart::Row(1)),
            ("a.b.position", ValuePart::Member("position")),
        ] {
            let reference = place(text).unwrap();
            assert_eq!(
                (reference.part, reference.to_string()),
                (Some(part), text.to_string())
            );
        }
        for text in [
            "traj.",
            ".q",
            "a.b.c",
            "a.b[",
            "a.b[]",
            "a.b[-1]",
            "a.b[x]",
            "a.b[99999999999]",
            "a b.c",
            "a.b[+1]",
            "a.b[1..]",
            "a.b[,2]",
            "a.b[1,2,3]",
            "a.b[0].x",
        ] {
            assert_eq!(place(text), None, "{text}");
        }
    }

    #[test]
    fn an_input_of_a_fragment_is_one_word() {
        let reference = parse("x[2]", Span::new(0, 4)).unwrap();
        assert_eq!(
            (reference.primitive.as_str(), reference.port.as_str()),
            ("x", "")
        );
        assert_eq!(reference.to_string(), "x[2]");
        for text in ["[1]", "x[1].y", "x.[1]"] {
            assert_eq!(parse(text, Span::new(0, text.len())), None, "{text}");
        }
    }

    #[test]
    fn quotes_are_not_part_of_the_names() {
        let reference = parse("a.b", Span::new(0, 5)).unwrap();
        assert_eq!(reference.primitive_span, Span::new(1, 2));
        assert_eq!(reference.port_span, Span::new(3, 4));
    }
}
