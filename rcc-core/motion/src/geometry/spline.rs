//! Smooth curves through poses: position and orientation as natural quintic splines (C4 in their parameter). Built off
//! the real-time thread, which evaluates them in a bounded number of steps.
//!
//! The parameter u of the curve is the length of the chords between the points. s is arc length if the curve moves the
//! origin of the flange at sufficient speed everywhere (then it is C2 in s, up to the rounding of the table: 1e-12 m),
//! and u itself otherwise, e.g. for a rotation on the spot. Orientation is interpolated in modified Rodrigues
//! parameters relative to the middle pose.

use rcc_core::pose::Pose;
use rcc_core::rotation::{self, Quaternion};

use super::jet::{self, Jet, JetScalar};
use super::line::{angle_between, distance};
use super::natural_spline::natural;
use super::quintic::Quintic;
use super::{COINCIDENT_M, GeometryError, PathMetric, Placement, finite};

/// Steps of the arc length table between two points.
const STEPS: usize = 16;

/// If |dx/du| is below this anywhere, s is u and not arc length.
const SLOWEST: f64 = 0.1;

/// Largest rotation of a pose relative to the middle pose, rad.
const TURN_MAX: f64 = 4.0;

/// Nodes and weights of Gauss-Legendre quadrature on [−1, 1].
const GAUSS: [(f64, f64); 5] = [
    (0.0, 0.568_888_888_888_888_9),
    (-0.538_469_310_105_683_1, 0.478_628_670_499_366_5),
    (0.538_469_310_105_683_1, 0.478_628_670_499_366_5),
    (-0.906_179_845_938_664, 0.236_926_885_056_189_1),
    (0.906_179_845_938_664, 0.236_926_885_056_189_1),
];

/// A smooth curve through poses.
#[derive(Debug, Clone, PartialEq)]
pub struct Spline {
    /// u at the beginning of each curve, and at the end of the last one.
    knots: Vec<f64>,
    curves: Vec<Quintic<6>>,
    middle: Quaternion,
    /// (s, u) at the steps; empty if s is u.
    table: Vec<(f64, f64)>,
    length: f64,
}

impl Spline {
    /// The curve from the first pose through all others.
    ///
    /// # Errors
    /// Returns [`GeometryError`] for an empty list, if neighbouring poses coincide or differ by half a turn, if a pose
    /// is rotated by more than 4 rad from the middle one, or if a value is not finite.
    pub fn new(poses: &[Pose], metric: PathMetric) -> Result<Self, GeometryError> {
        poses.iter().try_for_each(finite)?;
        let middle = poses.get(poses.len() / 2).ok_or(GeometryError::NotFinite)?;
        let (mut knots, mut values) = (Vec::new(), Vec::new());
        let (mut u, mut last): (f64, Option<&Pose>) = (0.0, None);
        let turns = orientations(poses, middle.orientation)?;
        for (number, (pose, turn)) in poses.iter().zip(turns).enumerate() {
            if let Some(last) = last {
                let way_m = distance(last.position, pose.position);
                let angle = angle_between(last.orientation, pose.orientation);
                let chord = metric.length(way_m, angle);
                if chord < COINCIDENT_M {
                    return Err(GeometryError::Coincident {
                        first: number - 1,
                        second: number,
                        distance_m: chord,
                    });
                }
                u += chord;
            }
            last = Some(pose);
            knots.push(u);
            let ([x, y, z], [a, b, c]) = (pose.position, turn);
            values.push([x, y, z, a, b, c]);
        }
        let curves = natural(&knots, &values).ok_or(GeometryError::NotFinite)?;
        let mut spline = Self {
            knots,
            curves,
            middle: middle.orientation,
            table: Vec::new(),
            length: u,
        };
        spline.measure();
        Ok(spline)
    }

    /// Length in s (> 0).
    #[must_use]
    pub fn length(&self) -> f64 {
        self.length
    }

    /// Metres of the flange per unit of s (1) if s is arc length.
    #[must_use]
    pub fn speed_by_arc(&self) -> Option<f64> {
        (!self.table.is_empty()).then_some(1.0)
    }

    /// s of each point, including the first (0) and the last (the length).
    #[must_use]
    pub fn points(&self) -> Vec<f64> {
        let every = self.table.iter().step_by(STEPS).map(|(s, _)| *s);
        if self.table.is_empty() {
            self.knots.clone()
        } else {
            every.collect()
        }
    }

    /// Builds the arc length table if s can be arc length.
    fn measure(&mut self) {
        let mut table = vec![(0.0, 0.0)];
        let (mut s, mut slowest) = (0.0, f64::INFINITY);
        for (from, to) in self.knots.iter().zip(self.knots.iter().skip(1)) {
            let mut u = *from;
            for step in 1..=STEPS {
                #[allow(clippy::cast_precision_loss)] // At most STEPS.
                let part = step as f64 / STEPS as f64;
                let next = if step == STEPS {
                    *to
                } else {
                    from + (to - from) * part
                };
                s += self.arc(u, next);
                slowest = self.speed(u)[0].min(slowest);
                u = next;
                table.push((s, u));
            }
            slowest = self.speed(*to)[0].min(slowest);
        }
        if slowest >= SLOWEST {
            (self.table, self.length) = (table, s);
        }
    }

    /// The curve at u, and the u at which it begins.
    fn curve(&self, u: f64) -> Option<(&Quintic<6>, f64)> {
        let number = self.knots.partition_point(|knot| *knot <= u);
        let number = number.clamp(1, self.curves.len().max(1)) - 1;
        Some((self.curves.get(number)?, *self.knots.get(number)?))
    }

    /// |dx/du| and its first two derivatives by u.
    fn speed(&self, u: f64) -> [f64; 3] {
        let Some((curve, begin)) = self.curve(u) else {
            return [f64::NAN; 3];
        };
        let [x, y, z, ..] = curve.at(Jet::variable(u - begin));
        let derivative = |order: usize| [x, y, z].map(|x| x.derivative(order));
        let [first, second, third] = [derivative(1), derivative(2), derivative(3)];
        let dot = rcc_core::vector::dot;
        let speed = libm::sqrt(dot(first, first));
        let rise = dot(first, second) / speed;
        let bend = (dot(second, second) + dot(first, third) - rise * rise) / speed;
        [speed, rise, bend]
    }

    /// Arc length between two values of u on one curve, m.
    fn arc(&self, from: f64, to: f64) -> f64 {
        let curve = self.curve(0.5 * (from + to));
        curve.map_or(f64::NAN, |curve| arc_on(curve, from, to))
    }

    /// u at s: a table look-up, then three iterations of Newton's method, which converge to rounding.
    fn parameter(&self, s: f64) -> f64 {
        let step = self.table.partition_point(|(at, _)| *at <= s);
        let step = step.clamp(1, self.table.len().saturating_sub(1).max(1));
        let (Some((s0, u0)), Some((s1, u1))) = (self.table.get(step - 1), self.table.get(step))
        else {
            return s;
        };
        let mut u = u0 + (s - s0) * (u1 - u0) / (s1 - s0);
        let Some((curve, begin)) = self.curve(0.5 * (u0 + u1)) else {
            return u;
        };
        for _ in 0..3 {
            u -= (s0 + arc_on((curve, begin), *u0, u) - s) / position_speed(curve, u - begin);
            u = u.max(*u0).min(*u1);
        }
        u
    }

    /// u at s with its derivatives by s.
    fn parameter_with_derivatives(&self, s: f64) -> [f64; 4] {
        let u = self.parameter(s);
        let [g, g1, g2] = self.speed(u);
        let cube = g * g * g;
        [
            u,
            1.0 / g,
            -g1 / cube,
            (3.0 * g1 * g1 - g * g2) / (cube * g * g),
        ]
    }

    /// The pose at `s`.
    pub fn at<T: JetScalar>(&self, s: T) -> Placement<T> {
        let u = match self.table.is_empty() {
            true => s,
            false => s.through_of(
                |s| self.parameter(s),
                |s| self.parameter_with_derivatives(s),
            ),
        };
        let nowhere = [T::constant(f64::NAN); 6];
        let values = self
            .curve(u.value())
            .map_or(nowhere, |(curve, begin)| curve.at(u - T::constant(begin)));
        let [x, y, z, a, b, c] = values;
        let middle = self.middle.map(T::constant);
        Placement {
            position: [x, y, z],
            orientation: jet::product(middle, jet::from_rodrigues([a, b, c])),
        }
    }
}

/// |dx/du| of a curve at u, counted from its beginning.
#[inline]
fn position_speed(curve: &Quintic<6>, u: f64) -> f64 {
    let [x, y, z] = curve.slope(u);
    libm::sqrt(x * x + y * y + z * z)
}

/// Arc length between two values of u on a curve that begins at `begin`, m.
#[inline]
fn arc_on((curve, begin): (&Quintic<6>, f64), from: f64, to: f64) -> f64 {
    let (middle, half) = (0.5 * (from + to), 0.5 * (to - from));
    let speeds = GAUSS.map(|(node, _)| position_speed(curve, middle + half * node - begin));
    let sum: f64 = GAUSS
        .iter()
        .zip(speeds)
        .map(|((_, weight), speed)| weight * speed)
        .sum();
    half * sum
}

/// The orientations relative to the middle one as modified Rodrigues parameters, each continuous with the previous one.
fn orientations(poses: &[Pose], middle: Quaternion) -> Result<Vec<[f64; 3]>, GeometryError> {
    let back = rotation::inverse(middle);
    let mut relative: Vec<Quaternion> = Vec::new();
    for pose in poses {
        let mut turn = rotation::product(back, pose.orientation);
        if let Some(last) = relative.last() {
            let near: f64 = last.iter().zip(turn).map(|(a, b)| a * b).sum();
            if libm::fabs(near) < 1e-9 {
                return Err(GeometryError::HalfTurn);
            }
            if near < 0.0 {
                turn = turn.map(|x| -x);
            }
        }
        relative.push(turn);
    }
    // Signs are chained from the first pose; the middle one decides whether all are flipped.
    let flip = relative
        .get(poses.len() / 2)
        .is_some_and(|turn| turn[3] < 0.0);
    let mut turns = Vec::new();
    for (point, turn) in relative.into_iter().enumerate() {
        let turn = if flip { turn.map(|x| -x) } else { turn };
        let angle_rad = 2.0 * libm::acos(turn[3].clamp(-1.0, 1.0));
        if angle_rad > TURN_MAX {
            return Err(GeometryError::TurnsTooFar { point, angle_rad });
        }
        turns.push(jet::to_rodrigues(turn));
    }
    Ok(turns)
}
