//! Restart policy of a process. Pure; the supervisor's thread passes the time.

use std::collections::VecDeque;
use std::time::Duration;

use rcc_config::cell::SupervisionConfig;

/// Pause before the first restart; it doubles with each restart within the window …
const PAUSE_FIRST: Duration = Duration::from_millis(50);
/// … up to this.
const PAUSE_MAX: Duration = Duration::from_secs(5);

/// Restart limits and deaths of one process.
#[derive(Clone, Debug)]
pub struct RestartPolicy {
    most: usize,
    window: Duration,
    deaths: VecDeque<Duration>,
}

/// Decision after a death.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RestartDecision {
    /// Restart at this time; the `nth` restart within the window.
    Restart {
        /// Time on the supervisor's clock.
        at: Duration,
        /// Number of the restart, from 1 to the limit.
        nth: usize,
    },
    /// Failed permanently.
    Failed,
}

/// The remedy for a process that ended or could not be started.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Remedy {
    /// A restart cannot help, only this.
    Final(&'static str),
    /// If restarts do not help.
    AfterRestarts(&'static str),
}

impl Remedy {
    /// Returns true if a restart cannot help.
    #[must_use]
    pub fn is_final(self) -> bool {
        matches!(self, Remedy::Final(_))
    }

    /// Returns the words.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Remedy::Final(words) | Remedy::AfterRestarts(words) => words,
        }
    }
}

impl RestartPolicy {
    /// Creates the policy of a cell's configuration: this many restarts within the window; at the next death the
    /// process has failed permanently.
    #[must_use]
    pub fn new(supervision: &SupervisionConfig) -> RestartPolicy {
        RestartPolicy {
            // A u32 fits into usize.
            most: supervision.restarts as usize,
            window: Duration::from_nanos(supervision.within_ns),
            deaths: VecDeque::new(),
        }
    }

    /// Records a death at `now` (time since the supervisor's start).
    pub fn record_death(&mut self, now: Duration) -> RestartDecision {
        while self
            .deaths
            .front()
            .is_some_and(|death| now.saturating_sub(*death) > self.window)
        {
            self.deaths.pop_front();
        }
        if self.deaths.len() >= self.most {
            return RestartDecision::Failed;
        }
        let pause = (PAUSE_FIRST * (1 << self.deaths.len().min(10))).min(PAUSE_MAX);
        self.deaths.push_back(now);
        RestartDecision::Restart {
            at: now + pause,
            nth: self.deaths.len(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn usual() -> RestartPolicy {
        RestartPolicy::new(&SupervisionConfig::default())
    }

    #[test]
    fn the_configuration_sets_the_limit() {
        let mut restarts = RestartPolicy::new(&SupervisionConfig {
            restarts: 0,
            ..SupervisionConfig::default()
        });
        assert_eq!(
            restarts.record_death(Duration::ZERO),
            RestartDecision::Failed
        );
    }

    #[test]
    fn the_sixth_death_within_the_window_is_a_failure() {
        let mut restarts = usual();
        for second in 0..5 {
            let verdict = restarts.record_death(Duration::from_secs(second));
            assert!(
                matches!(verdict, RestartDecision::Restart { nth, .. } if nth == second as usize + 1)
            );
        }
        assert_eq!(
            restarts.record_death(Duration::from_secs(6)),
            RestartDecision::Failed
        );
    }

    #[test]
    fn old_deaths_are_forgotten() {
        let mut restarts = usual();
        for second in [0, 10, 20, 25, 29, 31, 45] {
            let verdict = restarts.record_death(Duration::from_secs(second));
            assert_ne!(verdict, RestartDecision::Failed, "{second}");
        }
    }

    #[test]
    fn each_pause_is_longer_than_the_one_before() {
        let mut restarts = usual();
        let pauses: Vec<Duration> = (0..5)
            .filter_map(|_| match restarts.record_death(Duration::ZERO) {
                RestartDecision::Restart { at, .. } => Some(at),
                RestartDecision::Failed => None,
            })
            .collect();
        assert_eq!(pauses.len(), 5);
        assert!(pauses.windows(2).all(|pair| pair[0] < pair[1]));
    }
}
