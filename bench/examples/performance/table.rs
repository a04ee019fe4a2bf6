//! Formats tables and numbers in Markdown.

use rcc_bench::measure::TimeStats;

/// Formats a table: the first column is text, the others are numbers.
pub fn table(head: &[&str], rows: &[Vec<String>]) -> String {
    let line = |cells: Vec<String>| format!("| {} |\n", cells.join(" | "));
    let mut text = line(head.iter().map(|cell| (*cell).to_owned()).collect());
    text += &line(
        (0..head.len())
            .map(|column| if column == 0 { "---" } else { "---:" }.to_owned())
            .collect(),
    );
    rows.iter().for_each(|row| text += &line(row.clone()));
    text
}

/// Formats a number with three significant digits.
pub fn digits(value: f64) -> String {
    match value.abs() {
        _ if !value.is_finite() => "–".to_owned(),
        size if size >= 100.0 => format!("{value:.0}"),
        size if size >= 10.0 => format!("{value:.1}"),
        _ => format!("{value:.2}"),
    }
}

/// Formats a median with the fastest and the slowest round, all divided by `by`.
pub fn spread(figure: TimeStats, by: f64) -> String {
    format!(
        "{} ({}–{})",
        digits(figure.median / by),
        digits(figure.low / by),
        digits(figure.high / by)
    )
}

/// Formats whether a goal is met, and by how much it is missed.
pub fn verdict(value: f64, goal: f64) -> String {
    if value <= goal {
        format!("≤ {goal}: met")
    } else {
        format!(
            "≤ {goal}: **missed** by {:.0} %",
            (value / goal - 1.0) * 100.0
        )
    }
}
