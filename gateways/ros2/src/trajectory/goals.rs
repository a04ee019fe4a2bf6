//! The goals of one action: their states, and which of them a request for CANCEL means. Used by the serving thread; the thread
//! that starts goals sees which of them were canceled before.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use ros2_client::action_msgs::{GoalId, GoalInfo, GoalStatus, GoalStatusArray, GoalStatusEnum};
use ros2_client::builtin_interfaces::Time;
use serde::Deserialize;

use crate::trajectory::messages::Outcome;

/// Ended goals whose results are kept for clients that ask late.
const ENDED_MAX: usize = 64;

/// `action_msgs/srv/CancelGoal_Request`; the fields of the library's type are private.
#[derive(Clone, Debug, Deserialize)]
pub struct CancelRequest {
    /// Goal and time; 0 stands for all.
    pub goal_info: GoalInfo,
}

impl CancelRequest {
    /// Returns true for the goal of its id, and for those until its time; for all if both are 0 (action_msgs/CancelGoal).
    fn means(&self, id: GoalId, since: Option<Time>) -> bool {
        let GoalInfo { goal_id, stamp } = self.goal_info;
        match (goal_id == GoalId::ZERO, stamp == Time::ZERO) {
            (true, true) => true,
            (false, true) => id == goal_id,
            (_, false) => id == goal_id || since.is_some_and(|since| since <= stamp),
        }
    }
}

/// A goal that was started or refused.
#[derive(Clone, Debug)]
pub struct KnownGoal {
    /// Its id.
    pub id: GoalId,
    /// When it was accepted; `None`: it was refused.
    pub accepted: Option<Time>,
    /// Its state.
    pub status: GoalStatusEnum,
    /// Its result, once it has ended.
    pub outcome: Option<Outcome>,
}

/// Set when a client cancels a goal before its START: the goal must not be started.
#[derive(Clone, Debug, Default)]
pub struct CancelFlag(Arc<AtomicBool>);

impl CancelFlag {
    /// Returns true if it was canceled.
    #[must_use]
    pub fn is_set(&self) -> bool {
        // Acquire pairs with the release of `set`.
        self.0.load(Ordering::Acquire)
    }

    pub(crate) fn set(&self) {
        // Release pairs with the acquire of `is_set`.
        self.0.store(true, Ordering::Release);
    }
}

/// A goal that waits, or that is checked, rehearsed and started.
#[derive(Clone, Debug)]
struct PendingGoal {
    id: GoalId,
    arrived: Time,
    canceled: CancelFlag,
}

/// The goals of one action, in the order of their arrival.
#[derive(Clone, Debug, Default)]
pub struct GoalTable {
    pending: Vec<PendingGoal>,
    /// Those that were started or refused.
    goals: Vec<KnownGoal>,
}

impl GoalTable {
    /// Adds a goal that is to be started.
    pub fn wait(&mut self, id: GoalId, now: Time, canceled: CancelFlag) {
        self.pending.push(PendingGoal {
            id,
            arrived: now,
            canceled,
        });
    }

    /// Removes a goal that was started, or is not. Returns true if it was canceled meanwhile.
    pub fn end_wait(&mut self, id: GoalId) -> bool {
        let found = self.pending.iter().position(|goal| goal.id == id);
        found.is_some_and(|place| self.pending.remove(place).canceled.is_set())
    }

    /// Returns true while a goal is to be started.
    #[must_use]
    pub fn waits(&self) -> bool {
        !self.pending.is_empty()
    }

    /// Returns true for a goal that is to be started.
    #[must_use]
    pub fn is_pending(&self, id: GoalId) -> bool {
        self.pending.iter().any(|goal| goal.id == id)
    }

    /// Returns true if a goal of this id has come before.
    #[must_use]
    pub fn knows(&self, id: GoalId) -> bool {
        self.is_pending(id) || self.of(id).is_some()
    }

    /// Cancels the goals that a request means and that are to be started, and returns them. The time of such a goal is that of
    /// its arrival.
    pub fn cancel_pending(&mut self, request: &CancelRequest) -> Vec<GoalInfo> {
        let pending = self.pending.iter();
        let meant = pending.filter(|goal| request.means(goal.id, Some(goal.arrived)));
        let canceled = meant.map(|goal| {
            goal.canceled.set();
            GoalInfo {
                goal_id: goal.id,
                stamp: goal.arrived,
            }
        });
        canceled.collect()
    }

    /// Returns a goal that was started or refused.
    #[must_use]
    pub fn of(&self, id: GoalId) -> Option<&KnownGoal> {
        self.goals.iter().find(|goal| goal.id == id)
    }

    /// Adds a goal that moves the arm.
    pub fn accept(&mut self, id: GoalId, now: Time) {
        self.add(KnownGoal {
            id,
            accepted: Some(now),
            status: GoalStatusEnum::Executing,
            outcome: None,
        });
    }

    /// Adds a goal that was refused, for clients that ask for its result.
    pub fn refuse(&mut self, id: GoalId, outcome: Outcome) {
        self.add(KnownGoal {
            id,
            accepted: None,
            status: GoalStatusEnum::Aborted,
            outcome: Some(outcome),
        });
    }

    fn add(&mut self, goal: KnownGoal) {
        let ended = self
            .goals
            .iter()
            .filter(|one| one.outcome.is_some())
            .count();
        if ended >= ENDED_MAX
            && let Some(oldest) = self.goals.iter().position(|one| one.outcome.is_some())
        {
            self.goals.remove(oldest);
        }
        self.goals.push(goal);
    }

    /// Sets the state of a goal.
    pub fn set(&mut self, id: GoalId, status: GoalStatusEnum) {
        if let Some(goal) = self.goals.iter_mut().find(|goal| goal.id == id) {
            goal.status = status;
        }
    }

    /// Ends a goal.
    pub fn end(&mut self, id: GoalId, status: GoalStatusEnum, outcome: Outcome) {
        if let Some(goal) = self.goals.iter_mut().find(|goal| goal.id == id) {
            (goal.status, goal.outcome) = (status, Some(outcome));
        }
    }

    /// Returns what is published of them; refused goals never had a state.
    #[must_use]
    pub fn statuses(&self) -> GoalStatusArray {
        let rows = self.goals.iter().filter_map(|goal| {
            Some(GoalStatus {
                goal_info: GoalInfo {
                    goal_id: goal.id,
                    stamp: goal.accepted?,
                },
                status: goal.status,
            })
        });
        GoalStatusArray {
            status_list: rows.collect(),
        }
    }

    /// Returns the started goals that a request means and that have not ended.
    #[must_use]
    pub fn meant(&self, request: &CancelRequest) -> Vec<GoalId> {
        let living = self.goals.iter().filter(|goal| goal.outcome.is_none());
        let meant = living.filter(|goal| request.means(goal.id, goal.accepted));
        meant.map(|goal| goal.id).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request(goal_id: GoalId, stamp: i64) -> CancelRequest {
        let stamp = Time::from_nanos(stamp);
        CancelRequest {
            goal_info: GoalInfo { goal_id, stamp },
        }
    }

    #[test]
    fn cancel_means_one_goal_or_those_until_a_time_or_all() {
        let [a, b, c] = [(); 3].map(|()| GoalId::new_random());
        let mut table = GoalTable::default();
        for (id, at) in [(a, 10), (b, 20), (c, 30)] {
            table.accept(id, Time::from_nanos(at));
        }
        assert_eq!(table.meant(&request(b, 0)), [b]);
        assert_eq!(table.meant(&request(GoalId::ZERO, 20)), [a, b]);
        assert_eq!(table.meant(&request(c, 10)), [a, c]);
        table.end(a, GoalStatusEnum::Succeeded, Outcome::default());
        assert_eq!(table.meant(&request(GoalId::ZERO, 0)), [b, c]);
        assert_eq!(table.meant(&request(a, 0)), []);
    }

    #[test]
    fn cancel_also_means_goals_that_are_to_be_started() {
        let ids = |goals: Vec<GoalInfo>| -> Vec<GoalId> {
            goals.iter().map(|goal| goal.goal_id).collect()
        };
        let [a, b, c] = [(); 3].map(|()| GoalId::new_random());
        // Each request with the goals that it means, of those that have come at 10, 20 and 30 ns.
        for (asked, meant) in [
            (request(GoalId::ZERO, 0), vec![a, b, c]),
            (request(b, 0), vec![b]),
            (request(GoalId::ZERO, 20), vec![a, b]),
            (request(c, 10), vec![a, c]),
            (request(GoalId::new_random(), 0), vec![]),
        ] {
            let mut table = GoalTable::default();
            let flags = [(a, 10), (b, 20), (c, 30)].map(|(id, at)| {
                let canceled = CancelFlag::default();
                table.wait(id, Time::from_nanos(at), canceled.clone());
                (id, canceled)
            });
            assert_eq!(ids(table.cancel_pending(&asked)), meant, "{asked:?}");
            for (id, canceled) in flags {
                // The starter sees it, and so does who takes what the starter has done.
                let is_meant = meant.contains(&id);
                assert_eq!(
                    (canceled.is_set(), table.end_wait(id)),
                    (is_meant, is_meant)
                );
            }
            assert!(!table.waits());
        }
    }

    #[test]
    fn a_goal_that_is_to_be_started_is_known_and_has_no_state_yet() {
        let mut table = GoalTable::default();
        let id = GoalId::new_random();
        assert!(!table.knows(id));
        table.wait(id, Time::from_nanos(1), CancelFlag::default());
        assert!(table.knows(id) && table.is_pending(id) && table.waits());
        assert!(table.of(id).is_none() && table.statuses().status_list.is_empty());
        assert!(!table.end_wait(id), "nobody has canceled it");
        table.accept(id, Time::from_nanos(2));
        assert!(table.knows(id) && !table.is_pending(id) && !table.waits());
    }

    #[test]
    fn the_results_of_old_goals_are_forgotten_and_living_goals_never() {
        let mut table = GoalTable::default();
        let living = GoalId::new_random();
        table.accept(living, Time::from_nanos(1));
        let first = GoalId::new_random();
        table.refuse(first, Outcome::default());
        for _ in 0..ENDED_MAX {
            table.refuse(GoalId::new_random(), Outcome::default());
        }
        assert!(table.of(first).is_none() && table.of(living).is_some());
        // A refused goal has no state.
        assert_eq!(table.statuses().status_list.len(), 1);
    }
}
