//! Diagnostics of a text: position, problem and remedy; drawn for people or as rows for programs. Used by the loader,
//! the command line and every reader of a configuration, never by the real-time thread.

mod drawing;
mod similar;

use std::fmt;

use rcc_core::counted::Counted;
use serde::{Deserialize, Serialize};

use drawing::LineIndex;
pub use drawing::{DrawingStyle, render};
pub use similar::{NameSearch, closest};

/// Maximum number of diagnostics that are drawn; further ones are only counted.
pub const DRAWN_MAX: usize = 100;
/// Maximum number of diagnostics that are kept; more than this usually repeats one mistake.
pub const KEPT_MAX: usize = 1000;

/// Maximum length of a message, label or remedy, bytes: names in it may be as long as the text.
pub const WORDS_MAX: usize = 600;

/// A range of bytes in a text.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Span {
    /// Offset of the first byte.
    pub start: usize,
    /// Offset after the last byte.
    pub end: usize,
}

impl Span {
    /// Creates a span from its first byte to the one after its last.
    #[must_use]
    pub const fn new(start: usize, end: usize) -> Span {
        Span { start, end }
    }
}

/// Severity of a diagnostic.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// The text is refused.
    Error,
    /// The text is accepted, but should be reviewed.
    Warning,
}

/// One problem in a text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnostic {
    /// Stable code, `RCC1203`.
    pub code: &'static str,
    /// Severity.
    pub severity: Severity,
    /// The problem, one sentence without a full stop.
    pub message: String,
    /// Position; `None` if the diagnostic concerns the text as a whole.
    pub place: Option<Span>,
    /// Label at the position; may be empty.
    pub label: String,
    /// Remedy.
    pub help: Option<String>,
    /// Index of the source that `place` refers to.
    pub file: u32,
    /// Where the text at `place` is used, if it can be used in several places.
    pub used_at: Option<Box<UseSite>>,
}

/// Use of a text that can be used in several places.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UseSite {
    /// Position of the use.
    pub place: Span,
    /// Index of its source.
    pub file: u32,
    /// Label at that position.
    pub label: String,
}

impl Diagnostic {
    /// Creates an error at a position in source 0.
    pub fn error(code: &'static str, place: Span, message: impl Into<String>) -> Diagnostic {
        Diagnostic {
            code,
            severity: Severity::Error,
            message: message.into(),
            place: Some(place),
            label: String::new(),
            help: None,
            file: 0,
            used_at: None,
        }
    }

    /// Creates a warning at a position in source 0.
    pub fn warning(code: &'static str, place: Span, message: impl Into<String>) -> Diagnostic {
        Diagnostic {
            severity: Severity::Warning,
            ..Diagnostic::error(code, place, message)
        }
    }

    /// Sets the label.
    #[must_use]
    pub fn label(self, label: impl Into<String>) -> Diagnostic {
        Diagnostic {
            label: label.into(),
            ..self
        }
    }

    /// Sets the remedy.
    #[must_use]
    pub fn help(self, help: impl Into<String>) -> Diagnostic {
        Diagnostic {
            help: Some(help.into()),
            ..self
        }
    }

    /// Sets the remedy, or none.
    #[must_use]
    pub fn help_if(self, help: Option<String>) -> Diagnostic {
        Diagnostic { help, ..self }
    }

    /// Cuts texts that are longer than people read.
    pub(crate) fn shorten(&mut self) {
        let used_at = self.used_at.as_mut().map(|used_at| &mut used_at.label);
        let texts = [&mut self.message, &mut self.label].into_iter();
        for text in texts.chain(&mut self.help).chain(used_at) {
            if text.len() > WORDS_MAX {
                let cut = text.split_off(text.floor_char_boundary(WORDS_MAX));
                let count = Counted::of(cut.chars().count(), "more character");
                text.push_str(&format!("… ({count})"));
            }
        }
    }

    /// Removes the position: the diagnostic concerns the whole text.
    #[must_use]
    pub fn anywhere(self) -> Diagnostic {
        Diagnostic {
            place: None,
            ..self
        }
    }
}

/// A text that diagnostics refer to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SourceText {
    /// File name for people.
    pub name: String,
    /// The text.
    pub text: String,
}

/// All diagnostics of a text and of the texts that it names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Faults {
    /// The texts; the first is the one that was given.
    pub sources: Vec<SourceText>,
    /// The diagnostics, in the order of their positions.
    pub diagnostics: Vec<Diagnostic>,
}

/// A diagnostic as a row for programs, with the same codes and texts as the drawing.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct DiagnosticRow {
    /// Stable code.
    pub code: String,
    /// Severity.
    pub severity: Severity,
    /// The problem.
    pub message: String,
    /// File name.
    pub file: String,
    /// Line, counted from 1; 0 for the text as a whole.
    pub line: usize,
    /// Column in characters, counted from 1; 0 for the text as a whole.
    pub column: usize,
    /// Length in bytes, at most to the end of the line.
    pub length: usize,
    /// Label at the position.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub label: String,
    /// Remedy.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub help: Option<String>,
    /// Where the text with the fault is used, if it can be used in several places.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub used_at: Option<DiagnosticPosition>,
}

/// A second position of a row.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct DiagnosticPosition {
    /// File name.
    pub file: String,
    /// Line, counted from 1.
    pub line: usize,
    /// Column in characters, counted from 1.
    pub column: usize,
    /// Length in bytes, at most to the end of the line.
    pub length: usize,
    /// Label at the position.
    pub label: String,
}

impl Faults {
    /// Collects the diagnostics of one text, sorted by position; at most [`KEPT_MAX`], preferring errors. The last one then
    /// counts the others. Texts beyond [`WORDS_MAX`] are cut with a count.
    pub fn new(
        name: impl Into<String>,
        text: impl Into<String>,
        mut diagnostics: Vec<Diagnostic>,
    ) -> Faults {
        let source = SourceText {
            name: name.into(),
            text: text.into(),
        };
        let mut others = None;
        if diagnostics.len() > KEPT_MAX {
            diagnostics.sort_by_key(|fault| fault.severity == Severity::Warning);
            others = Some(not_listed(&diagnostics.split_off(KEPT_MAX)));
        }
        diagnostics.sort_by_key(|fault| (fault.file, fault.place.unwrap_or_default(), fault.code));
        diagnostics.extend(others.flatten());
        diagnostics.iter_mut().for_each(Diagnostic::shorten);
        Faults {
            sources: vec![source],
            diagnostics,
        }
    }

    /// Adds the diagnostics of another text.
    pub fn append(&mut self, mut other: Faults) {
        // There are never 2^32 files.
        let shift = self.sources.len() as u32;
        for fault in &mut other.diagnostics {
            fault.file += shift;
            if let Some(used_at) = &mut fault.used_at {
                used_at.file += shift;
            }
        }
        self.sources.append(&mut other.sources);
        self.diagnostics.append(&mut other.diagnostics);
    }

    /// Returns true if the text is refused.
    #[must_use]
    pub fn has_errors(&self) -> bool {
        self.count(Severity::Error) > 0
    }

    /// Returns the number of diagnostics with this severity.
    #[must_use]
    pub fn count(&self, severity: Severity) -> usize {
        let same = |fault: &&Diagnostic| fault.severity == severity;
        self.diagnostics.iter().filter(same).count()
    }

    /// Returns the diagnostics as rows for programs.
    #[must_use]
    pub fn rows(&self) -> Vec<DiagnosticRow> {
        let lines: Vec<LineIndex<'_>> = self
            .sources
            .iter()
            .map(|source| LineIndex::of(&source.text))
            .collect();
        let place_in = |file: u32, span: Option<Span>| {
            let place = span.zip(lines.get(file as usize));
            let place = place.map(|(span, lines)| lines.place(span));
            let file = self.sources.get(file as usize);
            let file = file.map_or("", |source| &source.name);
            (file.to_string(), place.unwrap_or_default())
        };
        let row = |fault: &Diagnostic| {
            let (file, place) = place_in(fault.file, fault.place);
            let used_at = fault.used_at.as_ref().map(|used_at| {
                let (file, place) = place_in(used_at.file, Some(used_at.place));
                DiagnosticPosition {
                    file,
                    line: place.line,
                    column: place.column,
                    length: place.length,
                    label: used_at.label.clone(),
                }
            });
            DiagnosticRow {
                code: fault.code.to_string(),
                severity: fault.severity,
                message: fault.message.clone(),
                file,
                line: place.line,
                column: place.column,
                length: place.length,
                label: fault.label.clone(),
                help: fault.help.clone(),
                used_at,
            }
        };
        self.diagnostics.iter().map(row).collect()
    }

    /// Draws the diagnostics for people: each with its line of the text, then their number.
    #[must_use]
    pub fn render(&self, colour: bool) -> String {
        let style = DrawingStyle {
            colour,
            columns: None,
        };
        render(&self.rows(), &self.sources, style)
    }
}

/// Returns a diagnostic that counts others; its code and severity are those of the first of them.
fn not_listed(others: &[Diagnostic]) -> Option<Diagnostic> {
    let first = others.first()?;
    let of = |severity| {
        let same = others.iter().filter(|fault| fault.severity == severity);
        same.count()
    };
    let counts = [
        (of(Severity::Error), "more error"),
        (of(Severity::Warning), "more warning"),
    ];
    let counts = counts.into_iter().filter(|(count, _)| *count > 0);
    let counts: Vec<String> = counts
        .map(|(count, what)| Counted::of(count, what).to_string())
        .collect();
    let are = if others.len() == 1 { "is" } else { "are" };
    let message = format!("{} {are} not listed", counts.join(" and "));
    let fault = Diagnostic {
        severity: first.severity,
        ..Diagnostic::error(first.code, Span::default(), message)
    };
    Some(fault.anywhere().help("correct those that are listed first"))
}

impl fmt::Display for Faults {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.render(false))
    }
}

impl std::error::Error for Faults {}

#[cfg(test)]
mod tests {
    use rcc_core::printable::{Coloured, first_unprintable};

    use super::*;

    fn faults(text: &str, place: Span) -> Faults {
        let fault = Diagnostic::error("RCC1203", place, "output port not found")
            .label("no port `b`")
            .help("did you mean `c`?");
        Faults::new("a.yaml", text, vec![fault])
    }

    #[test]
    fn a_row_counts_lines_and_characters_from_one() {
        let rows = faults("é: 1\nü: a.b\n", Span::new(10, 11)).rows();
        assert_eq!((rows[0].line, rows[0].column, rows[0].length), (2, 4, 1));
    }

    #[test]
    fn a_position_outside_the_text_is_moved_into_it() {
        for place in [
            Span::new(0, 0),
            Span::new(3, 90),
            Span::new(900, 901),
            Span::new(5, 2),
        ] {
            let faults = faults("net: ü\n", place);
            assert!(faults.rows()[0].line >= 1);
            assert!(faults.render(false).contains("RCC1203"));
        }
    }

    #[test]
    fn the_drawing_shows_code_place_cause_and_remedy() {
        let text = faults("net: x\nin: a.b\n", Span::new(11, 14)).render(false);
        for part in [
            "RCC1203",
            "a.yaml:2:5",
            "in: a.b",
            "no port `b`",
            "did you mean `c`?",
            "1 error, 0 warnings",
        ] {
            assert!(text.contains(part), "{part} is missing in\n{text}");
        }
    }

    #[test]
    fn a_long_line_is_cut_around_the_position() {
        let text = format!("{}HERE{}", "é".repeat(100_000), "b".repeat(100_000));
        let drawn = faults(&text, Span::new(200_000, 200_004)).render(false);
        assert!(drawn.contains("HERE") && drawn.len() < 3000, "{drawn}");
    }

    #[test]
    fn a_drawing_contains_no_terminal_control_and_points_to_the_position() {
        let hostile = "\x1b[2J\u{9b}31m\u{202e}\u{7}";
        let text = format!("net: {hostile} x HERE {hostile}\n");
        let at = text.find("HERE").unwrap();
        let mut fault = Diagnostic::error("RCC1203", Span::new(at, at + 4), hostile)
            .label(format!("l{hostile}"))
            .help(format!("h{hostile}"));
        fault.used_at = Some(Box::new(UseSite {
            place: Span::new(0, 3),
            file: 0,
            label: format!("u{hostile}"),
        }));
        let faults = Faults::new(format!("f{hostile}.yaml"), text, vec![fault]);
        for sources in [&faults.sources[..], &[]] {
            let plain = DrawingStyle::default();
            let drawn = render(&faults.rows(), sources, plain);
            assert_eq!(first_unprintable(&drawn), None, "{drawn}");
            for letter in ["l", "h", "u", "f"] {
                assert!(
                    drawn.contains(&format!("{letter}\\u001b[2J")) || sources.is_empty(),
                    "{drawn}"
                );
            }
            // A coloured drawing contains no escape sequences besides its own colours.
            let colours = DrawingStyle {
                colour: true,
                ..plain
            };
            let coloured = render(&faults.rows(), sources, colours);
            assert_eq!(Coloured(&coloured).to_string(), coloured);
            assert!(!coloured.contains("\x1b[2J"), "{coloured:?}");
        }
        let drawn = faults.render(false);
        let lines: Vec<&str> = drawn.lines().collect();
        let line = lines.iter().position(|line| line.contains("HERE")).unwrap();
        let column = |line: &str, what: &str| line[..line.find(what).unwrap()].chars().count();
        assert_eq!(
            column(lines[line], "HERE"),
            column(lines[line + 1], "─"),
            "{drawn}"
        );
    }

    #[test]
    fn diagnostics_beyond_the_limit_are_counted() {
        let fault = |number: usize| {
            let place = Span::new(number, number + 1);
            match number % 2 {
                0 => Diagnostic::error("RCC1203", place, "a"),
                _ => Diagnostic::warning("RCC1901", place, "b"),
            }
        };
        let faults = Faults::new("a", "x".repeat(50_000), (0..50_000).map(fault).collect());
        assert_eq!(faults.diagnostics.len(), KEPT_MAX + 1);
        let last = faults.diagnostics.last().unwrap();
        assert_eq!(
            last.message,
            "24000 more errors and 25000 more warnings are not listed"
        );
        assert_eq!(last.severity, Severity::Error);
        assert!(faults.render(false).len() < 100_000);
    }

    #[test]
    fn a_text_of_a_megabyte_is_cut_with_a_count() {
        let long = "ä".repeat(1_000_000);
        let fault = Diagnostic::error("RCC1203", Span::new(0, 1), format!("`{long}`"))
            .label(&*long)
            .help(&*long);
        let faults = Faults::new("a", "x", vec![fault]);
        let shown = faults.render(false);
        assert!(shown.len() < 5_000, "{} bytes", shown.len());
        let message = &faults.diagnostics[0].message;
        assert!(message.ends_with("more characters)"), "{message}");
        assert!(
            shown.contains("more") && shown.contains("characters)"),
            "{shown}"
        );
    }

    #[test]
    fn rows_survive_json_and_draw_the_same() {
        let faults = faults("in: a.b\n", Span::new(4, 7));
        let text = serde_json::to_string(&faults.rows()).unwrap();
        let rows: Vec<DiagnosticRow> = serde_json::from_str(&text).unwrap();
        let drawn = render(&rows, &faults.sources, DrawingStyle::default());
        assert_eq!(drawn, faults.render(false));
    }

    #[test]
    fn a_terminal_of_any_width_breaks_no_word_and_no_line() {
        let words =
            "the net commands welding-line/approach.position and tool-changer/state.locked of lwr";
        let text = format!("{}in: a.b  # {words}\n", " ".repeat(50));
        for column in [0, 20, 50, 54, 70] {
            let fault = Diagnostic::error("RCC1203", Span::new(column, column + 3), words)
                .label(words)
                .help(words);
            let faults = Faults::new("a.yaml", text.as_str(), vec![fault]);
            for columns in [60, 80, 100, 132] {
                let style = DrawingStyle {
                    colour: false,
                    columns: Some(columns),
                };
                let drawn = render(&faults.rows(), &faults.sources, style);
                let widest = drawn.lines().map(|line| line.chars().count()).max();
                assert!(
                    widest.is_some_and(|widest| widest <= columns),
                    "{columns} columns, {widest:?}:\n{drawn}"
                );
                for word in words.split(' ') {
                    let found = drawn.matches(word).count();
                    assert!(found >= 3, "{word} is broken at {columns}:\n{drawn}");
                }
            }
        }
    }
}
