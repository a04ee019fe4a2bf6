//! Tables for people: columns without borders, as wide as their content. Pure.

use comfy_table::presets::NOTHING;
use comfy_table::{ContentArrangement, Table};
use rcc_core::counted::Noun;

/// Creates a table with these headings.
#[must_use]
pub fn table(heads: &[&str]) -> Table {
    let mut table = Table::new();
    table
        .load_style(NOTHING)
        .set_content_arrangement(ContentArrangement::Disabled)
        .set_header(heads);
    table
}

/// Formats the table as text, without trailing blanks.
#[must_use]
pub fn text(table: &Table) -> String {
    let lines: Vec<String> = table
        .lines()
        .map(|line| {
            line.trim_end()
                .strip_prefix(' ')
                .unwrap_or(line.trim_end())
                .to_owned()
        })
        .collect();
    lines.join("\n")
}

/// Formats a duration in a suitable unit.
#[must_use]
pub fn time(ns: u64) -> String {
    let value = ns as f64;
    match ns {
        0 => "–".to_owned(),
        1..1_000 => format!("{ns} ns"),
        1_000..1_000_000 => format!("{:.1} µs", value / 1e3),
        1_000_000..1_000_000_000 => format!("{:.1} ms", value / 1e6),
        _ => format!("{:.1} s", value / 1e9),
    }
}

/// Formats a duration that is known, in a sentence: 0 is `0 µs`.
#[must_use]
pub fn span(ns: u64) -> String {
    match ns {
        0 => "0 µs".to_owned(),
        ns => time(ns),
    }
}

/// Formats a count with its digits grouped by three, and its noun, given in the singular.
#[must_use]
pub fn counted(number: u64, noun: &str) -> String {
    format!("{} {}", grouped(number), Noun(number, noun))
}

/// Formats a number with its digits grouped by three.
#[must_use]
pub fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let mut out = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            out.push(' ');
        }
        out.push(digit);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_grouped_by_three() {
        assert_eq!(grouped(7), "7");
        assert_eq!(grouped(81_422), "81 422");
        assert_eq!(grouped(1_000_000), "1 000 000");
        assert_eq!(counted(1, "late cycle"), "1 late cycle");
        assert_eq!(counted(10_000, "late cycle"), "10 000 late cycles");
    }

    #[test]
    fn times_have_the_unit_that_suits_them() {
        assert_eq!(time(0), "–");
        assert_eq!((span(0), span(500_000)), ("0 µs".into(), "500.0 µs".into()));
        assert_eq!(time(5_900), "5.9 µs");
        assert_eq!(time(1_200_000_000), "1.2 s");
    }

    #[test]
    fn columns_begin_at_the_margin() {
        let mut table = table(&["NET", "STATE"]);
        table.add_row(["line#1", "ready"]);
        assert_eq!(text(&table), "NET     STATE\nline#1  ready");
    }
}
