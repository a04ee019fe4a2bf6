//! Histograms for people and programs: buckets, and a drawing with logarithmic bars. Pure.

pub use rcc_api::bodies::BucketView as Bucket;
use rcc_core::histogram::Histogram;

/// Upper bounds of the drawn rows, ns.
const ROWS: [u64; 17] = [
    200, 500, 1_000, 2_000, 5_000, 10_000, 20_000, 50_000, 100_000, 200_000, 500_000, 1_000_000,
    2_000_000, 5_000_000, 10_000_000, 20_000_000, 50_000_000,
];
const BAR: usize = 40;

/// Returns the occupied buckets.
#[must_use]
pub fn buckets(histogram: &Histogram) -> Vec<Bucket> {
    let rows = histogram.buckets();
    rows.map(|(to_ns, count)| Bucket { to_ns, count }).collect()
}

/// Draws one line per row between the first and last occupied one; the bars are logarithmic, because rare values
/// matter.
#[must_use]
pub fn drawing(buckets: impl IntoIterator<Item = Bucket>) -> String {
    let mut counts = [0_u64; ROWS.len() + 1];
    for Bucket { to_ns, count } in buckets {
        let row = ROWS.iter().position(|bound| to_ns <= *bound);
        counts[row.unwrap_or(ROWS.len())] += count;
    }
    let Some(first) = counts.iter().position(|count| *count > 0) else {
        return String::new();
    };
    let last = counts.iter().rposition(|count| *count > 0).unwrap_or(first);
    let most = counts.iter().copied().max().unwrap_or(1);
    let mut text = String::new();
    for (row, count) in counts.iter().enumerate().take(last + 1).skip(first) {
        let bound = ROWS.get(row).map_or_else(
            || format!("> {}", short(ROWS[ROWS.len() - 1])),
            |bound| format!("≤ {}", short(*bound)),
        );
        text.push_str(&format!(
            "{bound:>9}  {:<BAR$} {count}\n",
            "#".repeat(bar(*count, most))
        ));
    }
    text
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

/// Returns the length of a bar: at least 1 for any count, and logarithmic.
fn bar(count: u64, most: u64) -> usize {
    if count == 0 {
        return 0;
    }
    let part = (count as f64 + 1.0).ln() / (most as f64 + 1.0).ln().max(1.0);
    ((part * BAR as f64) as usize).clamp(1, BAR)
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
        let first = drawing.lines().next().unwrap_or_default();
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
}
