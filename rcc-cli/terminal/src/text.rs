//! The size of a terminal, and texts fitted to it: sentences are wrapped between words, tables are cut. Used by the
//! main thread and by printers.

use std::io;
use std::os::fd::AsFd;

use terminal_size::{Height, Width, terminal_size_of};
use textwrap::core::display_width;
use textwrap::{Options, WordSeparator, WordSplitter};

/// Narrowest terminal that texts are fitted to, columns.
const COLUMNS_MIN: usize = 20;

/// Columns and rows of a terminal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TerminalSize {
    /// Characters in a row.
    pub columns: usize,
    /// Rows.
    pub rows: usize,
}

impl TerminalSize {
    /// Returns the size of stdout; `None` if it is not a terminal.
    #[must_use]
    pub fn of_stdout() -> Option<TerminalSize> {
        TerminalSize::of(io::stdout())
    }

    /// Returns the size of stderr; `None` if it is not a terminal.
    #[must_use]
    pub fn of_stderr() -> Option<TerminalSize> {
        TerminalSize::of(io::stderr())
    }

    fn of(stream: impl AsFd) -> Option<TerminalSize> {
        let (Width(columns), Height(rows)) = terminal_size_of(stream)?;
        // Terminals without a known size report 0.
        (columns > 0 && rows > 0).then_some(TerminalSize {
            columns: usize::from(columns).max(COLUMNS_MIN),
            rows: usize::from(rows),
        })
    }
}

/// Wraps lines that are too long between words. Further rows of a line begin below its last column that starts in the
/// left half, or at its own indentation; a word that is longer than a row is not broken.
#[must_use]
pub fn wrapped(text: &str, columns: usize) -> String {
    let lines = text.split('\n').map(|line| wrapped_line(line, columns));
    lines.collect::<Vec<_>>().join("\n")
}

fn wrapped_line(line: &str, columns: usize) -> String {
    if display_width(line) <= columns {
        return line.to_owned();
    }
    let (head, sentence) = line.split_at(column_start(line, columns / 2));
    let indent = " ".repeat(display_width(head));
    let options = between_words(columns)
        .initial_indent(head)
        .subsequent_indent(&indent);
    textwrap::fill(sentence, options)
}

/// Returns the offset behind the last gap of two or more blanks in the first `limit` columns, or behind the line's
/// indentation.
fn column_start(line: &str, limit: usize) -> usize {
    let sentence = line.trim_start_matches(' ');
    let mut start = line.len() - sentence.len();
    let mut blanks = 0;
    for (at, character) in line.char_indices().take(limit) {
        if character != ' ' && blanks >= 2 {
            start = at;
        }
        blanks = if character == ' ' { blanks + 1 } else { 0 };
    }
    start
}

/// Returns options that keep words whole: names with hyphens or slashes too.
#[must_use]
pub fn between_words<'a>(columns: usize) -> Options<'a> {
    Options::new(columns)
        .break_words(false)
        .word_separator(WordSeparator::AsciiSpace)
        .word_splitter(WordSplitter::NoHyphenation)
}

/// Joins parts by two blanks, in as many rows as they need; a part is wrapped only if it is longer than a row.
#[must_use]
pub fn flowed(parts: &[String], columns: usize) -> Vec<String> {
    let mut rows: Vec<String> = Vec::new();
    for part in parts {
        match rows.last_mut() {
            Some(row) if display_width(row) + 2 + display_width(part) <= columns => {
                row.push_str("  ");
                row.push_str(part);
            }
            _ => rows.extend(wrapped(part, columns).split('\n').map(str::to_owned)),
        }
    }
    rows
}

/// Cuts a row of a table to the columns; `…` marks the cut.
#[must_use]
pub fn cut(row: &str, columns: usize) -> String {
    if display_width(row) <= columns {
        return row.to_owned();
    }
    let mut kept = String::new();
    let mut used = 0;
    for character in row.chars() {
        let width = display_width(character.encode_utf8(&mut [0; 4]));
        if used + width + 1 > columns {
            break;
        }
        kept.push(character);
        used += width;
    }
    kept.push('…');
    kept
}

/// Fits a table with `heads` rows of headings onto a screen on which the cursor has a row of its own: the headings
/// stay, and the last row gives the number of rows that do not fit.
#[must_use]
pub fn fitted(table: &str, heads: usize, size: TerminalSize) -> String {
    let all: Vec<&str> = table.trim_end_matches('\n').lines().collect();
    let room = size.rows.saturating_sub(1).max(heads + 1);
    let shown = if all.len() <= room {
        all.len()
    } else {
        room - 1
    };
    let mut rows: Vec<String> = all
        .iter()
        .take(shown)
        .map(|row| cut(row, size.columns))
        .collect();
    if shown < all.len() {
        let note = format!(
            "… and {} more: name the ports, or enlarge the terminal",
            all.len() - shown
        );
        rows.push(cut(&note, size.columns));
    }
    rows.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    const GRADE: &str = "RT: degraded, because SCHED_FIFO 80 was refused (Operation not permitted): raise the limit \
                         `rtprio` (LimitRTPRIO=80)";

    #[test]
    fn a_sentence_is_wrapped_below_its_column_and_loses_no_word() {
        for head in [
            "machine   ",
            "",
            "    0.123 s  executor             ",
            "       help: ",
        ] {
            for columns in [60, 80, 100] {
                let text = wrapped(&format!("{head}{GRADE}"), columns);
                assert!(
                    text.lines().all(|line| display_width(line) <= columns),
                    "{text}"
                );
                let words = |text: &str| text.split_whitespace().map(str::to_owned).collect();
                let (want, have): (Vec<String>, Vec<String>) =
                    (words(&format!("{head}{GRADE}")), words(&text));
                assert_eq!(have, want, "{columns}");
            }
        }
        let text = wrapped(&format!("machine   {GRADE}"), 60);
        assert_eq!(
            text.lines().next(),
            Some("machine   RT: degraded, because SCHED_FIFO 80 was refused")
        );
        assert!(
            text.lines()
                .skip(1)
                .all(|line| line.starts_with("          ")),
            "{text}"
        );
    }

    #[test]
    fn names_with_hyphens_stay_whole_and_short_lines_stay_as_they_are() {
        assert_eq!(
            wrapped("a  b\nloaded guarded-line/approach", 20),
            "a  b\nloaded\nguarded-line/approach"
        );
    }

    #[test]
    fn parts_stay_whole_if_a_row_can_hold_them() {
        let parts = ["cell demo", "cycle 12 345", "load 10.2 %"].map(str::to_owned);
        assert_eq!(
            flowed(&parts, 24),
            ["cell demo  cycle 12 345", "load 10.2 %"]
        );
        assert_eq!(flowed(&parts, 80).len(), 1);
    }

    #[test]
    fn a_long_table_keeps_its_headings_and_tells_how_much_is_missing() {
        let rows: Vec<String> = (0..50).map(|port| format!("port{port}  0.5  m")).collect();
        let table = format!("line#1  running\nPORT  VALUE  UNIT\n{}", rows.join("\n"));
        let size = TerminalSize {
            columns: 30,
            rows: 10,
        };
        let shown = fitted(&table, 2, size);
        let lines: Vec<&str> = shown.lines().collect();
        assert_eq!(lines.len(), 9, "{shown}");
        assert_eq!(lines[..2], ["line#1  running", "PORT  VALUE  UNIT"]);
        assert!(lines[8].starts_with("… and 44 more"), "{shown}");
        assert!(lines.iter().all(|line| display_width(line) <= 30));
        let short = fitted("a\nb", 1, size);
        assert_eq!(short, "a\nb");
    }
}
