//! Age of a received value, without comparing the clocks of two machines: the sender's age, the delay beyond the shortest
//! transit, and the own time since arrival. Pure; the clocks are arguments.
//!
//! A message that waited in a queue while the link was cut carries the age that it had when it was sent. Therefore the
//! differences between arrival and sending (of two clocks with unknown offset) are compared with the smallest one so far
//! (the minimum filter of NTP, RFC 5905, 10): what is above is delay. The smallest one may grow slowly, because the two
//! clocks drift.

/// Drift of two clocks against each other that is allowed for, parts in a million.
const DRIFT_PPM: u64 = 500;

/// The delay of messages of one sender beyond its shortest transit.
#[derive(Clone, Copy, Debug, Default)]
pub struct Transit {
    /// Smallest difference between arrival and sending, and the arrival at which it was last looked at, ns.
    base: Option<(i128, u64)>,
}

impl Transit {
    /// Returns the delay of a message, ns: 0 for the quickest one.
    pub fn delay_ns(&mut self, sent_ns: u64, arrival_ns: u64) -> u64 {
        let offset = i128::from(arrival_ns) - i128::from(sent_ns);
        let base = match self.base {
            None => offset,
            Some((base, at_ns)) => {
                let passed = arrival_ns.saturating_sub(at_ns);
                // No overflow: a clock of 2^64 ns times 500 fits into 128 bits.
                let drift = i128::from(passed) * i128::from(DRIFT_PPM) / 1_000_000;
                offset.min(base + drift)
            }
        };
        self.base = Some((base, arrival_ns));
        u64::try_from(offset - base).unwrap_or(u64::MAX)
    }
}

/// The newest value of a topic, as it arrived.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AgedValue {
    /// The value; `None` is null.
    pub value: Option<f64>,
    /// Age at the arrival: sender's age and delay, ns.
    pub age_ns: u64,
    /// Own monotonic clock at the arrival, ns.
    pub arrival_ns: u64,
}

impl AgedValue {
    /// Returns its age at a time of the own clock, ns.
    #[must_use]
    pub fn age_at(&self, now_ns: u64) -> u64 {
        let since = now_ns.saturating_sub(self.arrival_ns);
        self.age_ns.saturating_add(since)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    #[test]
    fn the_offset_of_the_clocks_has_no_influence() {
        for offset in [0, 5 * MS, 1 << 60] {
            let mut transit = Transit::default();
            assert_eq!(transit.delay_ns(1000 * MS, 1000 * MS + offset), 0);
            assert_eq!(transit.delay_ns(1010 * MS, 1010 * MS + offset), 0);
            // The sender's clock may be ahead as well.
            let mut transit = Transit::default();
            assert_eq!(transit.delay_ns((1 << 61) + MS, MS), 0);
        }
    }

    #[test]
    fn messages_of_a_cut_are_as_old_as_the_cut() {
        let mut transit = Transit::default();
        let mut at = |sent: u64, arrival: u64| transit.delay_ns(sent * MS, arrival * MS + 123);
        assert_eq!(at(0, 0), 0);
        assert_eq!(at(10, 10), 0);
        // Cut from 15 to 3015 ms; everything arrives at once.
        let late = at(20, 3015);
        assert!((2993 * MS..=2995 * MS).contains(&late), "{late}");
        let newest = at(3010, 3016);
        assert!((4 * MS..=6 * MS).contains(&newest), "{newest}");
        assert!(at(3020, 3020) <= 2 * MS);
    }

    #[test]
    fn a_drift_of_the_clocks_is_no_delay() {
        let mut transit = Transit::default();
        // The receiver's clock is 100 ppm faster, for an hour.
        let worst = (0..3600).map(|second: u64| {
            let sent = second * 1000 * MS;
            transit.delay_ns(sent, sent + sent / 10_000)
        });
        assert_eq!(worst.max(), Some(0));
    }

    #[test]
    fn a_quicker_way_is_the_new_base_and_a_slower_one_counts_for_a_while() {
        let mut transit = Transit::default();
        assert_eq!(transit.delay_ns(0, 10 * MS), 0);
        assert_eq!(transit.delay_ns(1000 * MS, 1002 * MS), 0);
        let slower = transit.delay_ns(2000 * MS, 2010 * MS);
        assert!((7 * MS..=8 * MS).contains(&slower), "{slower}");
        let later = transit.delay_ns(30_000 * MS, 30_010 * MS);
        assert_eq!(later, 0);
    }

    #[test]
    fn a_value_ages_at_the_receiver() {
        let value = AgedValue {
            value: Some(1.0),
            age_ns: 4 * MS,
            arrival_ns: 100 * MS,
        };
        assert_eq!(value.age_at(100 * MS), 4 * MS);
        assert_eq!(value.age_at(107 * MS), 11 * MS);
        // Read before it arrived: two threads.
        assert_eq!(value.age_at(0), 4 * MS);
    }
}
