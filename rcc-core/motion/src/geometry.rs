//! Path geometry: flange or joints as functions of the path parameter s, with derivatives by s up to the third. Built
//! off the real-time thread, which evaluates `at`: no allocation, a bounded number of steps.
//!
//! s is in metres: a rotation counts its angle times the [radius](PathMetric) at which the angular limits are as tight
//! as the linear ones, and the greater of both lengths counts. Every shape is smooth inside; a [`chain::Chain`] joins
//! shapes such that position and its first and second derivative by s are continuous (C2), or marks where the motion
//! must stop.

pub mod blend;
pub mod chain;
pub mod circle;
pub mod jet;
pub mod line;
mod natural_spline;
pub mod quintic;
pub mod spline;

use rcc_core::pose::Pose;
use rcc_core::rotation::Quaternion;
use rcc_core::vector::Vector;
use thiserror::Error;

use jet::{Jet, JetScalar};

/// Points closer than this count as one point, m.
pub const COINCIDENT_M: f64 = 1e-6;

/// Lengths and angles below this count as 0 (m, rad).
pub const LENGTH_MIN: f64 = 1e-9;

/// Why points or poses do not define a path.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum GeometryError {
    /// Start and end differ by half a turn: both directions are equally short.
    #[error("the orientation turns by 180°: both ways are equally short; give a pose between")]
    HalfTurn,
    /// The three points of a circle lie on a line.
    #[error(
        "start, via and end of a circle lie on a line; move the via point aside, or use a line"
    )]
    Collinear,
    /// The angle of a circle is 0.
    #[error("the angle of a circle is 0; leave it out to end at the end point, or take a line")]
    NoAngle,
    /// Two points coincide.
    #[error(
        "points {first} and {second} of the path are {distance_m:.1e} m apart: they must differ by 1 µm or more"
    )]
    Coincident {
        /// Number of a point; 0 is the start.
        first: usize,
        /// Number of the other one.
        second: usize,
        /// Their distance, m.
        distance_m: f64,
    },
    /// A pose of a spline is rotated too far from the middle pose.
    #[error(
        "point {point} of the spline is turned by {angle_rad:.2} rad from the middle point: 4 rad at most"
    )]
    TurnsTooFar {
        /// Number of the point; 0 is the start.
        point: usize,
        /// The angle, rad.
        angle_rad: f64,
    },
    /// A pose, point, angle or joint is NaN or infinite.
    #[error("a pose, joint or angle of the path is null or not finite")]
    NotFinite,
}

/// How rotation counts in the length of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathMetric {
    /// Metres that one radian counts (> 0): velocity limit divided by angular velocity limit.
    pub radius_m: f64,
}

impl PathMetric {
    /// Length of a path of `way_m` (m) that rotates by `angle_rad` (rad): the greater of both.
    #[must_use]
    pub fn length(self, way_m: f64, angle_rad: f64) -> f64 {
        let length = way_m.max(angle_rad * self.radius_m);
        if way_m > LENGTH_MIN || angle_rad > LENGTH_MIN {
            length
        } else {
            0.0
        }
    }
}

/// Position (m) and orientation (unit quaternion `[x y z w]`) of the flange in the arm's base, as numbers or as jets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement<T> {
    /// `[x y z]`.
    pub position: [T; 3],
    /// `[x y z w]`.
    pub orientation: [T; 4],
}

impl<T: JetScalar> Placement<T> {
    /// The pose without derivatives.
    #[must_use]
    pub fn pose(&self) -> Pose {
        Pose {
            position: self.position.map(JetScalar::value),
            orientation: self.orientation.map(JetScalar::value),
        }
    }
}

/// Derivatives by s of position and orientation along a path; rotation about axes of the base frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlacementDerivatives {
    /// x', x'', x''' of the origin: m, m, m per unit of s, its square, its cube.
    pub linear: [Vector; 3],
    /// ω, ω', ω'': angular velocity by s and its derivatives, rad.
    pub angular: [Vector; 3],
}

impl Placement<Jet> {
    /// The derivatives of position and orientation as vectors.
    #[must_use]
    pub fn rates(&self) -> PlacementDerivatives {
        let linear = [1, 2, 3].map(|order| self.position.map(|x| x.derivative(order)));
        let [q, q1, q2, q3] =
            [0, 1, 2, 3].map(|order| self.orientation.map(|x| x.derivative(order)));
        // ω = 2 q' q*, and q' q'* has no vector part.
        let spin = |a: Quaternion, b: Quaternion| {
            let [x, y, z, _] = jet::product(a, jet::conjugate(b));
            [2.0 * x, 2.0 * y, 2.0 * z]
        };
        let third = rcc_core::vector::add(spin(q3, q), spin(q2, q1));
        PlacementDerivatives {
            linear,
            angular: [spin(q1, q), spin(q2, q), third],
        }
    }
}

/// Rotation angle of a quaternion of either sign, rad in [0, π].
fn angle_of(turn: Quaternion) -> f64 {
    rcc_core::vector::norm(rcc_core::rotation::log(turn))
}

fn finite(pose: &Pose) -> Result<(), GeometryError> {
    if pose.is_finite() {
        Ok(())
    } else {
        Err(GeometryError::NotFinite)
    }
}

#[cfg(test)]
mod tests;
