//! The goals of one action: their states, and which of them a request for CANCEL means. Pure.

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

/// A goal.
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

/// The goals of one action, in the order of their arrival.
#[derive(Clone, Debug, Default)]
pub struct GoalTable {
    goals: Vec<KnownGoal>,
}

impl GoalTable {
    /// Returns a goal.
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

    /// Returns the goals that a request means and that have not ended: the one of its id, and those that were accepted until
    /// its time; all if both are 0 (action_msgs/CancelGoal).
    #[must_use]
    pub fn meant(&self, request: &CancelRequest) -> Vec<GoalId> {
        let GoalInfo { goal_id, stamp } = request.goal_info;
        let living = self.goals.iter().filter(|goal| goal.outcome.is_none());
        let meant = living.filter(
            |goal| match (goal_id == GoalId::ZERO, stamp == Time::ZERO) {
                (true, true) => true,
                (false, true) => goal.id == goal_id,
                (_, false) => goal.id == goal_id || goal.accepted.is_some_and(|at| at <= stamp),
            },
        );
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
