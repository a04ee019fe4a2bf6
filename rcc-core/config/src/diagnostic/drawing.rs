//! Drawing of diagnostics: each with its line of the text (cut around the position if it is long), label and remedy.
//! Used wherever diagnostics are displayed, never by the real-time thread.

use std::fmt::{self, Write as _};

use miette::{GraphicalReportHandler, GraphicalTheme, LabeledSpan, MietteSpanContents, SourceSpan};
use rcc_core::counted::Counted;
use rcc_core::printable::{OneLine, Printable};
use textwrap::{WordSeparator, WordSplitter};

use super::{DRAWN_MAX, DiagnosticPosition, DiagnosticRow, Severity, SourceText, Span};

/// Maximum number of characters of a line that are drawn; longer lines (generated JSON) are cut around the position.
const LINE_MAX: usize = 160;
/// Columns that sentences are wrapped to, at most; longer lines are tiring to read.
const COLUMNS_MAX: usize = 100;
/// Columns that are needed at least; a narrower terminal breaks the lines itself.
const COLUMNS_MIN: usize = 40;
/// Columns beside the number of a line and its text: the frame, and the marks of a cut at both ends.
const GUTTER: usize = 6;
/// Columns of the hook between a position and its label.
const HOOK: usize = 4;
/// Mark of a line that is cut.
const CUT: &str = "…";

/// How diagnostics are drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DrawingStyle {
    /// Uses the colours of a terminal.
    pub colour: bool,
    /// Columns of the terminal. `None` for a file or a pipe: sentences are wrapped at 100 columns, labels are not.
    pub columns: Option<usize>,
}

impl DrawingStyle {
    fn sentence(self) -> usize {
        self.columns
            .unwrap_or(COLUMNS_MAX)
            .clamp(COLUMNS_MIN, COLUMNS_MAX)
    }

    /// Returns the columns for the text of line `number`, counted from 1.
    fn room(self, number: usize) -> usize {
        let gutter = number.to_string().len() + GUTTER;
        self.columns.map_or(LINE_MAX, |columns| {
            (columns.max(COLUMNS_MIN) - gutter).min(LINE_MAX)
        })
    }
}

/// Wraps a text between words only: names with hyphens or slashes stay whole.
fn wrap(text: &str, columns: usize) -> String {
    let options = textwrap::Options::new(columns)
        .break_words(false)
        .word_separator(WordSeparator::AsciiSpace)
        .word_splitter(WordSplitter::NoHyphenation);
    textwrap::fill(text, options)
}

/// Draws rows, also those from another process; a row whose source is not given is drawn without its line. Unprintable
/// characters of the texts are escaped, so that the only terminal control sequences are our own colours.
#[must_use]
pub fn render(rows: &[DiagnosticRow], sources: &[SourceText], style: DrawingStyle) -> String {
    let theme = if style.colour {
        GraphicalTheme::unicode()
    } else {
        GraphicalTheme::unicode_nocolor()
    };
    let handler = GraphicalReportHandler::new_themed(theme)
        .with_width(style.sentence())
        .with_break_words(false)
        .with_word_separator(WordSeparator::AsciiSpace)
        .with_word_splitter(WordSplitter::NoHyphenation)
        .with_links(false);
    let lines: Vec<LineIndex<'_>> = sources
        .iter()
        .map(|source| LineIndex::of(&source.text))
        .collect();
    let mut out = String::new();
    for row in rows.iter().take(DRAWN_MAX) {
        let excerpt = |place: &DiagnosticPosition| {
            let source = sources.iter().position(|source| source.name == place.file);
            lines.get(source?)?.excerpt(place, style)
        };
        let mut shown = printable(row);
        let line = excerpt(&place_of(row));
        if let (Some(line), Some(_)) = (&line, style.columns) {
            let before = line.text.get(..line.label.0).unwrap_or("").chars().count();
            let room = style.room(row.line);
            let left = room.saturating_sub(before + line.label.1 / 2 + HOOK);
            shown.label = wrap(&shown.label, left.max(COLUMNS_MIN / 2));
        }
        let used_at = row.used_at.as_ref().zip(shown.used_at.as_ref());
        let used_at = used_at.map(|(place, shown)| RelatedUse {
            place: shown,
            line: excerpt(place),
        });
        let report = Drawing {
            row: &shown,
            line,
            used_at,
        };
        // Writing into a String fails only if the drawing itself fails; then print the message alone.
        if handler.render_report(&mut out, &report).is_err() {
            out.push_str(&shown.message);
        }
        while out.ends_with("\n\n") {
            out.pop();
        }
        out.push('\n');
    }
    let count = |severity| rows.iter().filter(|row| row.severity == severity).count();
    let (errors, warnings) = (count(Severity::Error), count(Severity::Warning));
    if let Some(more) = rows.len().checked_sub(DRAWN_MAX).filter(|more| *more > 0) {
        // Writing into a String cannot fail.
        let _ = writeln!(out, "and {more} more");
    }
    // Writing into a String cannot fail.
    let _ = writeln!(
        out,
        "{}, {}",
        Counted::of(errors, "error"),
        Counted::of(warnings, "warning")
    );
    out
}

/// Returns the row with all texts escaped for printing.
fn printable(row: &DiagnosticRow) -> DiagnosticRow {
    let clean = |text: &str| OneLine(text).to_string();
    DiagnosticRow {
        code: clean(&row.code),
        message: clean(&row.message),
        file: clean(&row.file),
        label: clean(&row.label),
        help: row.help.as_deref().map(clean),
        used_at: row.used_at.as_ref().map(|place| DiagnosticPosition {
            file: clean(&place.file),
            label: clean(&place.label),
            ..place.clone()
        }),
        ..*row
    }
}

fn place_of(row: &DiagnosticRow) -> DiagnosticPosition {
    DiagnosticPosition {
        file: row.file.clone(),
        line: row.line,
        column: row.column,
        length: row.length,
        label: row.label.clone(),
    }
}

/// Start offsets of the lines of a text.
pub(super) struct LineIndex<'a> {
    text: &'a str,
    starts: Vec<usize>,
}

#[derive(Clone, Copy, Default)]
pub(super) struct LinePosition {
    pub(super) line: usize,
    pub(super) column: usize,
    pub(super) length: usize,
}

impl<'a> LineIndex<'a> {
    pub(super) fn of(text: &'a str) -> LineIndex<'a> {
        let breaks = text.bytes().enumerate().filter(|(_, byte)| *byte == b'\n');
        let starts = std::iter::once(0)
            .chain(breaks.map(|(index, _)| index + 1))
            .collect();
        LineIndex { text, starts }
    }

    /// Returns the start offset and the text of a line (counted from 0) without its line end.
    fn line(&self, number: usize) -> Option<(usize, &'a str)> {
        let start = *self.starts.get(number)?;
        let end = self
            .starts
            .get(number + 1)
            .copied()
            .unwrap_or(self.text.len());
        let text = self.text.get(start..end)?;
        Some((start, text.trim_end_matches(['\n', '\r'])))
    }

    pub(super) fn place(&self, span: Span) -> LinePosition {
        let at = floor(self.text, span.start);
        let number = self.starts.partition_point(|start| *start <= at) - 1;
        let (start, line) = self.line(number).unwrap_or((0, ""));
        let before = floor(line, at - start);
        let end = floor(line, span.end.max(at) - start);
        LinePosition {
            line: number + 1,
            column: line[..before].chars().count() + 1,
            length: end.saturating_sub(before),
        }
    }

    /// Returns the line of a row, cut around the position if it is too long, or if the label would have no room.
    fn excerpt(&self, row: &DiagnosticPosition, style: DrawingStyle) -> Option<Excerpt> {
        let (_, line) = self.line(row.line.checked_sub(1)?)?;
        let mut indices = line.char_indices().map(|(index, _)| index);
        let at = indices
            .nth(row.column.checked_sub(1)?)
            .unwrap_or(line.len());
        let room = style.room(row.line);
        let label = style.columns.map_or(0, |_| {
            let label = row.label.chars().count();
            (row.length / 2 + HOOK + label).min(room / 2)
        });
        let before = if line.len() <= room {
            room - label
        } else {
            room / 3
        };
        let from = ceil(line, at.saturating_sub(before));
        let to = floor(line, from + room);
        let end = floor(line, at + row.length).min(to).max(at);
        let mut text = if from > 0 { CUT } else { "" }.to_owned();
        text.push_str(&Printable(&line[from..at]).to_string());
        let label = text.len();
        text.push_str(&Printable(&line[at..end]).to_string());
        let length = text.len() - label;
        text.push_str(&Printable(&line[end..to]).to_string());
        if to < line.len() {
            text.push_str(CUT);
        }
        Some(Excerpt {
            name: OneLine(&row.file).to_string(),
            text,
            label: (label, length),
            line: row.line - 1,
            column: row.column - 1,
        })
    }
}

/// Returns the nearest character boundary at or after `at`.
fn ceil(text: &str, at: usize) -> usize {
    let at = at.min(text.len());
    (at..=text.len())
        .find(|at| text.is_char_boundary(*at))
        .unwrap_or(text.len())
}

/// Returns the nearest character boundary at or before `at`.
fn floor(text: &str, at: usize) -> usize {
    let at = at.min(text.len());
    (0..=at)
        .rev()
        .find(|at| text.is_char_boundary(*at))
        .unwrap_or(0)
}

/// One line of a source with the range of its label.
#[derive(Debug)]
struct Excerpt {
    name: String,
    text: String,
    label: (usize, usize),
    line: usize,
    column: usize,
}

impl miette::SourceCode for Excerpt {
    fn read_span<'a>(
        &'a self,
        _span: &SourceSpan,
        _before: usize,
        _after: usize,
    ) -> Result<Box<dyn miette::SpanContents<'a> + 'a>, miette::MietteError> {
        Ok(Box::new(MietteSpanContents::new_named(
            self.name.clone(),
            self.text.as_bytes(),
            (0, self.text.len()).into(),
            self.line,
            self.column,
            1,
        )))
    }
}

#[derive(Debug)]
struct Drawing<'a> {
    row: &'a DiagnosticRow,
    line: Option<Excerpt>,
    used_at: Option<RelatedUse<'a>>,
}

/// The second position of a row.
#[derive(Debug)]
struct RelatedUse<'a> {
    place: &'a DiagnosticPosition,
    line: Option<Excerpt>,
}

impl fmt::Display for RelatedUse<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let DiagnosticPosition {
            file, line, column, ..
        } = self.place;
        f.write_str(&self.place.label)?;
        match &self.line {
            Some(_) => Ok(()),
            None => write!(f, " [{file}:{line}:{column}]"),
        }
    }
}

impl std::error::Error for RelatedUse<'_> {}

impl miette::Diagnostic for RelatedUse<'_> {
    fn severity(&self) -> Option<miette::Severity> {
        Some(miette::Severity::Advice)
    }

    fn source_code(&self) -> Option<&dyn miette::SourceCode> {
        let line = self.line.as_ref()?;
        Some(line)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        let (at, length) = self.line.as_ref()?.label;
        let label = LabeledSpan::new(None, at, length);
        Some(Box::new(std::iter::once(label)))
    }
}

impl fmt::Display for Drawing<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.row.message)?;
        match (&self.line, self.row.line) {
            (Some(_), _) => Ok(()),
            (None, 0) if self.row.file.is_empty() => Ok(()),
            (None, 0) => write!(f, " [{}]", self.row.file),
            (None, line) => write!(f, " [{}:{line}:{}]", self.row.file, self.row.column),
        }
    }
}

impl std::error::Error for Drawing<'_> {}

impl miette::Diagnostic for Drawing<'_> {
    fn code<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        Some(Box::new(&self.row.code))
    }

    fn severity(&self) -> Option<miette::Severity> {
        Some(match self.row.severity {
            Severity::Error => miette::Severity::Error,
            Severity::Warning => miette::Severity::Warning,
        })
    }

    fn help<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        let help = self.row.help.as_ref()?;
        Some(Box::new(help))
    }

    fn related<'a>(&'a self) -> Option<Box<dyn Iterator<Item = &'a dyn miette::Diagnostic> + 'a>> {
        let used_at = self.used_at.as_ref()?;
        let used_at: &dyn miette::Diagnostic = used_at;
        Some(Box::new(std::iter::once(used_at)))
    }

    fn source_code(&self) -> Option<&dyn miette::SourceCode> {
        self.line
            .as_ref()
            .map(|line| line as &dyn miette::SourceCode)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        let line = self.line.as_ref()?;
        let text = (!self.row.label.is_empty()).then(|| self.row.label.clone());
        let (at, length) = line.label;
        Some(Box::new(std::iter::once(LabeledSpan::new(
            text, at, length,
        ))))
    }
}
