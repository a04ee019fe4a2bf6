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

use crate::path_clock::{PathBounds, PathPiece, duration_s};

/// Line, turn and eight joints.
pub(crate) const QUANTITIES: usize = 10;

/// The quantity at a place of a [`Sample`].
fn quantity(number: usize) -> Quantity {
    match number {
        0 => Quantity::Line,
        1 => Quantity::Turn,
        joint => Quantity::Joint((joint - 2) as u8),
    }
}

/// Added to every derivative, as part of it.
pub(crate) const MARGIN: f64 = 0.005;

/// What of the limits is for what.
pub(crate) struct Shares {
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
pub(crate) const EVEN: Shares = Shares {
    trials: &[
        1.0, 0.98, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1, 0.04, 0.01,
    ],
    for_bends: 0.4,
    for_speed: 0.3,
    run_out: false,
};

/// Of a law that accelerates by itself with a part of the limits: its clock only changes the speed of it, and stops, with
/// what is left.
pub(crate) const LAWS: [(f64, Shares); 3] = [
    (0.55, law(&[0.38])),
    (0.7, law(&[0.25])),
    (0.82, law(&[0.15])),
];

const fn law(trials: &'static [f64]) -> Shares {
    Shares {
        trials,
        for_bends: 0.65,
        for_speed: 0.2,
        run_out: true,
    }
}

/// |y'|, |y''|, |y'''| of every quantity at one place.
pub(crate) type Sample = [[f64; 3]; QUANTITIES];

/// Velocity, acceleration and jerk of every quantity; infinite where there is no limit.
pub(crate) type Bounds = [[f64; 3]; QUANTITIES];

/// Samples of a part of a path with what limits it.
#[derive(Debug, Clone)]
pub(crate) struct Part {
    /// At even steps, ends included.
    pub(crate) samples: Vec<Sample>,
    /// What is kept.
    pub(crate) bounds: Bounds,
    /// The speed limits of line and turn are what the net wants; if joints or curves cannot follow, it is refused.
    pub(crate) given: bool,
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

/// Why there are no limits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Refused {
    /// A given speed.
    TooFast(TooFast),
    /// What was found is nothing that a clock keeps.
    Clock,
}

/// Makes samples bounds of what lies between them.
pub(crate) fn widen(samples: &[Sample]) -> Vec<Sample> {
    let at = |number: usize| samples.get(number);
    let wide = |number: usize| {
        core::array::from_fn(|quantity| {
            core::array::from_fn(|order| {
                let value = |sample: &Sample| sample[quantity][order];
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

/// The greatest speed at which the path may speed up by `acceleration`, and what limits it.
fn speed(sample: &Sample, bounds: &Bounds, acceleration: f64, shares: &Shares) -> (f64, usize, u8) {
    let mut lowest = (f64::INFINITY, 0, 1);
    for (number, ([first, second, third], [v, a, j])) in sample.iter().zip(bounds).enumerate() {
        let left = (a - first * acceleration).max(0.0);
        let by = [
            v / first,
            libm::sqrt(left / second),
            libm::cbrt(shares.for_bends * j / third)
                .min(shares.for_speed * j / (3.0 * second * acceleration)),
        ];
        for (order, speed) in (1u8..).zip(by) {
            if speed < lowest.0 {
                lowest = (speed, number, order);
            }
        }
    }
    lowest
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
    parts: &[Part],
    ends: &[f64],
    dt_s: f64,
    shares: &Shares,
) -> Result<PathBounds, Refused> {
    let mut greatest = f64::INFINITY;
    for part in parts {
        for ([first, ..], [_, a, _]) in part.samples.iter().flat_map(|s| s.iter().zip(&part.bounds))
        {
            greatest = least(greatest, a / first);
        }
    }
    let mut best: Option<(f64, PathBounds)> = None;
    let mut refused = Refused::Clock;
    for trial in shares.trials {
        let tried = trial_of((parts, ends), trial * greatest, dt_s, shares);
        match tried {
            Ok(bounds) => {
                let time = duration_s(&bounds);
                if best.as_ref().is_none_or(|(shortest, _)| time < *shortest) {
                    best = Some((time, bounds));
                }
            }
            Err(error) => refused = error,
        }
    }
    best.map(|(_, bounds)| bounds).ok_or(refused)
}

/// Limits with one acceleration.
fn trial_of(
    (parts, ends): (&[Part], &[f64]),
    acceleration: f64,
    dt_s: f64,
    shares: &Shares,
) -> Result<PathBounds, Refused> {
    let (mut pieces, mut jerk) = (Vec::new(), f64::INFINITY);
    for ((number, part), end) in parts.iter().enumerate().zip(ends) {
        let v = velocity(number, part, acceleration, shares).map_err(Refused::TooFast)?;
        for sample in &part.samples {
            for ([first, second, third], [_, _, j]) in sample.iter().zip(&part.bounds) {
                let rest = j - third * v * v * v - 3.0 * second * v * acceleration;
                jerk = least(jerk, rest / first);
            }
        }
        pieces.push(PathPiece {
            end_s: *end,
            velocity: v,
        });
    }
    if let Some(last) = pieces.last_mut().filter(|_| shares.run_out) {
        // The longest way of a stop, and a cycle more.
        let v = last.velocity;
        let build_up = (acceleration / jerk).max(libm::sqrt(v / jerk));
        last.end_s += v * (v / (2.0 * acceleration) + 1.5 * build_up + 2.0 * dt_s);
    }
    PathBounds::new(&pieces, acceleration, jerk, dt_s).map_err(|_| Refused::Clock)
}

fn velocity(
    number: usize,
    part: &Part,
    acceleration: f64,
    shares: &Shares,
) -> Result<f64, TooFast> {
    let (mut lowest, mut place) = ((f64::INFINITY, 0, 1), 0);
    // What the flange is given, without what joints and bends say.
    let mut given = f64::INFINITY;
    for (at, sample) in part.samples.iter().enumerate() {
        let here = speed(sample, &part.bounds, acceleration, shares);
        if here.0 < lowest.0 {
            (lowest, place) = (here, at);
        }
        for ([first, ..], [v, ..]) in sample.iter().zip(&part.bounds).take(2) {
            given = least(given, v / first);
        }
    }
    let (possible, index, order) = lowest;
    if !part.given || possible >= given * (1.0 - 1e-9) {
        return Ok(possible);
    }
    let [first, second, third] = part.samples[place][index];
    let [v, a, j] = part.bounds[index];
    let (value, limit) = match order {
        1 => (first * given, v),
        2 => (second * given * given, a),
        _ => (third * given * given * given, shares.for_bends * j),
    };
    Err(TooFast {
        part: number,
        fraction: place as f64 / (part.samples.len().max(2) - 1) as f64,
        quantity: quantity(index),
        order,
        value,
        limit,
        possible: possible / given,
    })
}
