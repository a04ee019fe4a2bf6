//! The follower of one axis: it stores its current motion as words in an arena, and requests another one when the goal
//! or the limits change. Run by the real-time thread.

use super::{AxisState, MotionLimits, PHASES_MAX, Phases, limits_are_valid, to_velocity};

/// Number of words of an axis: goal, limits of the motion, cycles since its start, current state, start state, phases.
pub const AXIS_WORDS: usize = 1 + 3 + 1 + 3 + 3 + 2 * PHASES_MAX;

/// An end this close to its goal, in units of jerk limit × period³, is snapped to the goal: the step is hidden within
/// the jerk of one cycle.
const SAME: f64 = 1e-4;

/// Relative rounding error of a position after a motion has been followed to its end.
const ROUNDING: f64 = 16.0 * f64::EPSILON;

/// A goal that takes longer than this at the velocity limit is ignored, s.
const LONGEST_S: f64 = 1e9;

/// One axis that follows a goal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisFollower {
    /// Goal of the motion; NaN: a stop, wherever it ends.
    goal: f64,
    /// Limits that the motion was planned with.
    limits: MotionLimits,
    /// Periods from the start of the motion to the current state.
    periods: f64,
    now: AxisState,
    start: AxisState,
    phases: Phases,
}

impl AxisFollower {
    /// Creates a follower at rest at `position`, without a goal.
    #[must_use]
    pub fn at_rest(position: f64) -> AxisFollower {
        AxisFollower {
            goal: f64::NAN,
            limits: MotionLimits {
                velocity: f64::NAN,
                acceleration: f64::NAN,
                jerk: f64::NAN,
            },
            periods: 0.0,
            now: AxisState::at_rest(position),
            start: AxisState::at_rest(position),
            phases: Phases::default(),
        }
    }

    /// Creates a follower in motion, as if it had been stepped to this state; its next step plans on from there.
    #[must_use]
    pub fn moving(state: AxisState) -> AxisFollower {
        AxisFollower {
            // Not a stop, and without limits: whatever comes first is planned. It is finite, because the arena holds
            // infinite numbers as null.
            goal: state.position,
            periods: 1.0,
            now: state,
            start: state,
            ..AxisFollower::at_rest(state.position)
        }
    }

    /// Returns true if it has not been stepped yet.
    #[must_use]
    pub fn is_new(&self) -> bool {
        self.periods == 0.0
    }

    /// Returns position, velocity and acceleration of the last step.
    #[must_use]
    pub fn state(&self) -> AxisState {
        self.now
    }

    /// Returns true if it is at rest at its goal.
    #[must_use]
    pub fn arrived(&self) -> bool {
        self.now.rests() && self.now.position == self.goal
    }

    /// Returns whether the next step towards this goal would plan a motion; `None` if the goal counts as none.
    #[must_use]
    pub fn plans(&self, goal: f64, limits: &MotionLimits) -> Option<bool> {
        let goal = self.reachable(Some(goal), limits)?;
        Some(!self.follows(goal, limits))
    }

    /// Begins a motion to `goal` that was planned from its state with these limits; the next step follows it.
    pub fn begin(&mut self, goal: f64, limits: &MotionLimits, way: Phases) {
        (self.goal, self.limits, self.phases) = (goal, *limits, way);
        (self.start, self.periods) = (self.now, 0.0);
    }

    /// The goal, unless it counts as none.
    fn reachable(&self, goal: Option<f64>, limits: &MotionLimits) -> Option<f64> {
        let near = |goal: &f64| (goal - self.now.position).abs() <= LONGEST_S * limits.velocity;
        goal.filter(|goal| near(goal) && limits_are_valid(limits))
    }

    /// Its motion leads to this goal within these limits. One that ended beside its goal is planned again.
    fn follows(&self, goal: f64, limits: &MotionLimits) -> bool {
        self.goal == goal && self.limits == *limits && !self.missed()
    }

    /// Advances by one period of `dt_s`, towards `goal` or, without a goal, to rest. `plan` returns the motion from a
    /// state to rest at a goal, and is called only when goal or limits differ from those of the last step.
    ///
    /// If the velocity limit is not above 0, or the goal is not finite or farther away than 10⁹ s at the velocity
    /// limit, the axis comes to rest. If the acceleration or jerk limit is not finite and above 0, it continues its
    /// current motion.
    pub fn step(
        &mut self,
        goal: Option<f64>,
        limits: &MotionLimits,
        dt_s: f64,
        plan: impl FnOnce(&AxisState, f64, &MotionLimits) -> Phases,
    ) -> AxisState {
        let goal = self.reachable(goal, limits);
        let bounded = |limit: f64| limit.is_finite() && limit > 0.0;
        let stays = !(bounded(limits.acceleration) && bounded(limits.jerk));
        let same = match goal {
            Some(goal) => self.follows(goal, limits),
            // A stop keeps the limits that it started with.
            None => self.goal.is_nan(),
        };
        if !(same || stays) {
            let way = match goal {
                Some(goal) => plan(&self.now, goal, limits),
                None => Phases::of(&[&to_velocity(&self.now, 0.0, limits)]),
            };
            self.begin(goal.unwrap_or(f64::NAN), limits, way);
        }
        self.periods += 1.0;
        self.now = self.at(self.periods * dt_s, self.limits.jerk * dt_s * dt_s * dt_s);
        self.now
    }

    fn missed(&self) -> bool {
        self.periods > 0.0 && self.now.rests() && self.now.position != self.goal
    }

    fn at(&self, t_s: f64, step: f64) -> AxisState {
        let (mut left_s, mut state) = (t_s, self.start);
        for (duration_s, jerk) in self.phases.0 {
            if left_s < duration_s {
                return state.after(left_s, jerk);
            }
            left_s -= duration_s;
            state = state.after(duration_s, jerk);
        }
        let rounding = ROUNDING * (state.position.abs() + self.start.position.abs());
        let near = (state.position - self.goal).abs() <= SAME * step + rounding;
        AxisState::at_rest(if near { self.goal } else { state.position })
    }

    /// Returns the complete state; two followers with equal words continue identically.
    #[must_use]
    pub fn words(&self) -> [f64; AXIS_WORDS] {
        let MotionLimits {
            velocity,
            acceleration,
            jerk,
        } = self.limits;
        let numbers = |state: AxisState| [state.position, state.velocity, state.acceleration];
        let phases = self
            .phases
            .0
            .iter()
            .flat_map(|(duration_s, jerk)| [*duration_s, *jerk]);
        let all = [self.goal, velocity, acceleration, jerk, self.periods].into_iter();
        let all = all
            .chain(numbers(self.now))
            .chain(numbers(self.start))
            .chain(phases);
        let mut words = [0.0; AXIS_WORDS];
        for (place, word) in words.iter_mut().zip(all) {
            *place = word;
        }
        words
    }

    /// Restores a follower from its words. Arbitrary words give a follower without a meaningful motion, which cannot
    /// fail either.
    #[must_use]
    pub fn from_words(words: &[f64; AXIS_WORDS]) -> AxisFollower {
        let [
            goal,
            velocity,
            acceleration,
            jerk,
            periods,
            p,
            v,
            a,
            p0,
            v0,
            a0,
            rest @ ..,
        ] = *words;
        let mut phases = Phases::default();
        let (pairs, _) = rest.as_chunks::<2>();
        for (phase, [duration_s, jerk]) in phases.0.iter_mut().zip(pairs) {
            *phase = (*duration_s, *jerk);
        }
        let state = |[position, velocity, acceleration]: [f64; 3]| AxisState {
            position,
            velocity,
            acceleration,
        };
        AxisFollower {
            goal,
            limits: MotionLimits {
                velocity,
                acceleration,
                jerk,
            },
            periods,
            now: state([p, v, a]),
            start: state([p0, v0, a0]),
            phases,
        }
    }
}
