//! Rate limit for log messages about events that others can cause at any rate: one message per interval, with the
//! number of suppressed ones. Used by threads that log; never by a real-time thread.

use std::time::{Duration, Instant};

/// Minimum interval between two messages.
pub const LOG_INTERVAL: Duration = Duration::from_secs(1);

/// Time of the last message and number of messages suppressed since.
#[derive(Debug, Default)]
pub struct LogThrottle {
    last: Option<Instant>,
    suppressed: u64,
}

impl LogThrottle {
    /// Returns the number of messages suppressed since the last one if a message may be logged now, else `None`.
    pub fn admit(&mut self, now: Instant) -> Option<u64> {
        let soon = |last| now.saturating_duration_since(last) < LOG_INTERVAL;
        if self.last.is_some_and(soon) {
            self.suppressed += 1;
            return None;
        }
        self.last = Some(now);
        Some(std::mem::take(&mut self.suppressed))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn admits_one_message_per_interval_and_counts_the_others() {
        let mut throttle = LogThrottle::default();
        let begin = Instant::now();
        assert_eq!(throttle.admit(begin), Some(0));
        for _ in 0..1000 {
            assert_eq!(throttle.admit(begin + LOG_INTERVAL / 2), None);
        }
        assert_eq!(throttle.admit(begin + LOG_INTERVAL), Some(1000));
        assert_eq!(throttle.admit(begin + LOG_INTERVAL * 3), Some(0));
    }
}
