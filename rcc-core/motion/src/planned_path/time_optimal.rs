//! Time laws with which a path is travelled soonest, or nearly so, from rest to rest, under limits of velocity,
//! acceleration and jerk. Used when a motion is built; allocates.
//!
//! A profile without jerk limits ([`topp_ra`]), smoothed over a window, is the first law. An interior-point method
//! ([`barrier`]) improves it, with the reserve of `stops: keep`; for `stops: give` it improves the result further with the
//! smaller reserve. For the adapted law, which is to be found quickly, it ends after few steps.
//! Both work with samples of the path. The result is then sampled closely and made slower as a whole until it keeps every
//! limit with a margin, so keeping the limits does not depend on the method.

use core::ops::Range;

use rcc_core::path::{SpeedOverride, StopReserve};

use super::TimeScaling;
use super::sampled_path::SampledPath;
use super::speed_limits::BrakingLimits;
use super::time_law::{TimeLaw, TimeLawKnot};
use crate::path_clock::{PathBounds, PathClock, PathPiece, duration_s};
use barrier::Barrier;
use close_samples::each_bound;
use law_spline::{LawSpline, basis};
use limited_values::ClockReserve;
use section_table::SectionTable;
use topp_ra::{AccelerationProfile, constraints};

mod banded;
mod barrier;
mod close_samples;
mod law_spline;
mod law_stops;
mod limited_values;
mod local_model;
mod section_table;
mod topp_ra;

/// Windows over which the first law is smoothed, in units of the shortest time in which an acceleration builds up.
const WINDOWS: [f64; 3] = [1.0, 2.0, 4.0];

/// Intervals of the spline in the shortest time in which an acceleration builds up, and their least and greatest number.
const INTERVALS: f64 = 8.0;
const INTERVALS_MIN: f64 = 32.0;
const INTERVALS_MAX: f64 = 480.0;

/// Most times that the first law is stretched where it is too fast.
const EVENED: usize = 8;

/// The first spline has this fraction of the intervals.
const COARSE: usize = 2;

/// The reserve of a law for its clock.
struct LawReserve {
    /// Fraction of the limits of acceleration and jerk that is reserved where the first law is fastest.
    fraction: f64,
    /// Most cycles for which a stop follows the law further to a state from which a shorter stop was checked.
    wait_cycles: f64,
}

impl LawReserve {
    fn of(stops: StopReserve) -> Self {
        let (fraction, wait_cycles) = match stops {
            StopReserve::Keep => (0.15, 10.0),
            // Slowing the clock down with so little takes longer than waiting.
            StopReserve::Give => (0.02, f64::INFINITY),
        };
        Self {
            fraction,
            wait_cycles,
        }
    }
}

/// Fraction by which a law is slower than its limits allow, because of rounding.
const ROUNDING: f64 = 1e-6;

/// A law is searched if an estimate promises less than this fraction of the time of the even motion: the search takes longer
/// than everything else that is planned.
const PROMISING: f64 = 0.8;
/// A law that was found is used if it takes less than this fraction of the time of the even motion.
const WORTHWHILE: f64 = 0.95;

/// A law that is found quickly: what is reserved, so that a pause or an override takes effect soon. With 15 % it would end
/// 2 to 10 % sooner, but take half as long again to pause.
const ADAPTED: LawReserve = LawReserve {
    fraction: 0.3,
    wait_cycles: 10.0,
};

/// A time law with the limits of its clock.
pub(super) struct SectionLaw {
    pub(super) time_law: TimeLaw,
    pub(super) bounds: PathBounds,
    /// Limits for stops at certain times of the law.
    pub(super) on_law: Box<[BrakingLimits]>,
    /// Most cycles for which the law is followed further to one of them.
    pub(super) wait_cycles: f64,
    pub(super) time_scaling: TimeScaling,
}

/// The time law with the shortest duration, which leaves a reserve for its clock; `None` if it is not faster than the even
/// motion with the bounds `uniform`.
pub(super) fn time_optimal_law(
    path: &SampledPath<'_>,
    range: Range<usize>,
    uniform: &PathBounds,
    stops: StopReserve,
) -> Option<SectionLaw> {
    let [kept, own] = [StopReserve::Keep, stops].map(LawReserve::of);
    let (table, profile) = table_and_profile(path, range.clone())?;
    let first = first_law(&table, &profile, EvenLaw::new(uniform).as_ref())?;
    let keep = reserve(path, range.clone(), &time_law(&first, 1.0)?, kept.fraction);
    let intervals = COARSE * first.law.intervals();
    let mut barrier = Barrier::new(&table, keep, first.law.clone())?;
    let improved = barrier.improve(intervals).is_some();
    if !improved {
        // The first law keeps the limits, too.
        barrier = Barrier::new(&table, keep, first.law)?;
    }
    let reserve = keep.times(own.fraction / kept.fraction);
    let soonest = |barrier: &Barrier<'_>| soonest((path, range.clone()), barrier, reserve);
    let mut law = soonest(&barrier)?;
    // There are several local optima: a separate search with a lesser reserve may end in a worse one. The law with the
    // greatest reserve is within every lesser one, so what begins with it never takes longer.
    if own.fraction < kept.fraction
        && let Some(relaxed) = barrier.relaxed(reserve).as_ref().and_then(soonest)
        && relaxed.0.duration() < law.0.duration()
    {
        law = relaxed;
    }
    let time_scaling = match improved {
        true => TimeScaling::TimeOptimal,
        false => TimeScaling::FirstLaw,
    };
    if law.0.duration() >= duration_s(uniform) {
        return None;
    }
    section_law((path, range), law, own.wait_cycles, time_scaling)
}

/// Compares the even motion with the bounds `uniform` with a time law that is found quickly and is nearly the soonest:
/// returns it if it is sooner by [`WORTHWHILE`].
pub(super) fn adapted_law(
    path: &SampledPath<'_>,
    range: Range<usize>,
    uniform: &PathBounds,
) -> Option<SectionLaw> {
    let (table, profile) = table_and_profile(path, range.clone())?;
    let even_s = duration_s(uniform);
    // An acceleration builds up at least once.
    if profile.duration_s() + table.ramp_s() >= PROMISING * even_s {
        return None;
    }
    let first = first_law(&table, &profile, EvenLaw::new(uniform).as_ref())?;
    let reserve = reserve(
        path,
        range.clone(),
        &time_law(&first, 1.0)?,
        ADAPTED.fraction,
    );
    let mut barrier = Barrier::new(&table, reserve, first.law)?;
    barrier.improve_quickly();
    let law = soonest((path, range.clone()), &barrier, reserve)?;
    if law.0.duration() >= WORTHWHILE * even_s {
        return None;
    }
    let wait_cycles = ADAPTED.wait_cycles;
    section_law((path, range), law, wait_cycles, TimeScaling::Adapted)
}

/// A duration with which the path can be travelled within its limits, with nothing reserved, if it is below `below_s`, s: not
/// the shortest one, but found quickly.
pub(super) fn possible_duration_s(
    path: &SampledPath<'_>,
    range: Range<usize>,
    below_s: f64,
) -> Option<f64> {
    let (table, profile) = table_and_profile(path, range)?;
    if profile.duration_s() >= below_s {
        return None;
    }
    let possible_s = first_law(&table, &profile, None)?.duration_s();
    (possible_s < below_s).then_some(possible_s)
}

/// What every law of a section begins with: its derivatives, and its profile without jerk limits.
fn table_and_profile<'a>(
    path: &'a SampledPath<'_>,
    range: Range<usize>,
) -> Option<(SectionTable<'a>, AccelerationProfile)> {
    let table = SectionTable::new(path, range.clone())?;
    Some((table, AccelerationProfile::new(&constraints(path, range))?))
}

/// A law and the limits of its clock.
type LawAndClock = (TimeLaw, ClockReserve);

/// The law as fast as its limits and the reserve for its clock allow.
fn soonest(
    (path, range): (&SampledPath<'_>, Range<usize>),
    barrier: &Barrier<'_>,
    reserve: ClockReserve,
) -> Option<LawAndClock> {
    let speed = speed(path, range, &time_law(barrier, 1.0)?, reserve);
    Some((time_law(barrier, speed)?, reserve.at_speed(speed)))
}

/// The law with the limits of its clock and with those for stops.
fn section_law(
    (path, range): (&SampledPath<'_>, Range<usize>),
    (time_law, clock): LawAndClock,
    wait_cycles: f64,
    time_scaling: TimeScaling,
) -> Option<SectionLaw> {
    Some(SectionLaw {
        bounds: clock_bounds(time_law.duration(), clock, path.dt_s)?,
        on_law: law_stops::law_stops(path, range, &time_law),
        wait_cycles,
        time_law,
        time_scaling,
    })
}

/// The soonest of the smoothed profiles without jerk limits and the even motion.
fn first_law<'a>(
    table: &'a SectionTable<'a>,
    profile: &AccelerationProfile,
    even: Option<&EvenLaw>,
) -> Option<Barrier<'a>> {
    let ramp_s = table.ramp_s().min(profile.duration_s());
    let intervals = (INTERVALS * profile.duration_s() / ramp_s).ceil();
    let intervals = intervals.clamp(INTERVALS_MIN, INTERVALS_MAX) as usize / COARSE;
    let smoothed = WINDOWS.iter().map(|window| {
        let window_s = (window * ramp_s).min(profile.duration_s());
        LawSpline::near(intervals, |u| profile.averaged(window_s, u))
    });
    let [begin, _] = table.ends();
    let even = even.map(|even| LawSpline::near(intervals, |u| begin + even.at(u)));
    let laws = smoothed.chain(even);
    let begun = laws.filter_map(|law| Barrier::new(table, ClockReserve::default(), law));
    let sooner = |a: &Barrier<'_>, b: &Barrier<'_>| a.duration_s().total_cmp(&b.duration_s());
    let mut best = begun.min_by(sooner)?;
    for _ in 0..EVENED {
        match best.evened() {
            Some(evened) if evened.duration_s() < best.duration_s() => best = evened,
            _ => break,
        }
    }
    Some(best)
}

/// The even motion: the path parameter in every cycle.
struct EvenLaw(Vec<f64>);

impl EvenLaw {
    /// `None` for a motion that takes very long.
    fn new(bounds: &PathBounds) -> Option<Self> {
        const CYCLES_MAX: usize = 100_000;
        let mut clock = PathClock::new();
        let mut positions = Vec::new();
        while positions.len() < CYCLES_MAX {
            let state = clock.step(bounds, SpeedOverride::RUN);
            positions.push(state.s);
            if state.done {
                return Some(Self(positions));
            }
        }
        None
    }

    /// Path parameter at the fraction `u` of the duration.
    fn at(&self, u: f64) -> f64 {
        let last = self.0.len().saturating_sub(1);
        let place = u.clamp(0.0, 1.0) * last as f64;
        let number = (place as usize).min(last);
        let [here, behind] = [number, (number + 1).min(last)].map(|number| self.0[number]);
        here + (behind - here) * (place - number as f64)
    }
}

/// The law as a function of time, at `speed` times its speed.
fn time_law(barrier: &Barrier<'_>, speed: f64) -> Option<TimeLaw> {
    let law = &barrier.law;
    let intervals = law.intervals();
    let duration_s = barrier.duration_s() / speed;
    let (begin, end) = (
        basis(0.0, 1.0 / intervals as f64),
        basis(1.0, 1.0 / intervals as f64),
    );
    let knot = |number: usize| -> TimeLawKnot {
        let [s, v, a, _] = match number.checked_sub(1) {
            None => law.at(0, &begin),
            Some(before) => law.at(before, &end),
        };
        [s, v / duration_s, a / (duration_s * duration_s)]
    };
    let mut knots: Vec<TimeLawKnot> = (0..=intervals).map(knot).collect();
    // Exactly at rest at both ends.
    *knots.first_mut()? = [*law.coefficients.first()?, 0.0, 0.0];
    *knots.last_mut()? = [*law.coefficients.last()?, 0.0, 0.0];
    TimeLaw::new(&knots, duration_s / intervals as f64)
}

/// Clock limits that use this fraction of the limits where a quantity is fastest on this law.
fn reserve(
    path: &SampledPath<'_>,
    range: Range<usize>,
    law: &TimeLaw,
    fraction: f64,
) -> ClockReserve {
    let mut reserve = ClockReserve {
        acceleration: f64::INFINITY,
        jerk: f64::INFINITY,
    };
    let nothing = ClockReserve::default();
    each_bound(path, range, (law, nothing), |[velocity, ..], limits| {
        let [acceleration, jerk] = [1, 2].map(|order| fraction * limits[order] / velocity);
        reserve.acceleration = least(reserve.acceleration, acceleration);
        reserve.jerk = least(reserve.jerk, jerk);
    });
    reserve
}

/// The greatest speed, relative to that of the law, at which all limits are kept, including what the clock may use.
fn speed(path: &SampledPath<'_>, range: Range<usize>, law: &TimeLaw, reserve: ClockReserve) -> f64 {
    let mut speed = f64::INFINITY;
    each_bound(
        path,
        range,
        (law, reserve),
        |[first, second, third], [v, a, j]| {
            for possible in [v / first, libm::sqrt(a / second), libm::cbrt(j / third)] {
                speed = least(speed, possible);
            }
        },
    );
    speed * (1.0 - ROUNDING)
}

/// The lesser of two values; a NaN counts as no limit.
fn least(a: f64, b: f64) -> f64 {
    if b < a { b } else { a }
}

/// Limits of a clock that runs at speed 1 from the beginning to the end of a law and may slow down and stop within the
/// reserve.
fn clock_bounds(duration_s: f64, reserve: ClockReserve, dt_s: f64) -> Option<PathBounds> {
    let ClockReserve { acceleration, jerk } = reserve;
    // The clock does not stop at the end but passes it: the longest distance of a stop, and two cycles.
    let build_up = (acceleration / jerk).max(libm::sqrt(1.0 / jerk));
    let stop = 0.5 / acceleration + 1.5 * build_up + 2.0 * dt_s;
    let piece = PathPiece {
        end_s: duration_s + stop,
        velocity: 1.0,
    };
    PathBounds::new(&[piece], acceleration, jerk, dt_s).ok()
}
