//! Places of an expression in the text of its net, and words for the ports of the primitives that it became. Runs on the
//! loader's threads.

use std::collections::HashMap;
use std::ops::Range;

use rcc_config::diagnostic::{Diagnostic, Span};

/// The text of an expression in the text of the net.
#[derive(Clone, Debug)]
pub struct Place {
    /// Span of the whole text, with its quotes.
    pub span: Span,
    offsets: Offsets,
}

#[derive(Clone, Debug)]
enum Offsets {
    /// Distance of each byte from the start of the span.
    Shifted(usize),
    /// Offset from the start of the span, by byte: lines of the text are folded or indented.
    Listed(Vec<usize>),
    /// Escapes in quotes: only the whole span is known.
    Unknown,
}

impl Place {
    /// Finds `text`, as the reader of YAML returned it, in `raw`, as it is written at `span`.
    #[must_use]
    pub fn of(text: &str, raw: Option<&str>, span: Span) -> Place {
        let raw = raw.unwrap_or("");
        let offsets = match raw.find(text) {
            Some(shift) if shift <= 1 => Offsets::Shifted(shift),
            _ => listed(text, raw).map_or(Offsets::Unknown, Offsets::Listed),
        };
        Place { span, offsets }
    }

    /// Returns the span of a place in the text.
    #[must_use]
    pub fn at(&self, place: &Range<usize>) -> Span {
        let start = self.span.start;
        match &self.offsets {
            Offsets::Shifted(shift) => {
                Span::new(start + shift + place.start, start + shift + place.end)
            }
            Offsets::Listed(offsets) => {
                let last = place.end.max(place.start + 1) - 1;
                let (Some(first), Some(last)) = (offsets.get(place.start), offsets.get(last))
                else {
                    return Span::new(self.span.end.saturating_sub(1).max(start), self.span.end);
                };
                Span::new(start + first, start + (last + 1).max(*first))
            }
            Offsets::Unknown => self.span,
        }
    }
}

/// Matches the characters of both texts except for white space, which the reader of YAML folds. What is before and after
/// them in `raw` is a quote or the beginning of a block (`>-`).
fn listed(text: &str, raw: &str) -> Option<Vec<usize>> {
    let solid = |text: &str| -> Vec<(usize, char)> {
        let solid = text.char_indices().filter(|(_, c)| !c.is_whitespace());
        solid.collect()
    };
    let (wanted, found) = (solid(text), solid(raw));
    let same = |from: usize| {
        let found = found.get(from..from + wanted.len())?;
        let mut pairs = wanted.iter().zip(found);
        pairs.all(|((_, a), (_, b))| a == b).then_some(found)
    };
    let aligned = (0..=4.min(found.len().checked_sub(wanted.len())?)).find_map(same)?;
    let mut offsets = vec![0; text.len()];
    let mut next = aligned.first()?.0;
    let mut pairs = wanted.iter().zip(aligned).peekable();
    for (byte, offset) in offsets.iter_mut().enumerate() {
        if let Some(((_, c), (at, _))) = pairs.next_if(|((wanted, _), _)| *wanted == byte) {
            (*offset, next) = (*at, at + c.len_utf8());
        } else {
            // White space, or inside of a character.
            *offset = next.saturating_sub(1);
        }
    }
    Some(offsets)
}

/// Words for the ports of generated primitives, by their ids.
#[derive(Clone, Debug, Default)]
pub struct PortWords {
    /// The operator or function as written; `None` if primitives of different fragments share the id.
    symbols: HashMap<String, Option<String>>,
}

impl PortWords {
    /// Adds a primitive that stands for an operator or function.
    pub fn add(&mut self, id: &str, symbol: &str) {
        let symbol = Some(symbol.to_owned());
        let known = self.symbols.entry(id.to_owned()).or_insert(symbol.clone());
        if *known != symbol {
            *known = None;
        }
    }

    /// Replaces names of generated ports in messages: `speed/1.a` is the left side of `+`.
    pub fn put_into(&self, diagnostics: &mut [Diagnostic]) {
        if self.symbols.is_empty() {
            return;
        }
        for diagnostic in diagnostics {
            diagnostic.message = self.reworded(&diagnostic.message);
            diagnostic.label = self.reworded(&diagnostic.label);
            diagnostic.help = diagnostic.help.as_deref().map(|help| self.reworded(help));
        }
    }

    /// Replaces names in backquotes.
    fn reworded(&self, text: &str) -> String {
        let mut reworded = String::with_capacity(text.len());
        let parts: Vec<&str> = text.split('`').collect();
        for (number, part) in parts.iter().enumerate() {
            let is_quoted = number % 2 == 1;
            let is_closed = number + 1 < parts.len();
            match self.words(part).filter(|_| is_quoted && is_closed) {
                Some(words) => reworded.push_str(&words),
                None if is_quoted && is_closed => reworded.push_str(&format!("`{part}`")),
                None if is_quoted => reworded.push_str(&format!("`{part}")),
                None => reworded.push_str(part),
            }
        }
        reworded
    }

    fn words(&self, name: &str) -> Option<String> {
        let (id, port) = name.rsplit_once('.')?;
        // Within the instance of a fragment, the id has the instance's id before it.
        let mut shorter = Some(id);
        let symbol = loop {
            let id = shorter?;
            if let Some(symbol) = self.symbols.get(id) {
                break symbol.as_deref()?;
            }
            shorter = id.split_once('/').map(|(_, rest)| rest);
        };
        let is_operator = !symbol.starts_with(|c: char| c.is_alphabetic());
        Some(match (symbol, port) {
            // A generated result; the output of the formula itself keeps its name.
            (_, "out") if !id.contains('/') => return None,
            ("if", "out") => "the result of `if`".to_owned(),
            ("if", "condition") => "the condition of `if`".to_owned(),
            ("if", "yes") => "`then` of `if`".to_owned(),
            ("if", "no") => "`else` of `if`".to_owned(),
            (_, "out") => format!("the result of `{symbol}`"),
            ("-" | "not", "in") => format!("the operand of `{symbol}`"),
            ("and" | "or", "a") => format!("the left side of `{symbol}`"),
            ("and" | "or", "b") => format!("the right side of `{symbol}`"),
            ("*", _) => "a factor of `*`".to_owned(),
            (_, "a") if is_operator => format!("the left side of `{symbol}`"),
            (_, "b") if is_operator => format!("the right side of `{symbol}`"),
            (_, "in") if is_operator => format!("the operand of `{symbol}`"),
            _ => format!("`{port}` of `{symbol}`"),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_found_in_quoted_and_folded_text() {
        let at = |text: &str, raw: &str, wanted: &str| {
            let place = Place::of(text, Some(raw), Span::new(100, 100 + raw.len()));
            let start = text.find(wanted).unwrap();
            let span = place.at(&(start..start + wanted.len()));
            raw[span.start - 100..span.end - 100].to_owned()
        };
        assert_eq!(at("a + bc", "a + bc", "bc"), "bc");
        assert_eq!(at("a + bc", "\"a + bc\"", "bc"), "bc");
        assert_eq!(at("a + bc * d", ">-\n    a +\n    bc * d\n", "bc"), "bc");
        assert_eq!(at("a + bc * d", "a +\n    bc * d", "bc * d"), "bc * d");
        assert_eq!(at("a µ bc", "'a µ  bc'", "bc"), "bc");
        let escaped = Place::of("a", Some("\"\\x61\""), Span::new(3, 9));
        assert_eq!(escaped.at(&(0..1)), Span::new(3, 9));
    }

    #[test]
    fn ports_of_generated_primitives_get_words() {
        let mut words = PortWords::default();
        words.add("speed/1", "+");
        words.add("speed/2", "clamp");
        words.add("speed", "if");
        for (text, want) in [
            (
                "`speed/1.a` expects Real",
                "the left side of `+` expects Real",
            ),
            ("`x/speed/2.low` is `a.b`", "`low` of `clamp` is `a.b`"),
            (
                "both `speed.no` and `speed/1.out`",
                "both `else` of `if` and the result of `+`",
            ),
            ("`speed.out` of `other.a`", "`speed.out` of `other.a`"),
        ] {
            assert_eq!(words.reworded(text), want);
        }
    }
}
