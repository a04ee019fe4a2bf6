//! Makes text from outside safe to print: characters that control a terminal, or that hide or reorder text, are shown
//! as their JSON escape. Pure, without heap; used by every program that prints.
//!
//! The escape is JSON's (`\u001b`), so that one rule serves both kinds of output: human-readable text cannot control
//! the terminal, and a line of JSON keeps its meaning, because such characters occur only inside its strings.

use core::fmt::{self, Display, Write};

/// Returns false for characters that a terminal may interpret, or that make it display a different text: C0 (except
/// line feed and tab), DEL and C1 controls, directional marks, line separators, and zero-width characters.
#[must_use]
pub const fn is_printable(character: char) -> bool {
    match character {
        '\n' | '\t' => true,
        '\0'..='\x1f' | '\x7f'..='\u{9f}' => false,
        // Soft hyphen, Arabic letter mark, Mongolian vowel separator, byte order mark, interlinear annotations.
        '\u{ad}' | '\u{61c}' | '\u{180e}' | '\u{feff}' | '\u{fff9}'..='\u{fffb}' => false,
        // Letters and marks without a shape: grapheme joiner, Hangul fillers, Khmer inherent vowels, Mongolian variants.
        '\u{34f}' | '\u{115f}' | '\u{1160}' | '\u{3164}' | '\u{ffa0}' => false,
        '\u{17b4}' | '\u{17b5}' | '\u{180b}'..='\u{180d}' | '\u{180f}' => false,
        // Musical formatting, and variants beyond those of emoji.
        '\u{1d173}'..='\u{1d17a}' | '\u{e0100}'..='\u{e01ef}' => false,
        // Zero-width characters and directional marks; line and paragraph separators and embeddings; joiners, invisible
        // operators and isolates.
        '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{206f}' => false,
        // Tags.
        '\u{e0000}'..='\u{e007f}' => false,
        _ => true,
    }
}

/// Returns the first unprintable character of `text` and its byte offset.
#[must_use]
pub fn first_unprintable(text: &str) -> Option<(usize, char)> {
    text.char_indices()
        .find(|(_, character)| !is_printable(*character))
}

/// Displays a text with every unprintable character as its JSON escape.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Printable<'a>(pub &'a str);

impl Display for Printable<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut rest = self.0;
        while let Some((at, character)) = first_unprintable(rest) {
            let (clean, behind) = rest.split_at(at);
            f.write_str(clean)?;
            escape(character, f)?;
            rest = behind.get(character.len_utf8()..).unwrap_or("");
        }
        f.write_str(rest)
    }
}

/// As [`Printable`], but also escapes line feeds and tabs: for a name or message within a line, which must not begin
/// another line that looks like one of the program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OneLine<'a>(pub &'a str);

impl Display for OneLine<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut rest = self.0;
        while let Some(at) = rest.find(['\n', '\t']) {
            let (clean, behind) = rest.split_at(at);
            Printable(clean).fmt(f)?;
            f.write_str(if behind.starts_with('\n') {
                "\\n"
            } else {
                "\\t"
            })?;
            rest = behind.get(1..).unwrap_or("");
        }
        Printable(rest).fmt(f)
    }
}

/// As [`Printable`], but passes colour sequences (`ESC [ … m`): for text that was coloured by this program, from parts
/// that were made printable before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Coloured<'a>(pub &'a str);

impl Display for Coloured<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut rest = self.0;
        while let Some(at) = rest.find("\x1b[") {
            let (clean, sequence) = rest.split_at(at);
            let length = colour(sequence);
            // If it is not a colour sequence, the two characters found are text.
            let (sequence, behind) = sequence.split_at(if length > 0 { length } else { 2 });
            Printable(clean).fmt(f)?;
            if length > 0 {
                f.write_str(sequence)?;
            } else {
                Printable(sequence).fmt(f)?;
            }
            rest = behind;
        }
        Printable(rest).fmt(f)
    }
}

/// Returns the length of the colour sequence at the start of `text`; 0 if there is none.
fn colour(text: &str) -> usize {
    let parameters = text.get(2..).unwrap_or("");
    let end = parameters.find(|c: char| !c.is_ascii_digit() && c != ';');
    match end.filter(|end| parameters.get(*end..).is_some_and(|t| t.starts_with('m'))) {
        Some(end) => 2 + end + 1,
        None => 0,
    }
}

fn escape(character: char, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    let mut units = [0; 2];
    for unit in character.encode_utf16(&mut units) {
        f.write_char('\\')?;
        write!(f, "u{unit:04x}")?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::string::{String, ToString};

    use proptest::prelude::*;

    use super::*;

    /// Clears the screen, sets the title, hides and reorders text, and starts a new line.
    const HOSTILE: &str =
        "a\x1b[2J\x1b]0;owned\x07\x7f\u{9b}31m\u{202e}live\u{2066}\u{200b}\u{2028}\r\u{e0041}z";

    #[test]
    fn control_characters_are_shown_escaped() {
        assert_eq!(
            Printable(HOSTILE).to_string(),
            "a\\u001b[2J\\u001b]0;owned\\u0007\\u007f\\u009b31m\\u202elive\\u2066\\u200b\\u2028\\u000d\\udb40\\udc41z"
        );
    }

    #[test]
    fn lines_tabs_and_letters_of_all_scripts_stay() {
        let text = "two\nlines\tgrün 日本 עברית 🤖 – ✹";
        assert_eq!(Printable(text).to_string(), text);
    }

    #[test]
    fn a_text_within_a_line_begins_no_other_line() {
        assert_eq!(
            OneLine("a\n\terror RCC1: \u{202e}b\r\n").to_string(),
            "a\\n\\terror RCC1: \\u202eb\\u000d\\n"
        );
    }

    #[test]
    fn only_colour_sequences_pass_in_coloured_text() {
        for (text, printed) in [
            ("\x1b[31mred\x1b[0m", "\x1b[31mred\x1b[0m"),
            ("\x1b[1;38;5;9mx\x1b[m", "\x1b[1;38;5;9mx\x1b[m"),
            ("\x1b[2J\x1b[31m", "\\u001b[2J\x1b[31m"),
            ("\x1b[", "\\u001b["),
            ("\x1b[3", "\\u001b[3"),
            ("\x1b\x1b[ü", "\\u001b\\u001b[ü"),
            ("\x1b[31\x1b[0m", "\\u001b[31\x1b[0m"),
        ] {
            assert_eq!(Coloured(text).to_string(), printed, "{text:?}");
        }
    }

    proptest! {
        #[test]
        fn only_printable_characters_are_printed(text: String) {
            let printed = Printable(&text).to_string();
            prop_assert!(first_unprintable(&printed).is_none(), "{printed:?}");
        }

        #[test]
        fn json_says_the_same(text in "[\\PC\\x00-\\x1f\\x7f-\\u{9f}\\u{200b}-\\u{206f}\\u{e0000}-\\u{e007f}\"\\\\]*") {
            let json = serde_json::to_string(&text).unwrap();
            let printed = Printable(&json).to_string();
            prop_assert!(first_unprintable(&printed).is_none());
            prop_assert_eq!(serde_json::from_str::<String>(&printed).unwrap(), text);
        }

        #[test]
        fn nothing_but_colours_passes(text in "[\\x1b\\[0-9;mJ\\x07a]*") {
            let printed = Coloured(&text).to_string();
            let mut rest = printed.as_str();
            while let Some((at, _)) = first_unprintable(rest) {
                let length = colour(&rest[at..]);
                prop_assert!(length > 0, "{printed:?}");
                rest = &rest[at + length..];
            }
        }
    }
}
