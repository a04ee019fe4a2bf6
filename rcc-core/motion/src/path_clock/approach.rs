//! The fastest jerk-limited motion from any state to a velocity at a given distance, in closed form except for one
//! scalar that is searched. No allocation, no failure; run by the real-time thread when a path clock replans.

use rcc_core::axis::AxisState;

use crate::jerk_profile::{AccelerationLimits, JerkProfile, VelocityChange};

/// Iteration limit of the search. Every third iteration bisects; the others converge faster.
const SEARCH_MAX: usize = 120;

/// The search ends when this fraction of the distance is left, which cruising fills.
const FILLED: f64 = 1e-13;

/// The goal of a motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ApproachTarget {
    /// Distance to go in s (≥ 0).
    pub(super) distance: f64,
    /// Greatest cruising velocity (> 0).
    pub(super) cruise: f64,
    /// Velocity at the end, with zero acceleration; limited to `cruise`.
    pub(super) exit: f64,
    /// A miss of the distance by at most this much is accepted.
    pub(super) slack: f64,
}

/// A change of velocity, a cruise, and a change to the velocity at the end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Approach {
    first: VelocityChange,
    cruise_s: f64,
    second: VelocityChange,
    /// Velocity between the changes.
    pub(super) between: f64,
    /// Velocity at the end: that of the target, or less if the distance is too short for it.
    pub(super) exit: f64,
    /// Distance covered without the cruise.
    distance: f64,
}

impl Approach {
    /// From `start` to the velocity `between` and from there to `exit`, without a cruise.
    fn through(start: AxisState, between: f64, exit: f64, limits: AccelerationLimits) -> Self {
        let first = VelocityChange::new(start.velocity - between, start.acceleration, limits);
        let reached = first.end(AxisState {
            position: 0.0,
            ..start
        });
        let second = VelocityChange::new(between - exit, 0.0, limits);
        let distance = second.end(AxisState {
            position: reached.position,
            velocity: between,
            acceleration: 0.0,
        });
        Self {
            first,
            cruise_s: 0.0,
            second,
            between,
            exit,
            distance: distance.position,
        }
    }

    /// For a start that brakes: first reduces the deceleration to `acceleration`, then continues braking to `exit`.
    fn relaxing(
        start: AxisState,
        acceleration: f64,
        exit: f64,
        limits: AccelerationLimits,
    ) -> Self {
        let jerk = limits.jerk;
        let first = VelocityChange::relaxing((acceleration - start.acceleration) / jerk, jerk);
        let relaxed = first.end(AxisState {
            position: 0.0,
            ..start
        });
        let second = VelocityChange::new(relaxed.velocity - exit, relaxed.acceleration, limits);
        Self {
            first,
            cruise_s: 0.0,
            second,
            between: relaxed.velocity,
            exit,
            distance: second.end(relaxed).position,
        }
    }

    /// Adds a cruise such that the distance becomes that of the target.
    fn with_cruise(mut self, target: &ApproachTarget) -> Option<Self> {
        let left = target.distance - self.distance;
        if left > target.slack {
            self.cruise_s = left / self.between;
        }
        self.cruise_s.is_finite().then_some(self)
    }

    /// Time at which the second change begins, s.
    pub(super) fn braking_from_s(&self) -> f64 {
        self.first.duration_s() + self.cruise_s
    }

    /// The motion from `start` as a profile.
    pub(super) fn profile(&self, start: AxisState) -> JerkProfile {
        let ([a, b, c], [d, e, f]) = (self.first.steps(), self.second.steps());
        JerkProfile::new(start, [a, b, c, (self.cruise_s, 0.0), d, e, f])
    }
}

/// The fastest motion from `start` to the target. The velocity of `start` is ≥ 0 and stays so while its acceleration is
/// reduced to 0.
///
/// `None` if the distance is too short: the end cannot be reached with zero acceleration at the target's velocity, or
/// at a lower one that needs no braking.
pub(super) fn approach(
    start: AxisState,
    target: &ApproachTarget,
    limits: AccelerationLimits,
) -> Option<Approach> {
    let (cruise, exit) = (target.cruise, target.exit.min(target.cruise));
    let through = |between: f64, exit: f64| Approach::through(start, between, exit, limits);
    let near = |found: Approach| found.distance <= target.distance + target.slack;
    let free = through(cruise, exit);
    if free.distance <= target.distance {
        return free.with_cruise(target);
    }
    let coasting_velocity = start.coasting(limits.jerk).max(0.0);
    let between = |slow: f64, fast: f64| {
        let found = search(slow, fast, target, |between| {
            through(between, exit).distance
        });
        through(found, exit).with_cruise(target)
    };
    if coasting_velocity >= cruise {
        let direct = through(exit, exit);
        return if direct.distance < target.distance - target.slack {
            between(exit, cruise)
        } else {
            Some(direct).filter(|direct| near(*direct))
        };
    }
    if coasting_velocity < exit {
        if through(exit, exit).distance <= target.distance {
            return between(exit, nearest_fast(exit, cruise, target, limits));
        }
        let fast = nearest_fast(coasting_velocity, exit, target, limits);
        let found = search(coasting_velocity, fast, target, |slower| {
            through(slower, slower).distance
        });
        let slower = through(found, found);
        return Some(slower).filter(|s| near(*s))?.with_cruise(target);
    }
    let relaxed = through(coasting_velocity, exit);
    if relaxed.distance <= target.distance {
        return between(
            coasting_velocity,
            nearest_fast(coasting_velocity, cruise, target, limits),
        );
    }
    if start.acceleration >= 0.0 {
        return Some(relaxed).filter(|relaxed| near(*relaxed));
    }
    let direct = through(exit, exit);
    if direct.distance >= target.distance - target.slack {
        return Some(direct).filter(|direct| near(*direct));
    }
    let relaxing = |a: f64| Approach::relaxing(start, a, exit, limits);
    let found = search(start.acceleration, 0.0, target, |a| relaxing(a).distance);
    Some(relaxing(found))
}

/// A velocity up to `fast` that is certainly not reached from `slow` within the distance, or `fast`.
fn nearest_fast(slow: f64, fast: f64, target: &ApproachTarget, limits: AccelerationLimits) -> f64 {
    // From a velocity without acceleration, gaining d takes a distance of at least d·√(d/J).
    let more = libm::cbrt(target.distance * target.distance * limits.jerk);
    (slow + 4.0 * more).min(fast)
}

/// The value between `low` (distance not too long) and `high` (distance too long) at which the distance is that of the
/// target: within the slack, and not longer.
fn search(low: f64, high: f64, target: &ApproachTarget, distance: impl Fn(f64) -> f64) -> f64 {
    let enough = target.slack.min(FILLED * target.distance);
    // Aim at the middle of the accepted interval.
    let miss = |x: f64| distance(x) - target.distance + 0.5 * enough;
    let (mut low, mut high) = (low, high);
    let (mut below, mut above) = (miss(low), miss(high));
    if above <= 0.5 * enough {
        return high;
    }
    // Regula falsi; the end that is kept twice loses weight (Illinois variant).
    let mut last = 0.0;
    for step in 0..SEARCH_MAX {
        let middle = 0.5 * (low + high);
        let line = low + (high - low) * (below / (below - above));
        let x = if step % 3 == 2 || !(line > low && line < high) {
            middle
        } else {
            line
        };
        if !(x > low && x < high) {
            break;
        }
        let missed = miss(x);
        if missed > 0.5 * enough {
            if last > 0.0 {
                below *= 0.5;
            }
            (high, above) = (x, missed);
        } else {
            if last < 0.0 {
                above *= 0.5;
            }
            (low, below) = (x, missed);
            if missed >= -0.5 * enough {
                break;
            }
        }
        last = missed;
    }
    low
}
