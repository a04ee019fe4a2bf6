//! Notation of a text as one YAML scalar that reads back as the same text in any context. Used by writers of nets and
//! configurations, never on the real-time thread.

use std::borrow::Cow;
use std::fmt::Write;

use super::{Value, plain};

/// Characters that end a plain scalar, or begin another token, inside flow collections.
const BRACKETS: &[char] = &['[', ']', '{', '}', ','];

/// Returns the text as a scalar: plain if that reads back as this text, else in single quotes, else in double quotes.
#[must_use]
pub fn text(value: &str) -> Cow<'_, str> {
    let stays = is_plain(value) && !value.contains(BRACKETS) && is_text(value);
    quoted_unless(stays, value)
}

/// Returns the text as a scalar outside of flow collections, where brackets and commas have no meaning.
#[must_use]
pub fn line(value: &str) -> Cow<'_, str> {
    let stays = is_plain(value) && !value.starts_with(BRACKETS) && is_text(value);
    quoted_unless(stays, value)
}

fn is_text(value: &str) -> bool {
    matches!(plain(value), Value::Text(_))
}

/// Returns the text as a key; unlike values, keys are always text.
#[must_use]
pub fn key(value: &str) -> Cow<'_, str> {
    quoted_unless(is_plain(value) && !value.contains(BRACKETS), value)
}

/// Returns a number that reads back with the same bits and as a `Real`.
#[must_use]
pub fn real(value: f64) -> String {
    // The shortest digits for this value, always with a point or an exponent.
    format!("{value:?}")
}

fn quoted_unless(plain: bool, value: &str) -> Cow<'_, str> {
    if plain {
        Cow::Borrowed(value)
    } else if value.chars().all(is_printed) {
        Cow::Owned(format!("'{}'", value.replace('\'', "''")))
    } else {
        Cow::Owned(double_quoted(value))
    }
}

/// Returns true for characters that may appear unescaped.
pub(super) fn is_printed(c: char) -> bool {
    !c.is_control() && !matches!(c, '\u{2028}' | '\u{2029}' | '\u{feff}')
}

fn is_plain(value: &str) -> bool {
    let mut characters = value.chars();
    let (first, second) = (characters.next(), characters.next());
    let begins = match first {
        None => false,
        Some('-' | '?' | ':') => second.is_some_and(|c| c.is_alphanumeric() || c == '.'),
        Some(c) => {
            !c.is_whitespace()
                && !matches!(c, '#' | '&' | '*' | '!' | '|' | '>' | '\'' | '"' | '%')
                && !matches!(c, '@' | '`' | '=' | '<')
        }
    };
    begins
        && value
            .chars()
            .all(|c| is_printed(c) && (c == ' ' || !c.is_whitespace()))
        && !value.contains(": ")
        && !value.contains(" #")
        && !value.ends_with([':', ' '])
}

fn double_quoted(value: &str) -> String {
    let mut text = String::with_capacity(value.len() + 2);
    text.push('"');
    for c in value.chars() {
        match c {
            '"' => text.push_str("\\\""),
            '\\' => text.push_str("\\\\"),
            '\n' => text.push_str("\\n"),
            '\t' => text.push_str("\\t"),
            '\r' => text.push_str("\\r"),
            c if is_printed(c) => text.push(c),
            // All escaped characters are below U+FFFF, so four digits as in JSON suffice. Writing to a String cannot
            // fail.
            c => drop(write!(text, "\\u{:04x}", u32::from(c))),
        }
    }
    text.push('"');
    text
}

/// Returns the text as a JSON string.
#[must_use]
pub fn json(value: &str) -> String {
    double_quoted(value)
}

#[cfg(test)]
mod tests {
    use super::super::{parse, read};
    use super::*;

    const TEXTS: &[&str] = &[
        "a.b",
        "-deg(30)",
        "12 N",
        "12",
        "null",
        "",
        " ",
        "a: b",
        "a #b",
        "a#b",
        "#a",
        "- a",
        "-",
        "a.out[2]",
        "{",
        "x,y",
        "it's",
        "\"",
        "\\",
        "two\nlines",
        "tab\there",
        "bell\u{7}",
        "\u{85}",
        "\u{feff}",
        "ü",
        "'",
        "yes",
        "~",
        "*x",
        "&x",
        "!t",
        "%",
        "@",
        "`",
        "|",
        ">",
        "?",
        "? a",
        ":",
        "a:",
        "a:b",
        "N·m",
        "---",
        "...",
        "0x10",
        "true",
        "$gain",
    ];

    #[test]
    fn every_text_reads_back_in_lists_mappings_and_lines() {
        for given in TEXTS {
            let scalar = text(given);
            for (before, after) in [
                ("x: ", "\n"),
                ("x: [", "]\n"),
                ("x: {y: ", "}\n"),
                ("x:\n- ", "\n"),
            ] {
                // Texts with unprintable characters are reported, but parsed all the same.
                let root = read(&format!("{before}{scalar}{after}")).0.unwrap();
                let node = root.get("x").unwrap();
                let inner = node.get("y").or_else(|| node.list()?.first());
                assert_eq!(
                    inner.unwrap_or(node).text(),
                    Some(*given),
                    "{before}{scalar}{after}"
                );
            }
            for (before, after) in [("x: ", "\n"), ("x:\n- ", "\n")] {
                let root = read(&format!("{before}{}{after}", line(given))).0.unwrap();
                let node = root.get("x").unwrap();
                let inner = node.list().and_then(<[_]>::first);
                assert_eq!(inner.unwrap_or(node).text(), Some(*given));
            }
            let root = read(&format!("{{{}: 1}}\n", key(given))).0.unwrap();
            assert_eq!(root.map().unwrap()[0].key.name, *given);
            let root = read(&format!("[{}]", json(given))).0.unwrap();
            assert_eq!(root.list().unwrap()[0].text(), Some(*given));
        }
    }

    #[test]
    fn unneeded_quotes_are_omitted() {
        for given in [
            "a.b",
            "-deg(30)",
            "0.25 m/s",
            "$gain",
            "it's",
            "a#b",
            "N·m",
            "A sentence, with a comma",
        ] {
            let quoted = given.contains(',');
            assert_eq!(text(given).starts_with('\''), quoted, "{given}");
            assert_eq!(line(given), given);
        }
    }

    #[test]
    fn a_number_reads_back_to_the_same_bits() {
        for value in [
            0.0,
            -0.0,
            1.0,
            0.1,
            1e300,
            1e-300,
            f64::MIN_POSITIVE / 3.0,
            1e16,
            f64::MAX,
            -1.0 / 3.0,
        ] {
            let root = parse(&format!("x: {}", real(value))).unwrap();
            match root.get("x").unwrap().value {
                Value::Real(read) => assert_eq!(read.to_bits(), value.to_bits()),
                ref other => panic!("{value}: {other:?}"),
            }
        }
    }
}
