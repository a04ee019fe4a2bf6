//! Straight lines: of the flange (with a rotation at constant rate about one axis), and in joint space (PTP). Plain
//! numbers; evaluated by the real-time thread.

use rcc_core::message::Joints;
use rcc_core::pose::Pose;
use rcc_core::rotation::{self, Quaternion};
use rcc_core::vector::{self, Vector};

use super::jet::{self, JetScalar};
use super::{GeometryError, LENGTH_MIN, PathMetric, Placement, angle_of, finite};

/// If the cosine of half the angle is below this, the rotation is half a turn.
const HALF_TURN_COSINE: f64 = 1e-9;

/// A rotation from one orientation to another the shorter way about one axis (slerp).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisRotation {
    from: Quaternion,
    axis: Vector,
    /// Rotation angle, rad; in [0, π) between orientations, any value about a given axis.
    pub angle: f64,
}

impl AxisRotation {
    /// No rotation.
    #[must_use]
    pub fn none(from: Quaternion) -> Self {
        Self {
            from,
            axis: [0.0, 0.0, 1.0],
            angle: 0.0,
        }
    }

    /// A rotation about an axis (of length one, in the base frame) by an angle (rad, any).
    #[must_use]
    pub fn about(from: Quaternion, axis: Vector, angle: f64) -> Self {
        Self { from, axis, angle }
    }

    /// The rotation from one orientation to another.
    ///
    /// # Errors
    /// Returns [`GeometryError::HalfTurn`] if they differ by half a turn.
    pub fn between(from: Quaternion, to: Quaternion) -> Result<Self, GeometryError> {
        let turn = rotation::canonical(rotation::product(to, rotation::inverse(from)));
        if turn[3] < HALF_TURN_COSINE {
            return Err(GeometryError::HalfTurn);
        }
        let (axis, angle) = rotation::to_axis_angle(turn);
        Ok(Self { from, axis, angle })
    }

    /// The orientation at a fraction of the rotation.
    #[inline]
    pub fn at<T: JetScalar>(&self, fraction: T) -> [T; 4] {
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
    /// The line from pose to pose.
    ///
    /// # Errors
    /// Returns [`GeometryError`] if the orientations differ by half a turn, or a value is not finite.
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

    /// Extends the length in s to at least `length`.
    pub fn extend_to(&mut self, length: f64) {
        self.length = self.length.max(length);
    }

    /// Returns true if it translates or rotates.
    #[must_use]
    pub fn moves(&self) -> bool {
        distance(self.from, self.to) > LENGTH_MIN || self.turn.angle > LENGTH_MIN
    }

    /// Metres of the flange per unit of s.
    #[must_use]
    pub fn speed(&self) -> f64 {
        if self.length > 0.0 {
            distance(self.from, self.to) / self.length
        } else {
            0.0
        }
    }

    /// The pose at `s`.
    #[inline]
    pub fn at<T: JetScalar>(&self, s: T) -> Placement<T> {
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

/// A straight line in joint space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointLine {
    from: Joints,
    to: Joints,
    length: f64,
}

impl JointLine {
    /// The line from joints to joints (rad). Its length is that of the joint with the longest way, times
    /// `metres_per_rad`.
    ///
    /// # Errors
    /// Returns [`GeometryError::NotFinite`] if a joint is not finite.
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

    /// The joints at `s`, rad.
    #[inline]
    pub fn at<T: JetScalar>(&self, s: T) -> [T; 8] {
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

/// The distance between two points, m.
pub(super) fn distance(a: Vector, b: Vector) -> f64 {
    vector::norm(vector::subtract(b, a))
}
