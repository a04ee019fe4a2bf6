//! Cells of CSV tables (RFC 4180): names of ports contain commas (`m.out[0,1]`), so headers are quoted where needed.

use std::borrow::Cow;

/// Returns a cell as it is written.
#[must_use]
pub fn cell(text: &str) -> Cow<'_, str> {
    if text.contains([',', '"', '\n', '\r']) {
        Cow::Owned(format!("\"{}\"", text.replace('"', "\"\"")))
    } else {
        Cow::Borrowed(text)
    }
}

/// Returns a line of cells.
#[must_use]
pub fn line<T: AsRef<str>>(cells: &[T]) -> String {
    let cells: Vec<Cow<'_, str>> = cells.iter().map(|text| cell(text.as_ref())).collect();
    cells.join(",")
}

/// Returns the cells of a line. A quote that is not closed ends with the line.
#[must_use]
pub fn cells(line: &str) -> Vec<String> {
    let mut cells = vec![String::new()];
    let mut is_quoted = false;
    let mut characters = line.chars().peekable();
    while let Some(character) = characters.next() {
        match character {
            '"' if is_quoted && characters.peek() == Some(&'"') => {
                characters.next();
                if let Some(cell) = cells.last_mut() {
                    cell.push('"');
                }
            }
            '"' => is_quoted = !is_quoted,
            ',' if !is_quoted => cells.push(String::new()),
            other => {
                if let Some(cell) = cells.last_mut() {
                    cell.push(other);
                }
            }
        }
    }
    cells
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_again() {
        let names = ["time [s]", "net/m.out[0,1] [N]", "say \"no\"", ""];
        let written = line(&names);
        assert_eq!(
            written,
            "time [s],\"net/m.out[0,1] [N]\",\"say \"\"no\"\"\","
        );
        assert_eq!(cells(&written), names);
    }
}
