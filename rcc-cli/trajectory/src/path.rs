//! The curve through the points: one polynomial of degree 5 for each joint between two points, continuous in position,
//! velocity and acceleration. Run by whoever imports.

use rcc_motion::geometry::quintic::Quintic;
use thiserror::Error;

use crate::read::{JointTrajectory, Point};

/// Velocity at the first or last point that counts as rest, rad/s.
const REST_RAD_S: f64 = 1e-6;

/// Quantities that the file gives for each point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interpolation {
    /// Positions: velocities and accelerations are those of a cubic spline at rest at both ends.
    Spline,
    /// Positions and velocities: accelerations are the mean of those of the two cubic polynomials that meet there.
    Cubic,
    /// Positions, velocities and accelerations.
    Quintic,
}

/// A curve in joint space over time.
#[derive(Clone, Debug, PartialEq)]
pub struct TrajectoryPath {
    /// Times of the points, s; the first is 0.
    pub times_s: Vec<f64>,
    /// Coefficients c₀ … c₅ of each joint for each section, rad: q(u) = Σ cᵢ uⁱ, with u from 0 to 1.
    pub sections: Vec<Vec<[f64; 6]>>,
    /// Positions at the end, rad.
    pub end: Vec<f64>,
    /// Quantities that the file gives for each point.
    pub interpolation: Interpolation,
    /// Largest |acceleration| that the file gives at the first or last point, rad/s². It is not used: an arm at rest has none.
    pub dropped_rad_s2: f64,
}

/// Why the points do not form a motion from rest to rest.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum PathError {
    /// Only one point.
    #[error("a trajectory needs two points at least, the first at 0 s")]
    OnePoint,
    /// The first point is later than 0 s, and no start is given.
    #[error("the first point is at {first_s} s, so the positions at 0 s are missing")]
    NoStart {
        /// Its time, s.
        first_s: f64,
    },
    /// The first point is at 0 s, and a start is given.
    #[error("the trajectory has a first point at 0 s, and another start is given")]
    TwoStarts,
    /// The start has another number of joints.
    #[error("the start has {have} positions for {joints} joints")]
    StartWidth {
        /// Given positions.
        have: usize,
        /// Joints of the trajectory.
        joints: usize,
    },
    /// The arm would begin or end in motion.
    #[error("{end} point: joint `{joint}` moves with {velocity_rad_s} rad/s, but must be at rest")]
    InMotion {
        /// `first` or `last`.
        end: &'static str,
        /// Name of the joint.
        joint: String,
        /// Its velocity.
        velocity_rad_s: f64,
    },
}

/// Position and derivatives of one joint, rad and s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Derivatives {
    /// rad
    pub position: f64,
    /// rad/s
    pub velocity: f64,
    /// rad/s²
    pub acceleration: f64,
    /// rad/s³
    pub jerk: f64,
}

impl TrajectoryPath {
    /// Interpolates a trajectory; `start` are the positions at 0 s if its first point is later, and `stretch` multiplies all
    /// times (above 0).
    ///
    /// # Errors
    /// Fails if the points are no motion from rest to rest.
    pub fn new(
        trajectory: &JointTrajectory,
        start: Option<&[f64]>,
        stretch: f64,
    ) -> Result<TrajectoryPath, PathError> {
        let points = with_start(trajectory, start)?;
        let (Some(first), Some(last)) = (points.first(), points.last()) else {
            return Err(PathError::OnePoint);
        };
        if points.len() < 2 {
            return Err(PathError::OnePoint);
        }
        at_rest(trajectory, first, "first")?;
        at_rest(trajectory, last, "last")?;
        let interpolation = match (&first.velocities, &first.accelerations) {
            (Some(_), Some(_)) => Interpolation::Quintic,
            (Some(_), None) => Interpolation::Cubic,
            _ => Interpolation::Spline,
        };
        let times_s: Vec<f64> = points.iter().map(|point| point.time_s).collect();
        let joints = (0..trajectory.joints.len()).map(|joint| knots(&points, &times_s, joint));
        let joints: Vec<Vec<[f64; 3]>> = joints.collect();
        let sections = times_s.windows(2).enumerate().map(|(section, times)| {
            let duration = times[1] - times[0];
            let of = |knots: &Vec<[f64; 3]>| quintic(knots[section], knots[section + 1], duration);
            joints.iter().map(of).collect()
        });
        let ends = [first, last]
            .into_iter()
            .filter_map(|point| point.accelerations.as_ref());
        let dropped = ends
            .flatten()
            .fold(0.0_f64, |most, value| most.max(value.abs()));
        Ok(TrajectoryPath {
            sections: sections.collect(),
            times_s: times_s.iter().map(|time| time * stretch).collect(),
            end: last.positions.clone(),
            interpolation,
            dropped_rad_s2: dropped,
        })
    }

    /// Returns the duration, s.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.times_s.last().copied().unwrap_or(0.0)
    }

    /// Returns the state of a joint at a time, s; before and after the trajectory it is at rest.
    #[must_use]
    pub fn at(&self, joint: usize, time_s: f64) -> Derivatives {
        let section = self.times_s.partition_point(|begin| *begin <= time_s);
        let section = section.saturating_sub(1);
        let coefficients = self
            .sections
            .get(section)
            .and_then(|joints| joints.get(joint));
        let times = self.times_s.get(section..section + 2);
        let (Some(c), Some(&[begin, end])) = (coefficients, times) else {
            return Derivatives {
                position: self.end.get(joint).copied().unwrap_or(f64::NAN),
                ..Derivatives::default()
            };
        };
        let duration = end - begin;
        let u = (time_s - begin) / duration;
        let horner = |factors: &[f64]| factors.iter().rev().fold(0.0, |sum, c| sum * u + c);
        Derivatives {
            position: horner(c),
            velocity: horner(&[c[1], 2.0 * c[2], 3.0 * c[3], 4.0 * c[4], 5.0 * c[5]]) / duration,
            acceleration: horner(&[2.0 * c[2], 6.0 * c[3], 12.0 * c[4], 20.0 * c[5]])
                / duration.powi(2),
            jerk: horner(&[6.0 * c[3], 24.0 * c[4], 60.0 * c[5]]) / duration.powi(3),
        }
    }
}

/// Returns the points, the first at 0 s.
fn with_start(
    trajectory: &JointTrajectory,
    start: Option<&[f64]>,
) -> Result<Vec<Point>, PathError> {
    let mut points = trajectory.points.clone();
    let first = points.first().ok_or(PathError::OnePoint)?;
    match (start, first.time_s > 0.0) {
        (None, false) => {}
        (None, true) => {
            return Err(PathError::NoStart {
                first_s: first.time_s,
            });
        }
        (Some(_), false) => return Err(PathError::TwoStarts),
        (Some(start), true) => {
            let joints = trajectory.joints.len();
            if start.len() != joints {
                let have = start.len();
                return Err(PathError::StartWidth { have, joints });
            }
            let zero = |given: &Option<Vec<f64>>| given.as_ref().map(|_| vec![0.0; joints]);
            let point = Point {
                time_s: 0.0,
                positions: start.to_vec(),
                velocities: zero(&first.velocities),
                accelerations: zero(&first.accelerations),
            };
            points.insert(0, point);
        }
    }
    Ok(points)
}

fn at_rest(
    trajectory: &JointTrajectory,
    point: &Point,
    end: &'static str,
) -> Result<(), PathError> {
    let velocities = point.velocities.iter().flatten();
    let mut moving = velocities
        .zip(&trajectory.joints)
        .filter(|(velocity, _)| velocity.abs() > REST_RAD_S);
    match moving.next() {
        None => Ok(()),
        Some((velocity, joint)) => Err(PathError::InMotion {
            end,
            joint: joint.clone(),
            velocity_rad_s: *velocity,
        }),
    }
}

/// Returns position, velocity and acceleration of a joint at each point; at rest at both ends.
fn knots(points: &[Point], times_s: &[f64], joint: usize) -> Vec<[f64; 3]> {
    let of = |values: &Vec<f64>| values.get(joint).copied().unwrap_or(0.0);
    let positions: Vec<f64> = points.iter().map(|point| of(&point.positions)).collect();
    let given: Option<Vec<f64>> = points
        .iter()
        .map(|point| point.velocities.as_ref().map(of))
        .collect();
    let mut velocities = given.unwrap_or_else(|| spline_velocities(&positions, times_s));
    let given: Option<Vec<f64>> = points
        .iter()
        .map(|point| point.accelerations.as_ref().map(of))
        .collect();
    let mut accelerations =
        given.unwrap_or_else(|| mean_accelerations(&positions, &velocities, times_s));
    for column in [&mut velocities, &mut accelerations] {
        for end in [0, points.len() - 1] {
            column[end] = 0.0;
        }
    }
    let rows = positions.iter().zip(&velocities).zip(&accelerations);
    rows.map(|((position, velocity), acceleration)| [*position, *velocity, *acceleration])
        .collect()
}

/// Velocities of the cubic spline with two continuous derivatives that is at rest at both ends (de Boor, A Practical Guide
/// to Splines, IV): a tridiagonal system, solved by elimination.
fn spline_velocities(positions: &[f64], times_s: &[f64]) -> Vec<f64> {
    let count = positions.len();
    let mut velocities = vec![0.0; count];
    let step = |i: usize| times_s[i + 1] - times_s[i];
    let slope = |i: usize| (positions[i + 1] - positions[i]) / step(i);
    let mut upper = vec![0.0; count];
    for i in 1..count - 1 {
        let (before, after) = (step(i - 1), step(i));
        let right = 3.0 * (after * slope(i - 1) + before * slope(i));
        let pivot = 2.0 * (before + after) - after * upper[i - 1];
        upper[i] = before / pivot;
        velocities[i] = (right - after * velocities[i - 1]) / pivot;
    }
    for i in (1..count - 1).rev() {
        velocities[i] -= upper[i] * velocities[i + 1];
    }
    velocities
}

/// Accelerations at the points: the mean of those of the cubic polynomials before and after, which are equal for a spline.
fn mean_accelerations(positions: &[f64], velocities: &[f64], times_s: &[f64]) -> Vec<f64> {
    let count = positions.len();
    let mut accelerations = vec![0.0; count];
    for i in 1..count - 1 {
        let before = times_s[i] - times_s[i - 1];
        let after = times_s[i + 1] - times_s[i];
        let left = -6.0 * (positions[i] - positions[i - 1]) / before.powi(2)
            + (2.0 * velocities[i - 1] + 4.0 * velocities[i]) / before;
        let right = 6.0 * (positions[i + 1] - positions[i]) / after.powi(2)
            - (4.0 * velocities[i] + 2.0 * velocities[i + 1]) / after;
        accelerations[i] = 0.5 * (left + right);
    }
    accelerations
}

/// Coefficients of the polynomial of degree 5 from one state (position, velocity, acceleration) to another.
fn quintic(from: [f64; 3], to: [f64; 3], duration: f64) -> [f64; 6] {
    let end = |state: [f64; 3]| state.map(|value| [value]);
    let [coefficients] = *Quintic::between(end(from), end(to), duration).coefficients();
    coefficients
}

#[cfg(test)]
mod tests;
