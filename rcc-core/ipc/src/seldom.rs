//! Words about what others may cause as often as they like: said at most once in a while, with how often it happened.
//! Used by threads that log; never by a real-time thread.

use std::time::{Duration, Instant};

/// How often something is said at most.
pub const SELDOM: Duration = Duration::from_secs(1);

/// Remembers when it was said last, and how often it was kept back since.
#[derive(Debug, Default)]
pub struct Seldom {
    said: Option<Instant>,
    kept_back: u64,
}

impl Seldom {
    /// Whether to say it now: then how often it was kept back since the last time.
    pub fn say(&mut self, now: Instant) -> Option<u64> {
        let soon = |said| now.saturating_duration_since(said) < SELDOM;
        if self.said.is_some_and(soon) {
            self.kept_back += 1;
            return None;
        }
        self.said = Some(now);
        Some(std::mem::take(&mut self.kept_back))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_many_in_a_second_one_is_said_and_the_others_are_counted() {
        let mut seldom = Seldom::default();
        let begin = Instant::now();
        assert_eq!(seldom.say(begin), Some(0));
        for _ in 0..1000 {
            assert_eq!(seldom.say(begin + SELDOM / 2), None);
        }
        assert_eq!(seldom.say(begin + SELDOM), Some(1000));
        assert_eq!(seldom.say(begin + SELDOM * 3), Some(0));
    }
}
