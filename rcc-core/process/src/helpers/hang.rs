//! Detects helper threads that hang. Checked by the thread that notifies the supervisor.

use std::time::{Duration, Instant};

use rcc_core::helper::HelperState;

use super::Helpers;
use crate::health::HealthReport;

/// A helper that makes no progress.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Hang {
    /// Name of the helper.
    pub helper: &'static str,
    /// Time without progress.
    pub silent: Duration,
    /// Allowed time without progress.
    pub limit: Duration,
}

impl std::fmt::Display for Hang {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Hang {
            helper,
            silent,
            limit,
        } = self;
        let (silent, limit) = (silent.as_secs_f64(), limit.as_secs_f64());
        write!(
            formatter,
            "the helper thread `{helper}` hangs: no progress for {silent:.1} s, the limit is {limit:.1} s"
        )
    }
}

/// Progress of one helper as seen by the watch.
#[derive(Clone, Copy, Debug, Default)]
struct HelperProgress {
    turns: u64,
    silent: Duration,
    reported: bool,
}

/// Detects helpers that hang; see [`Helpers::watch`].
pub struct HangWatch {
    helpers: Helpers,
    seen: Vec<HelperProgress>,
    looked: Instant,
    held: u64,
    on_hang: Box<dyn FnMut(&Hang) + Send>,
}

impl Helpers {
    /// Creates a watch for helpers that hang. It calls `on_hang` once per hang.
    pub fn watch(&self, on_hang: impl FnMut(&Hang) + Send + 'static) -> HangWatch {
        HangWatch {
            helpers: self.clone(),
            seen: Vec::new(),
            looked: Instant::now(),
            held: 0,
            on_hang: Box::new(on_hang),
        }
    }
}

/// Maximum time between two checks that counts as silence of a helper: if the watch itself did not run for longer (a
/// stopped process, a starved machine), it cannot know whether the helper made progress.
const LOOK_MAX: Duration = Duration::from_secs(1);

impl HangWatch {
    /// Returns the report to send: while a helper hangs, without progress and with the name of the helper in its
    /// status.
    pub fn check(&mut self, report: HealthReport) -> HealthReport {
        let since = self.looked.elapsed().min(LOOK_MAX);
        self.looked = Instant::now();
        match self.hang(since) {
            None => {
                self.held = report.progress;
                report
            }
            Some(hang) => HealthReport {
                progress: self.held,
                status: format!("HANGS: {hang}; {}", report.status),
            },
        }
    }

    /// Returns the helper that has hung longest. `since` is the time since the previous check.
    fn hang(&mut self, since: Duration) -> Option<Hang> {
        let beats = self.helpers.beats();
        self.seen.resize(beats.len(), HelperProgress::default());
        let mut worst: Option<Hang> = None;
        for (beat, seen) in beats.iter().zip(&mut self.seen) {
            let turns = beat.turns();
            // A helper that still waits although all were started hangs as well.
            let over = matches!(beat.state(), HelperState::Ended | HelperState::Panicked);
            if turns != seen.turns || over {
                *seen = HelperProgress {
                    turns,
                    ..HelperProgress::default()
                };
                continue;
            }
            seen.silent += since;
            let limit = Duration::from_nanos(beat.limit_ns());
            if seen.silent <= limit {
                continue;
            }
            let hang = Hang {
                helper: beat.name(),
                silent: seen.silent,
                limit,
            };
            if !std::mem::replace(&mut seen.reported, true) {
                (self.on_hang)(&hang);
            }
            if worst.is_none_or(|worst| worst.silent < hang.silent) {
                worst = Some(hang);
            }
        }
        worst
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::channel;

    #[test]
    fn a_helper_that_never_begins_counts_as_hung() {
        let helpers = Helpers::default();
        let _helper = helpers.helper("net-builder", Duration::from_secs(2));
        let mut watch = helpers.watch(|_| {});
        let hang = watch.hang(Duration::from_secs(3)).unwrap();
        assert_eq!(hang.helper, "net-builder");
    }

    #[test]
    fn a_hang_stops_the_heartbeat_names_the_helper_and_ends_with_its_next_turn() {
        let helpers = Helpers::default();
        let helper = helpers.helper("pump", Duration::from_secs(2));
        let (sender, receiver) = channel();
        let mut watch = helpers.watch(move |hang| {
            let _ = sender.send(hang.helper);
        });
        helper.turn();
        let second = Duration::from_secs(1);
        assert_eq!(watch.hang(second), None);
        assert_eq!(watch.hang(second), None);
        assert_eq!(watch.hang(second), None, "the limit is two seconds");
        let hang = watch.hang(second).unwrap();
        assert_eq!((hang.helper, hang.silent), ("pump", 3 * second));
        let report = watch.check(HealthReport {
            progress: 7,
            status: "fine".to_owned(),
        });
        assert_eq!(report.progress, 0);
        assert!(report.status.contains("`pump` hangs"), "{}", report.status);
        assert_eq!(receiver.try_iter().count(), 1, "reported once");
        helper.turn();
        assert_eq!(watch.hang(second), None);
        helpers.end();
    }
}
