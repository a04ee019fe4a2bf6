//! Histograms for people and programs: buckets, and a drawing with logarithmic bars. Pure.

pub use rcc_api::bodies::BucketView as Bucket;
use rcc_core::histogram::Histogram;

/// Upper bounds of the drawn rows, ns.
const FINE: [u64; 17] = [
    200, 500, 1_000, 2_000, 5_000, 10_000, 20_000, 50_000, 100_000, 200_000, 500_000, 1_000_000,
    2_000_000, 5_000_000, 10_000_000, 20_000_000, 50_000_000,
];
/// Upper bounds of the rows of a small drawing, ns.
const COARSE: [u64; 6] = [1_000, 10_000, 100_000, 1_000_000, 10_000_000, 100_000_000];
/// Longest bar.
const BAR: usize = 40;
/// Columns of the upper bound and the gap behind it.
const BOUND: usize = 11;

/// Number of rows of a drawing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Detail {
    /// Three rows per decade.
    Fine,
    /// One row per decade.
    Coarse,
}

/// Returns the occupied buckets.
#[must_use]
pub fn buckets(histogram: &Histogram) -> Vec<Bucket> {
    let rows = histogram.buckets();
    rows.map(|(to_ns, count)| Bucket { to_ns, count }).collect()
}

/// Draws the headings, and one line per row between the first and last occupied one; the bars are logarithmic, because
/// rare values matter. Empty without samples.
#[must_use]
pub fn drawing(buckets: impl IntoIterator<Item = Bucket>) -> String {
    fitted_drawing(buckets, Detail::Fine, usize::MAX)
}

/// As [`drawing`], in at most `columns` columns: the bars get what the numbers leave.
#[must_use]
pub fn fitted_drawing(
    buckets: impl IntoIterator<Item = Bucket>,
    detail: Detail,
    columns: usize,
) -> String {
    let bounds: &[u64] = match detail {
        Detail::Fine => &FINE,
        Detail::Coarse => &COARSE,
    };
    let mut counts = vec![0_u64; bounds.len() + 1];
    for Bucket { to_ns, count } in buckets {
        let row = bounds.iter().position(|bound| to_ns <= *bound);
        counts[row.unwrap_or(bounds.len())] += count;
    }
    let Some(first) = counts.iter().position(|count| *count > 0) else {
        return String::new();
    };
    let last = counts.iter().rposition(|count| *count > 0).unwrap_or(first);
    let most = counts.iter().copied().max().unwrap_or(1);
    let digits = most.to_string().len().max("CYCLES".len());
    let bar_max = columns.saturating_sub(BOUND + 1 + digits).min(BAR);
    let mut text = format!("{:>9}  {:<bar_max$} CYCLES\n", "TIME", label(bar_max));
    for (row, count) in counts.iter().enumerate().take(last + 1).skip(first) {
        let bound = bounds.get(row).map_or_else(
            || format!("> {}", short(bounds[bounds.len() - 1])),
            |bound| format!("≤ {}", short(*bound)),
        );
        text.push_str(&format!(
            "{bound:>9}  {:<bar_max$} {count}\n",
            "#".repeat(bar(*count, most, bar_max))
        ));
    }
    text
}

/// Returns the heading of the bars that fits.
fn label(bar_max: usize) -> &'static str {
    let labels = ["(logarithmic)", "(log)", ""];
    let fitting = labels.into_iter().find(|label| label.len() <= bar_max);
    fitting.unwrap_or("")
}

fn short(ns: u64) -> String {
    if ns < 1_000 {
        format!("{ns} ns")
    } else if ns < 1_000_000 {
        format!("{} µs", ns / 1000)
    } else {
        format!("{} ms", ns / 1_000_000)
    }
}

/// Returns the length of a bar: at least 1 for any count if there is room, and logarithmic.
fn bar(count: u64, most: u64, bar_max: usize) -> usize {
    if count == 0 || bar_max == 0 {
        return 0;
    }
    let part = (count as f64 + 1.0).ln() / (most as f64 + 1.0).ln().max(1.0);
    ((part * bar_max as f64) as usize).clamp(1, bar_max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_histogram_is_not_drawn() {
        assert_eq!(drawing([]), "");
    }

    #[test]
    fn one_among_many_is_seen_in_the_drawing() {
        let mut histogram = Histogram::default();
        for _ in 0..5000 {
            histogram.add(7_000);
        }
        histogram.add(9_100_000);
        let drawing = drawing(buckets(&histogram));
        let first = drawing.lines().nth(1).unwrap_or_default();
        assert!(
            first.contains("≤ 10 µs") && first.ends_with("# 5000"),
            "{drawing}"
        );
        let last = drawing.lines().last().unwrap_or_default();
        assert!(
            last.contains("≤ 10 ms") && last.contains('#') && last.ends_with(" 1"),
            "{drawing}"
        );
    }

    #[test]
    fn a_drawing_of_any_width_keeps_its_numbers_and_labels_its_bars() {
        let buckets = [(7_000, 1_234_567), (9_100_000, 1)];
        let buckets = buckets.map(|(to_ns, count)| Bucket { to_ns, count });
        for (columns, label) in [(26, "(log)"), (40, "(logarithmic)"), (80, "(logarithmic)")] {
            for (detail, rows) in [(Detail::Fine, 11), (Detail::Coarse, 5)] {
                let text = fitted_drawing(buckets, detail, columns);
                assert_eq!(text.lines().count(), rows, "{text}");
                assert!(text.contains("TIME") && text.contains("CYCLES"), "{text}");
                assert!(text.contains(label), "{text}");
                assert!(text.contains(" 1234567\n") && text.ends_with(" 1\n"));
                let fits = |line: &str| line.chars().count() <= columns;
                assert!(text.lines().all(fits), "{columns}\n{text}");
            }
        }
        let bare = fitted_drawing(buckets, Detail::Coarse, 10);
        assert!(bare.contains("1234567") && !bare.contains('#'), "{bare}");
    }
}
