//! The age of a cycle: from one look at the executor's cycle number, without shared memory. Pure.

use std::time::Instant;

/// The number of the newest cycle at a time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CycleTime {
    /// Before the request was sent: the cycle was not older then, so ages come out too large rather than too small.
    pub at: Instant,
    /// Number of the cycle in the answer.
    pub cycle: u64,
    /// Period, ns.
    pub period_ns: u64,
}

impl CycleTime {
    /// Returns the age of what was computed in a cycle, ns.
    pub fn age_ns(&self, cycle: u64, now: Instant) -> u64 {
        let since = now.saturating_duration_since(self.at).as_nanos();
        let since = i128::try_from(since).unwrap_or(i128::MAX);
        // No overflow: a period is at most a second.
        let behind = (i128::from(self.cycle) - i128::from(cycle)) * i128::from(self.period_ns);
        u64::try_from((since + behind).max(0)).unwrap_or(u64::MAX)
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn the_age_is_that_of_the_cycle() {
        let at = Instant::now();
        let time = CycleTime {
            at,
            cycle: 1000,
            period_ns: 1_000_000,
        };
        let later = at + Duration::from_millis(50);
        assert_eq!(time.age_ns(1000, later), 50_000_000);
        assert_eq!(time.age_ns(990, later), 60_000_000);
        assert_eq!(time.age_ns(1049, later), 1_000_000);
        // Newer than the estimate.
        assert_eq!(time.age_ns(1100, later), 0);
    }
}
