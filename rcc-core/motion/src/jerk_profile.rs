//! Motion of one axis in phases of constant jerk, and the time-optimal change of velocity under acceleration and jerk
//! limits. Plain numbers: no allocation, no failure. Evaluated by the real-time thread and by drivers.

use rcc_core::axis::{AxisState, to_velocity};
use rcc_core::path::MotionLimits;

/// Most phases of a time-optimal motion from rest to rest.
pub(crate) const PHASES_MAX: usize = 7;

/// Iteration limit of the search for a time; at least every second iteration halves the bracket.
const SEARCH_MAX: usize = 100;

/// Limits of acceleration and jerk (each > 0).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct AccelerationLimits {
    pub(crate) acceleration: f64,
    pub(crate) jerk: f64,
}

impl AccelerationLimits {
    /// The fastest stop from `start`.
    pub(crate) fn stop(self, start: AxisState) -> VelocityChange {
        VelocityChange::new(start.velocity, start.acceleration, self)
    }
}

/// Time-optimal change to a velocity with zero acceleration at the end: three phases of jerk −J, 0, +J (or the
/// opposite), see [`to_velocity`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct VelocityChange {
    /// Durations of the three phases, s.
    durations_s: [f64; 3],
    /// Jerk of the first phase; the third phase has the opposite jerk.
    jerk: f64,
}

impl VelocityChange {
    /// The change from `velocity` (relative to the final velocity) and `acceleration`. An acceleration beyond its limit
    /// is reduced at the jerk limit and not exceeded further. A NaN gives NaN durations.
    pub(crate) fn new(velocity: f64, acceleration: f64, limits: AccelerationLimits) -> Self {
        let AccelerationLimits {
            acceleration: acceleration_max,
            jerk,
        } = limits;
        let from = AxisState {
            position: 0.0,
            velocity,
            acceleration,
        };
        let limits = MotionLimits {
            velocity: f64::INFINITY,
            acceleration: acceleration_max,
            jerk,
        };
        let phases = to_velocity(&from, 0.0, &limits);
        let is_nan = (velocity + acceleration).is_nan();
        Self {
            durations_s: phases.map(|(t_s, _)| if is_nan { f64::NAN } else { t_s }),
            jerk: phases[0].1,
        }
    }

    /// Reduces an acceleration in part: `duration_s` of constant jerk.
    pub(crate) fn relaxing(duration_s: f64, jerk: f64) -> Self {
        Self {
            durations_s: [duration_s, 0.0, 0.0],
            jerk,
        }
    }

    /// Total duration, s.
    pub(crate) fn duration_s(&self) -> f64 {
        self.durations_s.iter().sum()
    }

    /// The phases as duration (s) and jerk.
    pub(crate) fn steps(&self) -> [(f64, f64); 3] {
        let [first, hold, last] = self.durations_s;
        [(first, self.jerk), (hold, 0.0), (last, -self.jerk)]
    }

    /// State at the end of the change if it begins in `start`.
    pub(crate) fn end(&self, start: AxisState) -> AxisState {
        let step = |state: AxisState, (duration_s, jerk)| state.after(duration_s, jerk);
        self.steps().into_iter().fold(start, step)
    }

    /// The motion of this change if it begins in `start`.
    pub(crate) fn profile(&self, start: AxisState) -> JerkProfile {
        JerkProfile::new(start, self.steps())
    }
}

/// One phase: from `begin_s` on, `start` evolves under constant `jerk`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct JerkPhase {
    begin_s: f64,
    start: AxisState,
    jerk: f64,
}

/// Number of values in [`JerkProfile::numbers`].
pub(crate) const PROFILE_WORDS: usize = PHASES_MAX * 5 + 2;

/// A motion in at most [`PHASES_MAX`] phases of constant jerk.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct JerkProfile {
    phases: [JerkPhase; PHASES_MAX],
    duration_s: f64,
    end_position: f64,
}

impl JerkProfile {
    /// A motion from `start` through phases of (duration in s, jerk); after the last phase the axis is at rest.
    pub(crate) fn new<const N: usize>(start: AxisState, steps: [(f64, f64); N]) -> Self {
        const { assert!(N <= PHASES_MAX) };
        let mut profile = Self::default();
        let (mut begin_s, mut state) = (0.0, start);
        let mut steps = steps.into_iter();
        for phase in &mut profile.phases {
            let (length_s, jerk) = steps.next().unwrap_or((0.0, 0.0));
            *phase = JerkPhase {
                begin_s,
                start: state,
                jerk,
            };
            begin_s += length_s;
            state = state.after(length_s, jerk);
        }
        profile.duration_s = begin_s;
        profile.end_position = state.position;
        profile
    }

    /// The profile as numbers: five per phase, then duration and end position.
    pub(crate) fn numbers(&self) -> [f64; PROFILE_WORDS] {
        let mut numbers = [0.0; PROFILE_WORDS];
        let (groups, rest) = numbers.as_chunks_mut::<5>();
        for (group, phase) in groups.iter_mut().zip(&self.phases) {
            let AxisState {
                position,
                velocity,
                acceleration,
            } = phase.start;
            *group = [phase.begin_s, position, velocity, acceleration, phase.jerk];
        }
        if let [duration_s, end] = rest {
            (*duration_s, *end) = (self.duration_s, self.end_position);
        }
        numbers
    }

    /// Restores a profile from [`JerkProfile::numbers`].
    pub(crate) fn from_numbers(numbers: &[f64; PROFILE_WORDS]) -> Self {
        let mut profile = Self::default();
        let (groups, rest) = numbers.as_chunks::<5>();
        for (phase, group) in profile.phases.iter_mut().zip(groups) {
            let [begin_s, position, velocity, acceleration, jerk] = *group;
            let start = AxisState {
                position,
                velocity,
                acceleration,
            };
            *phase = JerkPhase {
                begin_s,
                start,
                jerk,
            };
        }
        if let [duration_s, end] = rest {
            (profile.duration_s, profile.end_position) = (*duration_s, *end);
        }
        profile
    }

    /// Duration of the motion, s.
    pub(crate) fn duration_s(&self) -> f64 {
        self.duration_s
    }

    /// Position at the end.
    pub(crate) fn end_position(&self) -> f64 {
        self.end_position
    }

    /// State at `t_s` ≥ 0 after the beginning; `None` after the end of the motion.
    pub(crate) fn at(&self, t_s: f64) -> Option<AxisState> {
        (t_s < self.duration_s).then(|| self.sample(t_s).0)
    }

    /// State and jerk at `t_s` after the beginning; outside of the motion the nearest phase is extrapolated.
    pub(crate) fn sample(&self, t_s: f64) -> (AxisState, f64) {
        let begun = |phase: &&JerkPhase| phase.begin_s <= t_s;
        let phase = self.phases.iter().rev().find(begun);
        let phase = phase.unwrap_or(&self.phases[0]);
        (
            phase.start.after(t_s - phase.begin_s, phase.jerk),
            phase.jerk,
        )
    }

    /// Time at which `position` is passed, s after the beginning, for a motion that never goes backwards. 0 if the
    /// position lies before the start, the duration if it is not reached.
    pub(crate) fn time_at(&self, position: f64) -> f64 {
        let passed = |phase: &&JerkPhase| phase.start.position <= position;
        let mut phases = self.phases.iter().rev().skip_while(|phase| !passed(phase));
        let Some(phase) = phases.next() else {
            return 0.0;
        };
        let after = self.phases.iter().find(|other| !passed(other));
        let end_s = after.map_or(self.duration_s, |next| next.begin_s);
        let (mut early, mut late) = (0.0, end_s - phase.begin_s);
        if phase.start.after(late, phase.jerk).position <= position {
            return end_s;
        }
        // Newton's method; bisects when a step leaves the bracket.
        let mut t_s = 0.5 * late;
        for _ in 0..SEARCH_MAX {
            let state = phase.start.after(t_s, phase.jerk);
            let miss = state.position - position;
            *(if miss > 0.0 { &mut late } else { &mut early }) = t_s;
            let next = t_s - miss / state.velocity;
            let next = if next > early && next < late {
                next
            } else {
                0.5 * (early + late)
            };
            if (next - t_s).abs() <= f64::EPSILON * end_s {
                return phase.begin_s + next;
            }
            t_s = next;
        }
        phase.begin_s + t_s
    }

    /// The segments of the motion between two times: start state, jerk and duration of each.
    #[cfg(test)]
    pub(crate) fn parts(
        &self,
        from_s: f64,
        to_s: f64,
    ) -> impl Iterator<Item = (AxisState, f64, f64)> {
        let ends = self.phases.iter().skip(1).map(|phase| phase.begin_s);
        let ends = ends.chain([self.duration_s]);
        let parts = self
            .phases
            .iter()
            .zip(ends)
            .filter_map(move |(phase, end_s)| {
                let (begin_s, end_s) = (phase.begin_s.max(from_s), end_s.min(to_s));
                let start = phase.start.after(begin_s - phase.begin_s, phase.jerk);
                (end_s > begin_s).then_some((start, phase.jerk, end_s - begin_s))
            });
        parts.collect::<Vec<_>>().into_iter()
    }

    /// The states at the beginning of each phase (unused phases repeat the end). The acceleration has its extrema
    /// there; the velocity has them there or where the acceleration is 0.
    pub(crate) fn corners(&self) -> impl Iterator<Item = AxisState> + '_ {
        self.phases.iter().map(|phase| phase.start)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn stop(velocity: f64, a: f64, acceleration: f64, jerk: f64) -> VelocityChange {
        VelocityChange::new(velocity, a, AccelerationLimits { acceleration, jerk })
    }

    fn rest(profile: &JerkProfile) -> AxisState {
        let last = profile.phases[2];
        last.start
            .after(profile.duration_s - last.begin_s, last.jerk)
    }

    #[test]
    fn a_stop_from_rest_takes_no_time() {
        assert_eq!(stop(0.0, 0.0, 1.0, 1.0).duration_s(), 0.0);
    }

    #[test]
    fn a_long_stop_holds_the_acceleration_limit() {
        // 2 m/s at 1 m/s² and 10 m/s³: v/A + A/J.
        let stop = stop(2.0, 0.0, 1.0, 10.0);
        assert!((stop.duration_s() - 2.1).abs() < 1e-12);
        let profile = stop.profile(AxisState {
            velocity: 2.0,
            ..AxisState::default()
        });
        // From a velocity without acceleration, the distance is half of velocity × time.
        assert!((profile.end_position() - 2.1).abs() < 1e-12);
    }

    #[test]
    fn null_gives_null() {
        assert!(stop(f64::NAN, 0.0, 1.0, 1.0).duration_s().is_nan());
        assert!(stop(0.0, f64::NAN, 1.0, 1.0).duration_s().is_nan());
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(5000))]

        #[test]
        fn a_stop_ends_at_rest_within_its_limits(
            v in -3.0..3.0f64, share in -1.0..1.0f64, limit in 0.1..20.0f64, jerk in 1.0..1000.0f64,
        ) {
            let (a, stop) = (share * limit, stop(v, share * limit, limit, jerk));
            prop_assert!(stop.durations_s.iter().all(|t| *t >= 0.0), "{stop:?}");
            let profile = stop.profile(AxisState { position: 1.0, velocity: v, acceleration: a });
            // Effect of rounding over a duration as long as the stop.
            let rounding = 4.0 * f64::EPSILON * (1.0 + stop.duration_s());
            prop_assert!(rest(&profile).velocity.abs() <= rounding * (v.abs() + limit + 1.0) * 4.0);
            prop_assert!(rest(&profile).acceleration.abs() <= rounding * (jerk + limit));
            prop_assert!(profile.corners().all(|c| c.acceleration.abs() <= limit * (1.0 + 1e-12)));
            // Never faster than at the beginning, except while an initial acceleration is reduced.
            let peak = v.abs().max((v + a * a.abs() / (2.0 * jerk)).abs()) + 1e-12;
            prop_assert!(profile.corners().all(|c| c.velocity.abs() <= peak));
        }

        #[test]
        fn a_harder_stop_is_never_slower(
            v in -3.0..3.0f64, a in -5.0..5.0f64, limit in 5.0..20.0f64, jerk in 1.0..1000.0f64, more in 1.0..3.0f64,
        ) {
            let slow = stop(v, a, limit, jerk).duration_s();
            prop_assert!(stop(v, a, limit * more, jerk * more).duration_s() <= slow * (1.0 + 1e-12));
        }
    }
}
