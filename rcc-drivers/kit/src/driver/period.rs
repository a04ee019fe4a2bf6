//! The pace of a driver whose device does not send by itself.
//! Run by the exchange thread.

use std::time::{Duration, Instant};

use super::LinkError;

/// Periods of equal length since the driver was opened; a late one is skipped, never caught up with.
#[derive(Clone, Copy, Debug)]
pub struct PeriodTimer {
    period: Duration,
    /// Start of the next period.
    next: Instant,
}

impl PeriodTimer {
    /// Returns a timer whose first period starts now; `period` is greater than 0.
    #[must_use]
    pub fn new(period: Duration) -> PeriodTimer {
        PeriodTimer {
            period,
            next: Instant::now(),
        }
    }

    /// Waits for the start of the next period, at most `timeout`; returns the number of periods since the last one, at
    /// least 1.
    ///
    /// # Errors
    /// Returns [`LinkError::Silent`] if the period has not started after `timeout`.
    pub fn wait(&mut self, timeout: Duration) -> Result<u64, LinkError> {
        let left = self.next.saturating_duration_since(Instant::now());
        std::thread::sleep(left.min(timeout));
        if left > timeout {
            return Err(LinkError::Silent);
        }
        Ok(self.ticks(Instant::now()))
    }

    /// Returns the period, ns.
    #[must_use]
    pub fn period_ns(&self) -> u64 {
        u64::try_from(self.period.as_nanos()).unwrap_or(u64::MAX)
    }

    /// Schedules the period after `now`, in which one starts; returns the number of periods since the last one.
    fn ticks(&mut self, now: Instant) -> u64 {
        let behind = now.saturating_duration_since(self.next);
        let skipped = behind.as_nanos() / self.period.as_nanos().max(1);
        let skipped = u32::try_from(skipped).unwrap_or(u32::MAX - 1);
        self.next += self.period.saturating_mul(skipped + 1);
        u64::from(skipped) + 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn late_periods_are_counted_and_the_grid_stays() {
        let mut timer = PeriodTimer::new(Duration::from_millis(10));
        let begun = timer.next;
        let at = |ms| begun + Duration::from_millis(ms);
        assert_eq!(timer.ticks(at(0)), 1);
        assert_eq!(timer.ticks(at(19)), 1);
        assert_eq!(timer.ticks(at(45)), 3);
        assert_eq!(timer.next, at(50));
    }

    #[test]
    fn a_period_that_does_not_start_in_time_is_a_pause() {
        let mut timer = PeriodTimer::new(Duration::from_secs(3600));
        assert_eq!(timer.wait(Duration::ZERO), Ok(1));
        assert_eq!(timer.wait(Duration::ZERO), Err(LinkError::Silent));
    }
}
