//! A histogram of times with a fixed size: 16 buckets per octave, so that a quantile is accurate to 6 %. Written by the
//! real-time thread and by programs that measure beside it; plain data, so that it can be part of a board.

use bytemuck::{Pod, Zeroable};

/// Buckets per octave.
const SUB: u64 = 16;
/// Times below this share the first bucket; 2^6 ns.
const LOWEST_NS: u64 = 1 << LOWEST_OCTAVE;
const LOWEST_OCTAVE: u64 = 6;
/// Times from this value on share the last bucket; 2^30 ns, about a second.
const HIGHEST_NS: u64 = 1 << HIGHEST_OCTAVE;
const HIGHEST_OCTAVE: u64 = 30;

/// Number of buckets: one below the range, one above.
pub const BUCKETS: usize = ((HIGHEST_OCTAVE - LOWEST_OCTAVE) * SUB) as usize + 2;

/// Times in nanoseconds. All zero means empty.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct Histogram {
    count: u64,
    min: u64,
    max: u64,
    sum: u64,
    buckets: [u64; BUCKETS],
}

impl Default for Histogram {
    fn default() -> Self {
        Histogram::zeroed()
    }
}

impl Histogram {
    /// Adds a time, ns.
    #[inline]
    pub fn add(&mut self, ns: u64) {
        if let Some(bucket) = self.buckets.get_mut(index(ns)) {
            *bucket += 1;
        }
        self.min = if self.count == 0 {
            ns
        } else {
            self.min.min(ns)
        };
        self.count += 1;
        self.max = self.max.max(ns);
        self.sum = self.sum.saturating_add(ns);
    }

    /// Returns the number of times.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Returns the shortest time, ns; 0 if empty.
    #[must_use]
    pub fn min(&self) -> u64 {
        self.min
    }

    /// Returns the longest time, ns; 0 if empty.
    #[must_use]
    pub fn max(&self) -> u64 {
        self.max
    }

    /// Returns the sum of all times, ns.
    #[must_use]
    pub fn sum(&self) -> u64 {
        self.sum
    }

    /// Adds all times of another histogram.
    pub fn merge(&mut self, other: &Histogram) {
        if other.count == 0 {
            return;
        }
        for (bucket, count) in self.buckets.iter_mut().zip(&other.buckets) {
            *bucket += count;
        }
        self.min = match self.count {
            0 => other.min,
            _ => self.min.min(other.min),
        };
        self.count += other.count;
        self.max = self.max.max(other.max);
        self.sum = self.sum.saturating_add(other.sum);
    }

    /// Returns the mean, ns; 0 if empty.
    #[must_use]
    pub fn mean(&self) -> u64 {
        self.sum.checked_div(self.count).unwrap_or(0)
    }

    /// Returns the `permille` quantile, ns: at least that many thousandths of all times are not longer. 0 if empty.
    #[must_use]
    pub fn quantile(&self, permille: u64) -> u64 {
        let wanted = (u128::from(self.count) * u128::from(permille)).div_ceil(1000);
        let mut seen = 0u128;
        for (index, count) in self.buckets.iter().enumerate() {
            seen += u128::from(*count);
            if seen >= wanted && seen > 0 {
                return upper(index).max(self.min).min(self.max);
            }
        }
        self.max
    }

    /// Returns the occupied buckets: inclusive upper bound in ns, and count.
    pub fn buckets(&self) -> impl Iterator<Item = (u64, u64)> + '_ {
        let rows = self.buckets.iter().enumerate();
        rows.filter(|(_, count)| **count > 0)
            .map(|(index, count)| (upper(index), *count))
    }
}

fn index(ns: u64) -> usize {
    if ns < LOWEST_NS {
        return 0;
    }
    if ns >= HIGHEST_NS {
        return BUCKETS - 1;
    }
    let octave = u64::from(63 - ns.leading_zeros());
    let within = (ns >> (octave - 4)) - SUB;
    ((octave - LOWEST_OCTAVE) * SUB + within + 1) as usize
}

/// Returns the largest time in the bucket, ns.
fn upper(index: usize) -> u64 {
    if index + 1 >= BUCKETS {
        return u64::MAX;
    }
    let index = index as u64;
    if index == 0 {
        return LOWEST_NS - 1;
    }
    let octave = (index - 1) / SUB + LOWEST_OCTAVE;
    ((SUB + (index - 1) % SUB + 1) << (octave - 4)) - 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_time_within_the_range_lies_in_its_bucket_within_six_percent() {
        for octave in LOWEST_OCTAVE..HIGHEST_OCTAVE {
            for ns in [
                1_u64 << octave,
                (1 << octave) + (1 << octave) / 3,
                (1 << (octave + 1)) - 1,
            ] {
                let bound = upper(index(ns));
                assert!(bound >= ns && bound - ns <= ns / 16 + 1, "{ns} {bound}");
                assert!(upper(index(ns) - 1) < ns, "{ns}");
            }
        }
    }

    #[test]
    fn times_outside_the_range_keep_their_extremes() {
        let mut histogram = Histogram::default();
        for ns in [0, 63, HIGHEST_NS, u64::MAX] {
            histogram.add(ns);
        }
        assert_eq!((histogram.min(), histogram.max()), (0, u64::MAX));
        assert_eq!((index(63), index(HIGHEST_NS)), (0, BUCKETS - 1));
        assert_eq!(index(HIGHEST_NS - 1), BUCKETS - 2);
        assert_eq!(histogram.quantile(1000), u64::MAX);
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
        assert_eq!(histogram.mean(), 500_500);
    }

    #[test]
    fn merged_histograms_have_all_times_of_both() {
        let (mut all, mut one, mut other) = (
            Histogram::default(),
            Histogram::default(),
            Histogram::default(),
        );
        for ns in [70, 5_000, 900_000] {
            all.add(ns);
            one.add(ns);
        }
        for ns in [10, 5_000, u64::MAX / 4] {
            all.add(ns);
            other.add(ns);
        }
        one.merge(&other);
        one.merge(&Histogram::default());
        assert_eq!(bytemuck::bytes_of(&one), bytemuck::bytes_of(&all));
        let mut empty = Histogram::default();
        empty.merge(&all);
        assert_eq!(bytemuck::bytes_of(&empty), bytemuck::bytes_of(&all));
        assert_eq!(all.sum(), 70 + 5_000 + 900_000 + 10 + 5_000 + u64::MAX / 4);
    }

    #[test]
    fn an_empty_histogram_gives_zeros() {
        let empty = Histogram::default();
        assert_eq!((empty.min(), empty.max(), empty.quantile(500)), (0, 0, 0));
        assert_eq!((empty.mean(), empty.buckets().count()), (0, 0));
    }
}
