//! Speed limits along a path: from the derivatives of flange and joints by s to the limits of the path clock. Used when
//! a motion is built.
//!
//! With s' ≤ V, |s''| ≤ A and |s'''| ≤ J, a quantity y(s) obeys |velocity| ≤ |y'|V, |acceleration| ≤ |y''|V² + |y'|A
//! and |jerk| ≤ |y'''|V³ + 3|y''|VA + |y'|J. So if the right sides keep the limits everywhere, every motion of the
//! clock keeps them, with any override, pause and stop. V is determined for each part of the path; A and J hold for the
//! whole path.
//!
//! Between samples: at each sample the greatest derivative of the sample and its neighbours is taken, and a quarter of
//! the second difference and the fraction [`MARGIN`] are added, unless the derivative is constant.

use rcc_core::axis::AxisState;
use rcc_core::path::Quantity;

use crate::path_clock::{PathBounds, PathPiece, duration_s, peak};

/// Translation, rotation and eight joints.
pub(crate) const QUANTITIES: usize = 10;

/// The quantity at an index of a [`DerivativeSample`].
pub(super) fn quantity(number: usize) -> Quantity {
    match number {
        0 => Quantity::Line,
        1 => Quantity::Turn,
        joint => Quantity::Joint((joint - 2) as u8),
    }
}

/// Fraction that is added to every derivative.
pub(crate) const MARGIN: f64 = 0.005;

/// A given speed is refused if it leaves less than this fraction of the greatest acceleration along the path.
const LEAST_ACCELERATION: f64 = 1e-3;

/// Fractions of the greatest acceleration that are tried: a high acceleration along the path costs speed in bends.
const TRIALS: [f64; 13] = [
    1.0, 0.98, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1, 0.04, 0.01,
];

/// Fraction of the jerk limit for a bend that is passed at full speed.
const BEND_JERK: f64 = 0.4;

/// Fraction of the jerk limit for changing the speed in a bend; the rest is for changing the acceleration.
const SPEED_JERK: f64 = 0.3;

/// |y'|, |y''|, |y'''| of every quantity at one path position.
pub(crate) type DerivativeSample = [[f64; 3]; QUANTITIES];

/// Velocity, acceleration and jerk limit of every quantity; infinite if there is no limit.
pub(crate) type QuantityLimits = [[f64; 3]; QUANTITIES];

/// Samples of a part of a path, with its limits.
#[derive(Debug, Clone)]
pub(crate) struct SampledPart {
    /// Samples at equidistant steps, ends included.
    pub(crate) samples: Vec<DerivativeSample>,
    /// Limits of each quantity.
    pub(crate) bounds: QuantityLimits,
    /// The velocities of translation and rotation are to be kept; if joints or bends do not allow them, the motion is
    /// refused.
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

/// Where and why a path cannot be followed at the given speed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct TooFast {
    /// Index of the part.
    pub(crate) part: usize,
    /// Position of the sample, as a fraction of the part.
    pub(crate) fraction: f64,
    /// The quantity whose limit is violated.
    pub(crate) quantity: Quantity,
    /// 1 velocity, 2 acceleration, 3 jerk.
    pub(crate) order: u8,
    /// Value that it would reach.
    pub(crate) value: f64,
    /// Its limit.
    pub(crate) limit: f64,
    /// Fraction of the given speed that is possible.
    pub(crate) possible: f64,
}

impl TooFast {
    /// No violation.
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

/// Why limits cannot be determined.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum LimitsFault {
    /// A given speed is too high.
    TooFast(TooFast),
    /// The limits found are not valid for a path clock.
    Clock,
}

/// Turns samples into bounds that also hold between them.
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
                    // Constant: the limit can be used fully.
                    return greatest;
                }
                (greatest + bend) * (1.0 + MARGIN)
            })
        })
    };
    (0..samples.len()).map(wide).collect()
}

/// The greatest speeds on a part of a path, by the acceleration along it.
struct SpeedsOfPart<'a> {
    part: &'a SampledPart,
    /// The greatest speed within the limits that do not depend on that acceleration: velocity, and jerk in bends.
    highest: f64,
}

impl<'a> SpeedsOfPart<'a> {
    fn new(part: &'a SampledPart) -> Self {
        let mut highest = f64::INFINITY;
        for ([first, _, third], [v, _, j]) in part.all() {
            highest = least(highest, v / first);
            highest = least(highest, libm::cbrt(BEND_JERK * j / third));
        }
        Self { part, highest }
    }

    /// The greatest speed at which the path may accelerate by `acceleration`, with the shares of the jerk limit.
    fn at(&self, acceleration: f64) -> f64 {
        let (mut square, mut lowest) = (f64::INFINITY, self.highest);
        for ([first, second, _], [_, a, j]) in self.part.all() {
            let left = (a - first * acceleration).max(0.0);
            square = least(square, left / second);
            lowest = least(lowest, SPEED_JERK * j / (3.0 * second * acceleration));
        }
        least(lowest, libm::sqrt(square))
    }
}

/// The given speed along the path, regardless of joints and bends.
fn given_speed(part: &SampledPart) -> f64 {
    let rows = part
        .samples
        .iter()
        .flat_map(|sample| sample.iter().zip(&part.bounds).take(2));
    rows.map(|([first, ..], [v, ..])| v / first)
        .fold(f64::INFINITY, least)
}

/// The time that parts with a given speed take at that speed, s; the parts end at `ends`.
pub(super) fn at_given_speed_s(parts: &[SampledPart], ends: &[f64]) -> f64 {
    let begins = core::iter::once(&0.0).chain(ends);
    let lengths = begins.zip(ends).map(|(begin, end)| end - begin);
    let given = parts.iter().zip(lengths).filter(|(part, _)| part.given);
    given.map(|(part, length)| length / given_speed(part)).sum()
}

/// The lesser of two values; a NaN (no limit times 0) counts as no limit.
fn least(a: f64, b: f64) -> f64 {
    if b < a { b } else { a }
}

/// Clock limits for parts that end at `ends` (s): of all trials those with the shortest time from rest to rest.
///
/// # Errors
/// Returns [`LimitsFault::TooFast`] if the given speed of a part is too high for joints or bends,
/// [`LimitsFault::Clock`] if no valid limits are found.
pub(crate) fn fastest_bounds(
    parts: &[SampledPart],
    ends: &[f64],
    dt_s: f64,
) -> Result<PathBounds, LimitsFault> {
    let greatest = max_acceleration(parts);
    let mut best: Option<(f64, PathBounds)> = None;
    let mut too_fast = false;
    let given = |part: &SampledPart| part.given.then(|| given_speed(part));
    let speeds: Vec<_> = (parts.iter())
        .map(|part| (SpeedsOfPart::new(part), given(part)))
        .collect();
    for acceleration in TRIALS.iter().map(|trial| trial * greatest) {
        let velocities = speeds.iter().map(|(speeds, given)| {
            let possible = speeds.at(acceleration);
            let kept = given.is_none_or(|given| possible >= given * (1.0 - 1e-9));
            kept.then_some(possible)
        });
        let Some(velocities) = velocities.collect::<Option<Vec<_>>>() else {
            too_fast = true;
            continue;
        };
        let Some(bounds) = path_bounds((parts, ends), &velocities, acceleration, dt_s) else {
            continue;
        };
        let time = duration_s(&bounds);
        if best.as_ref().is_none_or(|(shortest, _)| time < *shortest) {
            best = Some((time, bounds));
        }
    }
    let bounds = match best {
        Some((_, bounds)) => bounds,
        None if too_fast => bounds_for_given_speeds((parts, ends), greatest, dt_s)?,
        None => return Err(LimitsFault::Clock),
    };
    Ok(shorter_with_lower_speed((parts, ends), &bounds).unwrap_or(bounds))
}

/// Factor between the lower speeds that are tried where a given speed is not reached.
const LOWER: f64 = 0.85;
const LOWER_MAX: usize = 16;

/// A path that is too short to reach its given speed must not become slower because of it: returns limits without room
/// for a speed that is not reached, if they shorten the motion.
fn shorter_with_lower_speed(
    (parts, ends): (&[SampledPart], &[f64]),
    bounds: &PathBounds,
) -> Option<PathBounds> {
    let [part] = parts else { return None };
    let top = peak(bounds);
    let wanted = given_speed(part);
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
        let bounds = fastest_bounds(&[lower(times)], ends, bounds.dt_s()).ok()?;
        Some((duration_s(&bounds), bounds))
    });
    let (time, free) = tried.min_by(|(a, _), (b, _)| a.total_cmp(b))?;
    (time < duration_s(bounds)).then_some(free)
}

/// Limits for given speeds that do not fit the shares of the jerk limit: bends take what they need, and half of the
/// rest is for changing the speed in them.
fn bounds_for_given_speeds(
    (parts, ends): (&[SampledPart], &[f64]),
    greatest: f64,
    dt_s: f64,
) -> Result<PathBounds, LimitsFault> {
    let enough = |margin: &SpeedMargin| margin.acceleration >= LEAST_ACCELERATION * greatest;
    let margin = SpeedMargin::at(parts, 1.0);
    if enough(&margin) {
        let acceleration = least(greatest, margin.acceleration);
        let velocities = parts.iter().map(|part| match part.given {
            true => given_speed(part),
            false => SpeedsOfPart::new(part).at(acceleration),
        });
        let velocities: Vec<f64> = velocities.collect();
        let bounds = path_bounds((parts, ends), &velocities, acceleration, dt_s);
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

/// Clock limits for a stop that begins on a part of the path and ends on it or a few parts later: locally more is
/// allowed than on the whole path.
#[derive(Debug, Clone)]
pub(crate) struct BrakingLimits {
    /// Beginning (`from`) and end (`until`) of the part on which the stop begins, s.
    from: f64,
    until: f64,
    /// Limits on that part and the following ones; their length is where the stop must have ended.
    pub(crate) bounds: PathBounds,
}

impl BrakingLimits {
    /// Limits for a stop that begins at `s`, give or take `tolerance`.
    pub(super) fn at(s: f64, tolerance: f64, bounds: PathBounds) -> Self {
        Self {
            from: s - tolerance,
            until: s + tolerance,
            bounds,
        }
    }

    /// Where the stop begins, s; the middle if it may begin on a part of the path.
    pub(crate) fn begin(&self) -> f64 {
        0.5 * (self.from + self.until)
    }

    /// Returns true if the stop begins before `s`.
    pub(crate) fn is_before(&self, s: f64) -> bool {
        self.until < s
    }

    /// Duration of a stop from a state, s.
    pub(crate) fn stop_duration_s(&self, state: AxisState) -> f64 {
        self.bounds.acceleration_limits().stop(state).duration_s()
    }

    /// Returns true if a stop with these limits may begin at `s`.
    pub(crate) fn begins_at(&self, s: f64) -> bool {
        self.from <= s && s <= self.until
    }
}

/// Numbers of parts on which a stop may take place; more would cost building time and memory for few long stops.
const STOP_PARTS: [usize; 2] = [2, 8];

/// Fractions of the greatest acceleration on these parts: harder braking requires a lower speed in bends.
const STOP_ACCELERATIONS: [f64; 3] = [0.9, 0.6, 0.3];

/// Limits for stops on each part, those with the hardest braking first; the last are `uniform`, the limits of the whole
/// path.
pub(crate) fn braking_limits(
    parts: &[SampledPart],
    ends: &[f64],
    uniform: PathBounds,
) -> Box<[BrakingLimits]> {
    let dt_s = uniform.dt_s();
    let begins = core::iter::once(0.0).chain(ends.iter().copied());
    let speeds: Vec<_> = parts.iter().map(SpeedsOfPart::new).collect();
    let mut stops = Vec::new();
    for ((first, from), until) in begins.enumerate().zip(ends) {
        for reach in STOP_PARTS {
            let last = first.saturating_add(reach).min(parts.len());
            let (Some(near), Some(speeds), Some(ends)) = (
                parts.get(first..last),
                speeds.get(first..last),
                ends.get(first..last),
            ) else {
                continue;
            };
            let greatest = max_acceleration(near);
            for acceleration in STOP_ACCELERATIONS.map(|trial| trial * greatest) {
                let velocities: Vec<f64> = (speeds.iter())
                    .map(|speeds| speeds.at(acceleration))
                    .collect();
                let bounds = path_bounds((near, ends), &velocities, acceleration, dt_s);
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
        until: uniform.length(),
        bounds: uniform,
    });
    stops.into()
}

/// The greatest acceleration along these parts that every quantity allows at rest.
fn max_acceleration(parts: &[SampledPart]) -> f64 {
    let rows = parts.iter().flat_map(SampledPart::all);
    rows.map(|([first, ..], [_, a, _])| a / first)
        .fold(f64::INFINITY, least)
}

/// The acceleration that given speeds leave.
struct SpeedMargin {
    /// The greatest possible acceleration along the path; negative: the speeds are too high.
    acceleration: f64,
    /// The quantity that leaves least.
    fault: TooFast,
}

impl SpeedMargin {
    /// The margin at `times` the given speeds.
    fn at(parts: &[SampledPart], times: f64) -> SpeedMargin {
        let mut least = SpeedMargin {
            acceleration: f64::INFINITY,
            fault: TooFast::NONE,
        };
        for (number, part) in parts.iter().enumerate().filter(|(_, part)| part.given) {
            let speed = times * given_speed(part);
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

/// Velocity, acceleration and jerk at a constant speed.
fn powers([first, second, third]: &[f64; 3], speed: f64) -> [f64; 3] {
    [
        first * speed,
        second * speed * speed,
        third * speed * speed * speed,
    ]
}

/// Accelerations along the path that the velocity, acceleration and jerk limits of a quantity leave; -∞ if the speed is
/// too high.
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

/// Clock limits with these velocities and this acceleration, and the jerk that remains.
fn path_bounds(
    (parts, ends): (&[SampledPart], &[f64]),
    velocities: &[f64],
    acceleration: f64,
    dt_s: f64,
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
    PathBounds::new(&pieces, acceleration, jerk, dt_s).ok()
}
