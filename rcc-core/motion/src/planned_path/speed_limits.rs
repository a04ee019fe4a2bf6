//! How fast a path may be gone along: from what the flange and the joints do by s to the limits of the clock.
//! Used when a motion is built.
//!
//! With s' ≤ V, |s''| ≤ A and |s'''| ≤ J, what follows s as y(s) obeys
//! |y'|V ≥ |velocity|, |y''|V² + |y'|A ≥ |acceleration| and |y'''|V³ + 3|y''|VA + |y'|J ≥ |jerk|.
//! So if the left sides keep the limits everywhere, every motion of the clock keeps them: with any override, pause and stop.
//! V is found for each part of the path; A and J are those of the whole path.
//!
//! Between samples: at each sample the greatest of its neighbours' and its own derivatives is taken, and a quarter of its
//! second difference and [`MARGIN`] of it are added, unless it is constant.

use rcc_core::path::Quantity;

use crate::path_clock::{PathBounds, PathPiece, duration_s, peak};

/// Line, turn and eight joints.
pub(crate) const QUANTITIES: usize = 10;

/// The quantity at a place of a [`DerivativeSample`].
fn quantity(number: usize) -> Quantity {
    match number {
        0 => Quantity::Line,
        1 => Quantity::Turn,
        joint => Quantity::Joint((joint - 2) as u8),
    }
}

/// Added to every derivative, as part of it.
pub(crate) const MARGIN: f64 = 0.005;

/// A given speed is refused if it leaves less than this part of the greatest acceleration along the path.
const LEAST_ACCELERATION: f64 = 1e-3;

/// What of the limits is for what.
pub(crate) struct LimitShares {
    /// Parts of the greatest acceleration that are tried: bends cost speed where the path's own acceleration is high.
    trials: &'static [f64],
    /// Of the jerk limit, at most so much is used by a bend that is passed at full speed …
    for_bends: f64,
    /// … and so much by changing the speed in a bend; the rest is for changing the acceleration.
    for_speed: f64,
    /// The clock does not rest at the end but passes it: behind the last part there is the way of a stop.
    run_out: bool,
}

/// Of a path whose clock makes all that is accelerated along it.
pub(crate) const EVEN_SHARES: LimitShares = LimitShares {
    trials: &[
        1.0, 0.98, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1, 0.04, 0.01,
    ],
    for_bends: 0.4,
    for_speed: 0.3,
    run_out: false,
};

/// Of a law that accelerates by itself with a part of the limits: its clock only changes the speed of it, and stops, with
/// what is left.
pub(crate) const TIME_LAW_SHARES: [(f64, LimitShares); 3] = [
    (0.55, time_law_shares(&[0.38])),
    (0.7, time_law_shares(&[0.25])),
    (0.82, time_law_shares(&[0.15])),
];

const fn time_law_shares(trials: &'static [f64]) -> LimitShares {
    LimitShares {
        trials,
        for_bends: 0.65,
        for_speed: 0.2,
        run_out: true,
    }
}

/// |y'|, |y''|, |y'''| of every quantity at one place.
pub(crate) type DerivativeSample = [[f64; 3]; QUANTITIES];

/// Velocity, acceleration and jerk of every quantity; infinite where there is no limit.
pub(crate) type QuantityLimits = [[f64; 3]; QUANTITIES];

/// Samples of a part of a path with what limits it.
#[derive(Debug, Clone)]
pub(crate) struct SampledPart {
    /// At even steps, ends included.
    pub(crate) samples: Vec<DerivativeSample>,
    /// What is kept.
    pub(crate) bounds: QuantityLimits,
    /// The speed limits of line and turn are what the net wants; if joints or curves cannot follow, it is refused.
    pub(crate) given: bool,
}

impl SampledPart {
    /// Each quantity of each sample with its limits.
    fn all(&self) -> impl Iterator<Item = (&[f64; 3], &[f64; 3])> {
        self.samples
            .iter()
            .flat_map(|sample| sample.iter().zip(&self.bounds))
    }
}

/// Where and why a path cannot be gone along as fast as given.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct TooFast {
    /// Part.
    pub(crate) part: usize,
    /// Sample in it, as part of its length.
    pub(crate) fraction: f64,
    /// What.
    pub(crate) quantity: Quantity,
    /// 1 velocity, 2 acceleration, 3 jerk.
    pub(crate) order: u8,
    /// What it would come to.
    pub(crate) value: f64,
    /// Its limit.
    pub(crate) limit: f64,
    /// The part of the given speed that is possible.
    pub(crate) possible: f64,
}

impl TooFast {
    /// Nothing is.
    const NONE: TooFast = TooFast {
        part: 0,
        fraction: 0.0,
        quantity: Quantity::Line,
        order: 1,
        value: 0.0,
        limit: f64::INFINITY,
        possible: 1.0,
    };
}

/// Why there are no limits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum LimitsFault {
    /// A given speed.
    TooFast(TooFast),
    /// What was found is nothing that a clock keeps.
    Clock,
}

/// Makes samples bounds of what lies between them.
pub(crate) fn widen(samples: &[DerivativeSample]) -> Vec<DerivativeSample> {
    let at = |number: usize| samples.get(number);
    let wide = |number: usize| {
        core::array::from_fn(|quantity| {
            core::array::from_fn(|order| {
                let value = |sample: &DerivativeSample| sample[quantity][order];
                let here = at(number).map_or(0.0, value);
                let before = number.checked_sub(1).and_then(at).map_or(here, value);
                let behind = at(number + 1).map_or(here, value);
                let bend = (before - 2.0 * here + behind).abs() / 4.0;
                let (greatest, least) =
                    (here.max(before).max(behind), here.min(before).min(behind));
                if greatest - least <= 1e-9 * greatest {
                    // Constant: what is given can be used fully.
                    return greatest;
                }
                (greatest + bend) * (1.0 + MARGIN)
            })
        })
    };
    (0..samples.len()).map(wide).collect()
}

/// The greatest speed at which the path may speed up by `acceleration`, with the shares of the jerk limit.
fn speed(part: &SampledPart, acceleration: f64, shares: &LimitShares) -> f64 {
    let mut lowest = f64::INFINITY;
    for ([first, second, third], [v, a, j]) in part.all() {
        let left = (a - first * acceleration).max(0.0);
        for limit in [
            v / first,
            libm::sqrt(left / second),
            libm::cbrt(shares.for_bends * j / third),
            shares.for_speed * j / (3.0 * second * acceleration),
        ] {
            lowest = least(lowest, limit);
        }
    }
    lowest
}

/// The speed along the path that is given, whatever joints and bends say to it.
fn given(part: &SampledPart) -> f64 {
    let rows = part
        .samples
        .iter()
        .flat_map(|sample| sample.iter().zip(&part.bounds).take(2));
    rows.map(|([first, ..], [v, ..])| v / first)
        .fold(f64::INFINITY, least)
}

/// The lesser, where a NaN (no limit times nothing) is no limit.
fn least(a: f64, b: f64) -> f64 {
    if b < a { b } else { a }
}

/// Limits of the clock for parts that end at `ends`: of all that are tried those with the shortest time from rest to rest.
///
/// # Errors
/// A part whose given speed is too fast for joints or bends.
pub(crate) fn allowed(
    parts: &[SampledPart],
    ends: &[f64],
    dt_s: f64,
    shares: &LimitShares,
) -> Result<PathBounds, LimitsFault> {
    let greatest = greatest(parts);
    let mut best: Option<(f64, PathBounds)> = None;
    let mut too_fast = false;
    for acceleration in shares.trials.iter().map(|trial| trial * greatest) {
        let velocities = parts.iter().map(|part| {
            let possible = speed(part, acceleration, shares);
            let kept = !part.given || possible >= given(part) * (1.0 - 1e-9);
            kept.then_some(possible)
        });
        let Some(velocities) = velocities.collect::<Option<Vec<_>>>() else {
            too_fast = true;
            continue;
        };
        let Some(bounds) = clock((parts, ends), &velocities, acceleration, dt_s, shares) else {
            continue;
        };
        let time = duration_s(&bounds);
        if best.as_ref().is_none_or(|(shortest, _)| time < *shortest) {
            best = Some((time, bounds));
        }
    }
    let bounds = match best {
        Some((_, bounds)) => bounds,
        None if too_fast => as_given((parts, ends), greatest, dt_s, shares)?,
        None => return Err(LimitsFault::Clock),
    };
    Ok(sooner((parts, ends), &bounds, shares).unwrap_or(bounds))
}

/// Lower speeds that are tried where a given one is not reached, each this part of the one before.
const LOWER: f64 = 0.85;
const LOWER_MAX: usize = 16;

/// A way that is too short for its given speed is not gone slower because of it: limits that leave no room for a speed that
/// is not reached, if they bring it to its end sooner.
fn sooner(
    (parts, ends): (&[SampledPart], &[f64]),
    bounds: &PathBounds,
    shares: &LimitShares,
) -> Option<PathBounds> {
    let [part] = parts else { return None };
    let top = peak(bounds);
    let wanted = given(part);
    if !part.given || top >= wanted * (1.0 - 1e-6) {
        return None;
    }
    let lower = |times: f64| {
        let mut part = part.clone();
        part.given = false;
        for [velocity, ..] in part.bounds.iter_mut().take(2) {
            *velocity *= times;
        }
        part
    };
    let times = core::iter::successors(Some(1.0), |times| Some(times * LOWER));
    let times = times
        .take(LOWER_MAX)
        .take_while(|times| times * wanted > 0.5 * top);
    let tried = times.filter_map(|times| {
        let bounds = allowed(&[lower(times)], ends, bounds.dt_s(), shares).ok()?;
        Some((duration_s(&bounds), bounds))
    });
    let (time, free) = tried.min_by(|(a, _), (b, _)| a.total_cmp(b))?;
    (time < duration_s(bounds)).then_some(free)
}

/// Limits for given speeds that do not go with the shares of the jerk limit: bends take what they need, and half of what they
/// leave is for changing the speed in them.
fn as_given(
    (parts, ends): (&[SampledPart], &[f64]),
    greatest: f64,
    dt_s: f64,
    shares: &LimitShares,
) -> Result<PathBounds, LimitsFault> {
    let enough = |margin: &SpeedMargin| margin.acceleration >= LEAST_ACCELERATION * greatest;
    let margin = SpeedMargin::at(parts, 1.0);
    if enough(&margin) {
        let acceleration = least(greatest, margin.acceleration);
        let velocities = parts.iter().map(|part| match part.given {
            true => given(part),
            false => speed(part, acceleration, shares),
        });
        let velocities: Vec<f64> = velocities.collect();
        let bounds = clock((parts, ends), &velocities, acceleration, dt_s, shares);
        return bounds.ok_or(LimitsFault::Clock);
    }
    let (mut possible, mut refused) = (0.0, 1.0);
    for _ in 0..40 {
        let between = 0.5 * (possible + refused);
        match enough(&SpeedMargin::at(parts, between)) {
            true => possible = between,
            false => refused = between,
        }
    }
    Err(LimitsFault::TooFast(TooFast {
        possible,
        ..margin.fault
    }))
}

/// What a clock keeps that stops on a part of the path and a few behind it: near by more is allowed than on the whole path.
#[derive(Debug, Clone)]
pub(crate) struct BrakingLimits {
    /// The part in which it begins.
    from: f64,
    until: f64,
    /// Of that part and those behind it; their length is how far a stop may go.
    pub(crate) bounds: PathBounds,
}

impl BrakingLimits {
    /// It is for who is there.
    pub(crate) fn begins_at(&self, s: f64) -> bool {
        self.from <= s && s <= self.until
    }
}

/// On how many parts a stop may take place; more would cost building time and memory, and stops that long are few.
const STOP_PARTS: [usize; 2] = [2, 8];

/// Of the greatest acceleration on them: who may brake harder must be slower where the path bends.
const STOP_ACCELERATIONS: [f64; 3] = [0.9, 0.6, 0.3];

/// Limits for stops in each part, those first that are soonest at rest; the last are `even`, those of the whole path.
pub(crate) fn stops(parts: &[SampledPart], ends: &[f64], even: PathBounds) -> Box<[BrakingLimits]> {
    let dt_s = even.dt_s();
    let begins = core::iter::once(0.0).chain(ends.iter().copied());
    let mut stops = Vec::new();
    for ((first, from), until) in begins.enumerate().zip(ends) {
        for reach in STOP_PARTS {
            let last = first.saturating_add(reach).min(parts.len());
            let (Some(near), Some(ends)) = (parts.get(first..last), ends.get(first..last)) else {
                continue;
            };
            let greatest = greatest(near);
            for acceleration in STOP_ACCELERATIONS.map(|trial| trial * greatest) {
                let velocities: Vec<f64> = (near.iter())
                    .map(|part| speed(part, acceleration, &EVEN_SHARES))
                    .collect();
                let bounds = clock((near, ends), &velocities, acceleration, dt_s, &EVEN_SHARES);
                stops.extend(bounds.map(|bounds| BrakingLimits {
                    from,
                    until: *until,
                    bounds,
                }));
            }
        }
    }
    stops.push(BrakingLimits {
        from: 0.0,
        until: even.length(),
        bounds: even,
    });
    stops.into()
}

/// The greatest acceleration along these parts that no quantity forbids at rest.
fn greatest(parts: &[SampledPart]) -> f64 {
    let rows = parts.iter().flat_map(SampledPart::all);
    rows.map(|([first, ..], [_, a, _])| a / first)
        .fold(f64::INFINITY, least)
}

/// What given speeds leave.
struct SpeedMargin {
    /// The greatest acceleration along the path; negative: they are too fast.
    acceleration: f64,
    /// What leaves least.
    fault: TooFast,
}

impl SpeedMargin {
    /// Of so many times the speeds that are given.
    fn at(parts: &[SampledPart], times: f64) -> SpeedMargin {
        let mut least = SpeedMargin {
            acceleration: f64::INFINITY,
            fault: TooFast::NONE,
        };
        for (number, part) in parts.iter().enumerate().filter(|(_, part)| part.given) {
            let speed = times * given(part);
            for (at, sample) in part.samples.iter().enumerate() {
                for (index, (derivatives, limits)) in sample.iter().zip(&part.bounds).enumerate() {
                    let values = powers(derivatives, speed);
                    for (order, acceleration) in (1u8..).zip(margin(derivatives, limits, speed)) {
                        if acceleration < least.acceleration {
                            let place = usize::from(order) - 1;
                            let fault = TooFast {
                                part: number,
                                fraction: at as f64 / (part.samples.len().max(2) - 1) as f64,
                                quantity: quantity(index),
                                order,
                                value: values[place],
                                limit: limits[place],
                                possible: 0.0,
                            };
                            least = SpeedMargin {
                                acceleration,
                                fault,
                            };
                        }
                    }
                }
            }
        }
        least
    }
}

/// What velocity, acceleration and jerk come to at an even speed.
fn powers([first, second, third]: &[f64; 3], speed: f64) -> [f64; 3] {
    [
        first * speed,
        second * speed * speed,
        third * speed * speed * speed,
    ]
}

/// The accelerations along the path that velocity, acceleration and jerk of a quantity leave; -∞ for none.
fn margin(derivatives: &[f64; 3], limits: &[f64; 3], speed: f64) -> [f64; 3] {
    let [first, second, _] = derivatives;
    let [velocity, acceleration, jerk] = powers(derivatives, speed);
    let [v, a, j] = limits;
    let within = velocity <= v * (1.0 + 1e-9);
    [
        if within {
            f64::INFINITY
        } else {
            f64::NEG_INFINITY
        },
        (a - acceleration) / first,
        0.5 * (j - jerk) / (3.0 * second * speed),
    ]
}

/// The clock with these velocities and one acceleration, and the jerk that all of them leave.
fn clock(
    (parts, ends): (&[SampledPart], &[f64]),
    velocities: &[f64],
    acceleration: f64,
    dt_s: f64,
    shares: &LimitShares,
) -> Option<PathBounds> {
    let (mut pieces, mut jerk) = (Vec::new(), f64::INFINITY);
    for ((part, end), v) in parts.iter().zip(ends).zip(velocities) {
        for ([first, second, third], [_, _, j]) in part.all() {
            let rest = j - third * v * v * v - 3.0 * second * v * acceleration;
            jerk = least(jerk, rest / first);
        }
        pieces.push(PathPiece {
            end_s: *end,
            velocity: *v,
        });
    }
    if let Some(last) = pieces.last_mut().filter(|_| shares.run_out) {
        // The longest way of a stop, and a cycle more.
        let v = last.velocity;
        let build_up = (acceleration / jerk).max(libm::sqrt(v / jerk));
        last.end_s += v * (v / (2.0 * acceleration) + 1.5 * build_up + 2.0 * dt_s);
    }
    PathBounds::new(&pieces, acceleration, jerk, dt_s).ok()
}
