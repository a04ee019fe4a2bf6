//! Periodic work of the loader: it finds the executor, removes files of commands that are gone, and rejects commands
//! that nobody loads any more. Run by the maintenance thread.

use std::collections::BTreeMap;
use std::sync::PoisonError;
use std::time::{Duration, Instant};

use rcc_api::codes;
use rcc_api::error::ApiError;

use super::{Service, load};

/// Minimum age at which the file of a command that is not in the table is removed.
const SWEEP_AGE_MIN: Duration = Duration::from_secs(5);
/// Minimum time for which a command is `loading` in the executor's table without being loaded, before it is rejected:
/// longer than an answer of the executor takes.
const UNCLAIMED_AGE_MIN: Duration = Duration::from_secs(15);

/// Commands that are `loading` and that nobody loads, of one incarnation of the executor, with the time since when that
/// is known.
#[derive(Debug, Default)]
pub(super) struct UnclaimedCommands {
    executor: u64,
    since: BTreeMap<u64, Instant>,
}

impl UnclaimedCommands {
    /// Takes the commands of this pass; returns those that have been unclaimed for `age_min`.
    fn observe(&mut self, executor: u64, ids: &[u64], age_min: Duration) -> Vec<u64> {
        if self.executor != executor {
            *self = UnclaimedCommands {
                executor,
                since: BTreeMap::new(),
            };
        }
        self.since.retain(|id, _| ids.contains(id));
        let now = Instant::now();
        let is_due = |id: &u64| {
            let since = *self.since.entry(*id).or_insert(now);
            now.saturating_duration_since(since) >= age_min
        };
        ids.iter().copied().filter(is_due).collect()
    }
}

impl Service {
    /// Periodic maintenance.
    pub fn maintain(&self) {
        self.check_files();
        if let Ok((attached, store)) = self.attach() {
            let snapshot = attached.tables();
            store.sweep(|id| snapshot.command(id).is_some(), SWEEP_AGE_MIN);
            self.reject_unclaimed(UNCLAIMED_AGE_MIN);
        }
    }

    /// Rejects the commands that have been `loading` for this long without being loaded: the executor's answer to their
    /// reservation came too late, or a thread of this loader failed. They would occupy the table for ever.
    pub fn reject_unclaimed(&self, age_min: Duration) {
        let Ok((attached, store)) = self.attach() else {
            return;
        };
        let mut ids = load::orphans(&attached);
        let known = self.loading.get();
        // A command that was reserved just now may not be in `loading` yet; the next pass finds it there.
        ids.retain(|id| !known.contains_key(id));
        let due = {
            // A panic leaves it intact: it is observed again in each pass.
            let unclaimed = self.unclaimed.lock();
            let mut unclaimed = unclaimed.unwrap_or_else(PoisonError::into_inner);
            unclaimed.observe(attached.announcement.incarnation, &ids, age_min)
        };
        let given_up = ApiError::new(
            codes::GIVEN_UP,
            "this command was reserved and never loaded",
            "load the text again",
        );
        for id in due {
            self.reject(id, &given_up, &store);
        }
    }
}
