//! Words about what others may cause as often as they like: said at most once in a while, with how often it happened.
//! Used by threads that log; never by a real-time thread.

use std::time::{Duration, Instant};

/// How often something is said at most.
pub const LOG_INTERVAL: Duration = Duration::from_secs(1);

/// Remembers when it was said last, and how often it was kept back since.
#[derive(Debug, Default)]
pub struct LogThrottle {
    said: Option<Instant>,
    suppressed: u64,
}

impl LogThrottle {
    /// Whether to say it now: then how often it was kept back since the last time.
    pub fn admit(&mut self, now: Instant) -> Option<u64> {
        let soon = |said| now.saturating_duration_since(said) < LOG_INTERVAL;
        if self.said.is_some_and(soon) {
            self.suppressed += 1;
            return None;
        }
        self.said = Some(now);
        Some(std::mem::take(&mut self.suppressed))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_many_in_a_second_one_is_said_and_the_others_are_counted() {
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
