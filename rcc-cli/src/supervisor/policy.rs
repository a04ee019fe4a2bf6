//! How often a process that dies is started again.
//! Pure; the supervisor's thread tells it the time.

use std::collections::VecDeque;
use std::time::Duration;

/// So many starts again …
pub const RESTARTS_MAX: usize = 5;
/// … within this time; one more death and the process has failed for good.
pub const WINDOW: Duration = Duration::from_secs(30);
/// Pause before the first start again; it doubles with each within the window.
const PAUSE_FIRST: Duration = Duration::from_millis(50);

/// The deaths of one process.
#[derive(Clone, Debug, Default)]
pub struct Restarts {
    deaths: VecDeque<Duration>,
}

/// What follows a death.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Start it again at this time; it is the `nth` time within the window.
    Again {
        /// When, on the supervisor's clock.
        at: Duration,
        /// 1 to [`RESTARTS_MAX`].
        nth: usize,
    },
    /// It has failed for good.
    Failed,
}

impl Restarts {
    /// It died at `now` (time since the supervisor's start).
    pub fn died(&mut self, now: Duration) -> Verdict {
        while self
            .deaths
            .front()
            .is_some_and(|death| now.saturating_sub(*death) > WINDOW)
        {
            self.deaths.pop_front();
        }
        if self.deaths.len() >= RESTARTS_MAX {
            return Verdict::Failed;
        }
        let pause = PAUSE_FIRST * (1 << self.deaths.len());
        self.deaths.push_back(now);
        Verdict::Again {
            at: now + pause,
            nth: self.deaths.len(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sixth_death_within_the_window_is_the_last() {
        let mut restarts = Restarts::default();
        for second in 0..5 {
            let verdict = restarts.died(Duration::from_secs(second));
            assert!(matches!(verdict, Verdict::Again { nth, .. } if nth == second as usize + 1));
        }
        assert_eq!(restarts.died(Duration::from_secs(6)), Verdict::Failed);
    }

    #[test]
    fn old_deaths_are_forgotten() {
        let mut restarts = Restarts::default();
        for second in [0, 10, 20, 25, 29, 31, 45] {
            let verdict = restarts.died(Duration::from_secs(second));
            assert_ne!(verdict, Verdict::Failed, "{second}");
        }
    }

    #[test]
    fn each_pause_is_longer_than_the_one_before() {
        let mut restarts = Restarts::default();
        let pauses: Vec<Duration> = (0..5)
            .filter_map(|_| match restarts.died(Duration::ZERO) {
                Verdict::Again { at, .. } => Some(at),
                Verdict::Failed => None,
            })
            .collect();
        assert_eq!(pauses.len(), 5);
        assert!(pauses.windows(2).all(|pair| pair[0] < pair[1]));
    }
}
