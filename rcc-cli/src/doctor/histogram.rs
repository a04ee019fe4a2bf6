//! A histogram of times with a fixed size: 16 buckets an octave, so that a quantile is exact to 6 %.
//! Written by the measuring thread, which may not allocate; read by the main thread.

use serde::Serialize;

const SUB: u64 = 16;
const BUCKETS: usize = 61 * SUB as usize;

/// Bounds of the rows that people see, ns.
const ROWS: [u64; 13] = [
    5_000, 10_000, 20_000, 50_000, 100_000, 200_000, 500_000, 1_000_000, 2_000_000, 5_000_000,
    10_000_000, 20_000_000, 50_000_000,
];
const BAR: usize = 40;

/// Times in nanoseconds.
#[derive(Clone, Debug)]
pub struct Histogram {
    buckets: Box<[u64]>,
    count: u64,
    min: u64,
    max: u64,
}

/// Times up to a bound, as it is told to programs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Bucket {
    /// Upper bound, ns; inclusive.
    pub to_ns: u64,
    /// How many lie between the bound before and this one.
    pub count: u64,
}

impl Default for Histogram {
    fn default() -> Self {
        Histogram {
            buckets: vec![0; BUCKETS].into_boxed_slice(),
            count: 0,
            min: u64::MAX,
            max: 0,
        }
    }
}

impl Histogram {
    /// Takes a time in; allocates nothing.
    pub fn add(&mut self, ns: u64) {
        if let Some(bucket) = self.buckets.get_mut(index(ns)) {
            *bucket += 1;
        }
        self.count += 1;
        self.min = self.min.min(ns);
        self.max = self.max.max(ns);
    }

    /// How many.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.count
    }

    /// The shortest, ns; 0 if there is none.
    #[must_use]
    pub fn min(&self) -> u64 {
        if self.count == 0 { 0 } else { self.min }
    }

    /// The longest, ns.
    #[must_use]
    pub fn max(&self) -> u64 {
        self.max
    }

    /// At most this long are so many thousandths of all, ns.
    #[must_use]
    pub fn quantile(&self, permille: u64) -> u64 {
        let wanted = (self.count * permille).div_ceil(1000);
        let mut seen = 0;
        for (index, count) in self.buckets.iter().enumerate() {
            seen += count;
            if seen >= wanted && seen > 0 {
                return upper(index).clamp(self.min(), self.max);
            }
        }
        self.max
    }

    /// The occupied buckets.
    #[must_use]
    pub fn buckets(&self) -> Vec<Bucket> {
        let rows = self.buckets.iter().enumerate();
        rows.filter(|(_, count)| **count > 0)
            .map(|(index, count)| Bucket {
                to_ns: upper(index),
                count: *count,
            })
            .collect()
    }

    /// One line a row that has something above it and below it; the bars are logarithmic, as the rare ones matter.
    #[must_use]
    pub fn drawing(&self) -> String {
        let mut counts = [0_u64; ROWS.len() + 1];
        for Bucket { to_ns, count } in self.buckets() {
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
}

fn short(ns: u64) -> String {
    if ns < 1_000_000 {
        format!("{} µs", ns / 1000)
    } else {
        format!("{} ms", ns / 1_000_000)
    }
}

/// One is seen, ten times as many are longer by the same.
fn bar(count: u64, most: u64) -> usize {
    if count == 0 {
        return 0;
    }
    let part = (count as f64 + 1.0).ln() / (most as f64 + 1.0).ln().max(1.0);
    ((part * BAR as f64) as usize).clamp(1, BAR)
}

fn index(ns: u64) -> usize {
    if ns < SUB {
        return ns as usize;
    }
    let octave = u64::from(63 - ns.leading_zeros());
    ((octave - 3) * SUB + (ns >> (octave - 4)) - SUB) as usize
}

/// The largest time that the bucket holds.
fn upper(index: usize) -> u64 {
    let index = index as u64;
    if index < SUB {
        return index;
    }
    let octave = index / SUB + 3;
    let next = u128::from(SUB + index % SUB + 1) << (octave - 4);
    u64::try_from(next - 1).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_time_lies_in_its_bucket_within_six_percent() {
        for shift in 0..64 {
            for ns in [
                1_u64 << shift,
                (1 << shift) + (1 << shift) / 3,
                u64::MAX >> shift,
            ] {
                let bound = upper(index(ns));
                assert!(index(ns) < BUCKETS && bound >= ns, "{ns} {bound}");
                assert!(bound - ns <= ns / 16 + 1, "{ns} {bound}");
                assert!(index(ns) == 0 || upper(index(ns) - 1) < ns, "{ns}");
            }
        }
    }

    #[test]
    fn quantiles_are_between_shortest_and_longest() {
        let mut histogram = Histogram::default();
        for us in 1..=1000 {
            histogram.add(us * 1000);
        }
        assert_eq!((histogram.min(), histogram.max()), (1_000, 1_000_000));
        let median = histogram.quantile(500);
        assert!((500_000..=532_000).contains(&median), "{median}");
        assert_eq!(histogram.quantile(1000), 1_000_000);
        assert!(histogram.quantile(999) >= 999_000);
    }

    #[test]
    fn an_empty_histogram_says_nothing() {
        let histogram = Histogram::default();
        assert_eq!(
            (histogram.min(), histogram.max(), histogram.quantile(500)),
            (0, 0, 0)
        );
        assert_eq!(histogram.drawing(), "");
    }

    #[test]
    fn one_among_many_is_seen_in_the_drawing() {
        let mut histogram = Histogram::default();
        for _ in 0..5000 {
            histogram.add(7_000);
        }
        histogram.add(9_100_000);
        let drawing = histogram.drawing();
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
