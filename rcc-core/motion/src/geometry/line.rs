//! Straight lines: of the flange (with a turn at constant rate about one axis), and of the joints (PTP).
//! Evaluated by the real-time thread; plain numbers.

use rcc_core::message::Joints;
use rcc_core::pose::Pose;
use rcc_core::rotation::{self, Quaternion};
use rcc_core::vector::{self, Vector};

use super::jet::{self, Scalar};
use super::{GeometryError, LENGTH_MIN, PathMetric, Placement, angle_of, finite};

/// Below this cosine of half the angle a turn is half a turn.
const HALF_TURN_COSINE: f64 = 1e-9;

/// A turn from one orientation to another by the short way about one axis (slerp).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisRotation {
    from: Quaternion,
    axis: Vector,
    /// rad, in [0, π).
    pub angle: f64,
}

impl AxisRotation {
    /// No turn.
    #[must_use]
    pub fn none(from: Quaternion) -> Self {
        Self {
            from,
            axis: [0.0, 0.0, 1.0],
            angle: 0.0,
        }
    }

    /// About an axis (of length one, outer frame) by an angle (rad, any).
    #[must_use]
    pub fn about(from: Quaternion, axis: Vector, angle: f64) -> Self {
        Self { from, axis, angle }
    }

    /// From one orientation to another one.
    ///
    /// # Errors
    /// They are half a turn apart.
    pub fn between(from: Quaternion, to: Quaternion) -> Result<Self, GeometryError> {
        let turn = rotation::canonical(rotation::product(to, rotation::inverse(from)));
        if turn[3] < HALF_TURN_COSINE {
            return Err(GeometryError::HalfTurn);
        }
        let (axis, angle) = rotation::to_axis_angle(turn);
        Ok(Self { from, axis, angle })
    }

    /// The orientation after a fraction of the turn.
    #[inline]
    pub fn at<T: Scalar>(&self, fraction: T) -> [T; 4] {
        let from = self.from.map(T::constant);
        jet::product(jet::turn(self.axis, fraction.scaled(self.angle)), from)
    }
}

/// A straight line of the flange.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    from: Vector,
    to: Vector,
    turn: AxisRotation,
    length: f64,
}

impl Line {
    /// From pose to pose.
    ///
    /// # Errors
    /// They are half a turn apart, or not finite.
    pub fn new(from: &Pose, to: &Pose, metric: PathMetric) -> Result<Self, GeometryError> {
        finite(from)?;
        finite(to)?;
        let turn = AxisRotation::between(from.orientation, to.orientation)?;
        Ok(Self {
            from: from.position,
            to: to.position,
            turn,
            length: metric.length(from.distance_to(to), turn.angle),
        })
    }

    /// Length in s (≥ 0).
    #[must_use]
    pub fn length(&self) -> f64 {
        self.length
    }

    /// Makes it at least so long in s.
    pub fn extend_to(&mut self, length: f64) {
        self.length = self.length.max(length);
    }

    /// It leads somewhere, or turns.
    #[must_use]
    pub fn moves(&self) -> bool {
        distance(self.from, self.to) > LENGTH_MIN || self.turn.angle > LENGTH_MIN
    }

    /// Metres of way per unit of s.
    #[must_use]
    pub fn speed(&self) -> f64 {
        if self.length > 0.0 {
            distance(self.from, self.to) / self.length
        } else {
            0.0
        }
    }

    /// Where the flange is.
    #[inline]
    pub fn at<T: Scalar>(&self, s: T) -> Placement<T> {
        let fraction = if self.length > 0.0 {
            s.over(self.length)
        } else {
            T::constant(0.0)
        };
        let rest = T::constant(1.0) - fraction;
        let [x, y, z] = self.from.map(|x| rest.scaled(x));
        let [u, v, w] = self.to.map(|x| fraction.scaled(x));
        Placement {
            position: [x + u, y + v, z + w],
            orientation: self.turn.at(fraction),
        }
    }
}

/// A straight line of the joints.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointLine {
    from: Joints,
    to: Joints,
    length: f64,
}

impl JointLine {
    /// From joints to joints (rad); the joint with the longest way gives the length, times `metres_per_rad`.
    ///
    /// # Errors
    /// A joint is not finite.
    pub fn new(from: &Joints, to: &Joints, metres_per_rad: f64) -> Result<Self, GeometryError> {
        let ways = from.iter().zip(to).map(|(from, to)| libm::fabs(to - from));
        if !ways.clone().all(f64::is_finite) {
            return Err(GeometryError::NotFinite);
        }
        let longest = ways.fold(0.0, f64::max);
        let length = if longest > super::LENGTH_MIN {
            longest * metres_per_rad
        } else {
            0.0
        };
        Ok(Self {
            from: *from,
            to: *to,
            length,
        })
    }

    /// Length in s (≥ 0).
    #[must_use]
    pub fn length(&self) -> f64 {
        self.length
    }

    /// Where the joints are.
    #[inline]
    pub fn at<T: Scalar>(&self, s: T) -> [T; 8] {
        let fraction = if self.length > 0.0 {
            s.over(self.length)
        } else {
            T::constant(0.0)
        };
        let rest = T::constant(1.0) - fraction;
        let mut joints = [T::constant(0.0); 8];
        let ends = self.from.iter().zip(self.to);
        for (joint, (from, to)) in joints.iter_mut().zip(ends) {
            *joint = rest.scaled(*from) + fraction.scaled(to);
        }
        joints
    }
}

/// The angle between two orientations, rad in [0, π].
pub(super) fn angle_between(a: Quaternion, b: Quaternion) -> f64 {
    angle_of(rotation::product(b, rotation::inverse(a)))
}

/// The distance between two points.
pub(super) fn distance(a: Vector, b: Vector) -> f64 {
    vector::norm(vector::subtract(b, a))
}
