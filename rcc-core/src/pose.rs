//! Position and orientation of one frame in another, and the operations that the cycle needs. Pure mathematics without
//! allocation or panic; used by the loader and by the real-time thread.

use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};

/// Two orientations with a half-angle cosine below this are 180° apart: the rotation between them is undefined.
const HALF_TURN_COSINE: f64 = 1e-9;

/// The pose of an inner frame in an outer one: x_outer = R · x_inner + position.
///
/// A pose that contains NaN is null. No operation panics; NaN in any used element gives NaN in everything that depends
/// on it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Origin of the inner frame in axes of the outer one, m, `[x y z]`.
    pub position: [f64; 3],
    /// Orientation as a unit quaternion `[x y z w]`; q and −q are the same orientation.
    pub orientation: [f64; 4],
}

impl Pose {
    /// The identity: both frames coincide.
    pub const IDENTITY: Self = Self {
        position: [0.0; 3],
        orientation: [0.0, 0.0, 0.0, 1.0],
    };

    /// Null: NaN in every element.
    pub const NULL: Self = Self {
        position: [f64::NAN; 3],
        orientation: [f64::NAN; 4],
    };

    /// Creates a pose from a position (m) and roll, pitch, yaw (rad) about the fixed axes x, y, z: R =
    /// Rz(yaw)·Ry(pitch)·Rx(roll).
    #[must_use]
    pub fn from_xyz_rpy(position: [f64; 3], [roll, pitch, yaw]: [f64; 3]) -> Self {
        Self::new(
            position,
            UnitQuaternion::from_euler_angles(roll, pitch, yaw),
        )
    }

    /// Creates a pose from a position (m) and a rotation matrix (row-major, orthonormal, inner → outer). The quaternion
    /// has w ≥ 0.
    #[must_use]
    pub fn from_rotation_matrix(position: [f64; 3], rotation: &[[f64; 3]; 3]) -> Self {
        let [[a, b, c], [d, e, f], [g, h, i]] = *rotation;
        let matrix = Rotation3::from_matrix_unchecked(Matrix3::new(a, b, c, d, e, f, g, h, i));
        let quaternion = UnitQuaternion::from_rotation_matrix(&matrix).into_inner();
        let short = if quaternion.w < 0.0 {
            -quaternion
        } else {
            quaternion
        };
        Self::new(position, UnitQuaternion::new_normalize(short))
    }

    /// Returns the orientation as a rotation matrix (row-major, inner → outer).
    #[must_use]
    pub fn rotation_matrix(&self) -> [[f64; 3]; 3] {
        let r = self.unit_quaternion().to_rotation_matrix();
        let m = r.matrix();
        [
            [m.m11, m.m12, m.m13],
            [m.m21, m.m22, m.m23],
            [m.m31, m.m32, m.m33],
        ]
    }

    /// Transforms a vector from axes of the inner frame to axes of the outer one (rotation only).
    #[must_use]
    pub fn rotate(&self, vector: [f64; 3]) -> [f64; 3] {
        (self.unit_quaternion() * Vector3::from(vector)).into()
    }

    /// Composes two poses: `inner` is given in the inner frame of `self`, the result in its outer frame.
    #[must_use]
    pub fn compose(&self, inner: &Self) -> Self {
        let moved = Vector3::from(self.position) + Vector3::from(self.rotate(inner.position));
        let product = self.quaternion() * inner.quaternion();
        Self::new(moved.into(), UnitQuaternion::new_normalize(product))
    }

    /// Returns the pose of the outer frame in the inner one.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let back = self.unit_quaternion().inverse();
        Self::new((-(back * Vector3::from(self.position))).into(), back)
    }

    /// Interpolates between `self` (fraction 0) and `to` (fraction 1): the position on a straight line, the orientation
    /// by the shorter rotation about one fixed axis at a constant rate. `None` if the orientations are 180° apart,
    /// because then the axis is undetermined.
    #[must_use]
    pub fn slerp(&self, to: &Self, fraction: f64) -> Option<Self> {
        let from_orientation = self.quaternion();
        let cosine = from_orientation.dot(&to.quaternion());
        if libm::fabs(cosine) < HALF_TURN_COSINE {
            return None;
        }
        let to_orientation = if cosine < 0.0 {
            -to.quaternion()
        } else {
            to.quaternion()
        };
        let (difference, sum) = (
            to_orientation - from_orientation,
            to_orientation + from_orientation,
        );
        let half_angle = 2.0 * libm::atan2(difference.norm(), sum.norm());
        let sine = libm::sin(half_angle);
        let rest = 1.0 - fraction;
        let (from_weight, to_weight) = if sine > 1e-8 {
            (
                libm::sin(rest * half_angle) / sine,
                libm::sin(fraction * half_angle) / sine,
            )
        } else {
            (rest, fraction)
        };
        let orientation = from_orientation * from_weight + to_orientation * to_weight;
        let position = Vector3::from(self.position) * rest + Vector3::from(to.position) * fraction;
        Some(Self::new(
            position.into(),
            UnitQuaternion::new_normalize(orientation),
        ))
    }

    /// Returns the smallest angle that rotates this orientation into the other one, rad, in [0, π].
    #[must_use]
    pub fn angle_to(&self, other: &Self) -> f64 {
        let turn = other.quaternion() * self.quaternion().conjugate();
        2.0 * libm::atan2(turn.imag().norm(), libm::fabs(turn.w))
    }

    /// Returns the rotation from this orientation to the other one, as axis × angle in axes of the outer frame, rad;
    /// its length is `angle_to`. At 180° one of the two axes is returned.
    #[must_use]
    pub fn rotation_vector_to(&self, other: &Self) -> [f64; 3] {
        let turn = other.quaternion() * self.quaternion().conjugate();
        let turn = if turn.w < 0.0 { -turn } else { turn };
        let sine = turn.imag().norm();
        let scale = if sine > 1e-150 {
            2.0 * libm::atan2(sine, turn.w) / sine
        } else {
            2.0 / turn.w
        };
        (turn.imag() * scale).into()
    }

    /// Returns the distance between the two origins, m.
    #[must_use]
    pub fn distance_to(&self, other: &Self) -> f64 {
        (Vector3::from(other.position) - Vector3::from(self.position)).norm()
    }

    /// Returns true if every element is finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.to_slots().iter().all(|element| element.is_finite())
    }

    /// Returns the seven elements `[x y z qx qy qz qw]`.
    #[must_use]
    pub fn to_slots(&self) -> [f64; 7] {
        let ([x, y, z], [qx, qy, qz, qw]) = (self.position, self.orientation);
        [x, y, z, qx, qy, qz, qw]
    }

    /// Creates a pose from the seven elements `[x y z qx qy qz qw]`; the quaternion is used as it is and must be
    /// normalized.
    #[must_use]
    pub fn from_slots([x, y, z, qx, qy, qz, qw]: [f64; 7]) -> Self {
        Self {
            position: [x, y, z],
            orientation: [qx, qy, qz, qw],
        }
    }

    fn new(position: [f64; 3], orientation: UnitQuaternion<f64>) -> Self {
        Self {
            position,
            orientation: orientation.into_inner().coords.into(),
        }
    }

    fn quaternion(&self) -> Quaternion<f64> {
        Quaternion::from(self.orientation)
    }

    fn unit_quaternion(&self) -> UnitQuaternion<f64> {
        UnitQuaternion::new_unchecked(self.quaternion())
    }
}

#[cfg(test)]
#[allow(clippy::indexing_slicing, clippy::unwrap_used, clippy::expect_used)]
mod tests {
    extern crate std;
    use super::*;
    use core::f64::consts::{FRAC_PI_2, PI};
    use proptest::prelude::*;

    fn near(a: &Pose, b: &Pose, tolerance: f64) -> bool {
        a.distance_to(b) <= tolerance && a.angle_to(b) <= tolerance
    }

    fn any_pose() -> impl Strategy<Value = Pose> {
        (
            prop::array::uniform3(-2.0..2.0),
            prop::array::uniform3(-3.1..3.1),
        )
            .prop_map(|(xyz, rpy)| Pose::from_xyz_rpy(xyz, rpy))
    }

    #[test]
    fn roll_pitch_yaw_turn_about_fixed_axes_in_that_order() {
        let pose = Pose::from_xyz_rpy([0.0; 3], [FRAC_PI_2, 0.0, FRAC_PI_2]);
        // Roll takes y to z, and yaw leaves z alone.
        let turned = pose.rotate([0.0, 1.0, 0.0]);
        assert!(
            turned
                .iter()
                .zip([0.0, 0.0, 1.0])
                .all(|(a, b)| (a - b).abs() < 1e-15),
            "{turned:?}"
        );
    }

    #[test]
    fn composing_moves_the_inner_position_by_the_outer_orientation() {
        let outer = Pose::from_xyz_rpy([1.0, 0.0, 0.0], [0.0, 0.0, FRAC_PI_2]);
        let inner = Pose::from_xyz_rpy([0.5, 0.0, 0.0], [0.0; 3]);
        let expected = Pose::from_xyz_rpy([1.0, 0.5, 0.0], [0.0, 0.0, FRAC_PI_2]);
        assert!(near(&outer.compose(&inner), &expected, 1e-15));
    }

    #[test]
    fn orientations_180_degrees_apart_have_no_interpolation() {
        let turned = Pose::from_xyz_rpy([0.0; 3], [0.0, PI, 0.0]);
        assert_eq!(Pose::IDENTITY.slerp(&turned, 0.5), None);
        assert!((Pose::IDENTITY.angle_to(&turned) - PI).abs() < 1e-15);
    }

    #[test]
    fn null_propagates_through_every_operation() {
        let (null, pose) = (
            Pose::NULL,
            Pose::from_xyz_rpy([1.0, 2.0, 3.0], [0.1, 0.2, 0.3]),
        );
        assert!(!null.is_finite() && pose.is_finite());
        for result in [null.compose(&pose), pose.compose(&null), null.inverse()] {
            assert!(result.to_slots().iter().all(|x| x.is_nan()));
        }
        assert!(pose.slerp(&null, 0.5).unwrap().orientation[3].is_nan());
        assert!(pose.slerp(&pose, f64::NAN).unwrap().position[0].is_nan());
        assert!(pose.angle_to(&null).is_nan());
        assert!(pose.rotation_vector_to(&null)[0].is_nan());
        assert!(null.rotation_matrix()[0][0].is_nan());
        assert!(Pose::from_rotation_matrix([0.0; 3], &[[f64::NAN; 3]; 3]).orientation[0].is_nan());
    }

    proptest! {
        #[test]
        fn a_pose_and_its_inverse_cancel(pose in any_pose()) {
            prop_assert!(near(&pose.compose(&pose.inverse()), &Pose::IDENTITY, 1e-14));
        }

        #[test]
        fn the_rotation_matrix_gives_the_pose_back(pose in any_pose()) {
            let back = Pose::from_rotation_matrix(pose.position, &pose.rotation_matrix());
            prop_assert!(near(&pose, &back, 1e-14));
            prop_assert!(back.orientation[3] >= 0.0);
        }

        #[test]
        fn slots_give_the_pose_back(pose in any_pose()) {
            prop_assert_eq!(Pose::from_slots(pose.to_slots()), pose);
        }

        #[test]
        fn interpolation_starts_and_ends_exactly_and_is_uniform(a in any_pose(), b in any_pose(), t in 0.0..1.0f64) {
            prop_assume!(a.angle_to(&b) < PI - 1e-6);
            prop_assert!(near(&a.slerp(&b, 0.0).unwrap(), &a, 1e-15));
            prop_assert!(near(&a.slerp(&b, 1.0).unwrap(), &b, 1e-15));
            let between = a.slerp(&b, t).unwrap();
            prop_assert!((a.angle_to(&between) - t * a.angle_to(&b)).abs() < 1e-9);
            prop_assert!((a.distance_to(&between) - t * a.distance_to(&b)).abs() < 1e-14);
        }

        #[test]
        fn interpolation_does_not_depend_on_the_sign_of_the_quaternion(a in any_pose(), b in any_pose()) {
            prop_assume!(a.angle_to(&b) < PI - 1e-6);
            let same = Pose { orientation: b.orientation.map(|x| -x), ..b };
            prop_assert!(near(&a.slerp(&b, 0.3).unwrap(), &a.slerp(&same, 0.3).unwrap(), 1e-14));
        }

        #[test]
        fn the_rotation_vector_turns_one_orientation_into_the_other(a in any_pose(), b in any_pose()) {
            let vector = Vector3::from(a.rotation_vector_to(&b));
            prop_assert!((vector.norm() - a.angle_to(&b)).abs() < 1e-14);
            let turned = UnitQuaternion::from_scaled_axis(vector) * a.unit_quaternion();
            prop_assert!(Pose::new(b.position, turned).angle_to(&b) < 1e-13);
        }

        #[test]
        fn no_number_makes_it_panic(x in prop::array::uniform7(any::<f64>()), y in prop::array::uniform7(any::<f64>())) {
            let (a, b) = (Pose::from_slots(x), Pose::from_slots(y));
            let results = (a.compose(&b), a.inverse(), a.slerp(&b, 0.5), a.angle_to(&b), a.rotation_vector_to(&b));
            std::hint::black_box((results, a.rotation_matrix(), a.rotate([1.0, 2.0, 3.0])));
        }
    }
}
