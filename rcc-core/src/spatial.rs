//! Twists and wrenches: change of reference point and frame, and integration of a twist to the next pose and back. Pure
//! mathematics without allocation or panic; used by the loader and by the real-time thread.
//!
//! A twist is the velocity of a reference point of a body and the body's angular velocity, a wrench a force and the torque
//! about a reference point, both in axes of one frame. Lynch & Park, "Modern Robotics", 2017, sections 3.3.2 and 3.4; the
//! linear part comes first here and second there.

use crate::pose::Pose;
use crate::rotation;
use crate::vector::{self, Vector};

/// Two vectors `[x y z x y z]`: velocity and angular velocity, or force and torque.
pub type SpatialVector = [f64; 6];

/// Splits into the two vectors.
#[must_use]
pub fn split([a, b, c, d, e, f]: SpatialVector) -> (Vector, Vector) {
    ([a, b, c], [d, e, f])
}

/// Joins two vectors.
#[must_use]
pub fn join([a, b, c]: Vector, [d, e, f]: Vector) -> SpatialVector {
    [a, b, c, d, e, f]
}

/// Returns the twist of the same motion with the reference point shifted by `by`, same axes: v' = v + ω × by.
#[must_use]
pub fn shift_twist(twist: SpatialVector, by: Vector) -> SpatialVector {
    let (linear, angular) = split(twist);
    join(vector::add(linear, vector::cross(angular, by)), angular)
}

/// Returns the wrench of the same load with the reference point shifted by `by`, same axes: t' = t − by × f.
#[must_use]
pub fn shift_wrench(wrench: SpatialVector, by: Vector) -> SpatialVector {
    let (force, torque) = split(wrench);
    join(force, vector::subtract(torque, vector::cross(by, force)))
}

/// Transforms a twist in axes and with the origin of B to axes and the origin of A, for the pose of B in A: the
/// adjoint.
#[must_use]
pub fn transform_twist(pose: &Pose, twist: SpatialVector) -> SpatialVector {
    shift_twist(turn(pose, twist), vector::scale(pose.position, -1.0))
}

/// Transforms a wrench in axes and about the origin of B to axes and the origin of A, for the pose of B in A.
#[must_use]
pub fn transform_wrench(pose: &Pose, wrench: SpatialVector) -> SpatialVector {
    shift_wrench(turn(pose, wrench), vector::scale(pose.position, -1.0))
}

/// Returns the pose after `time_s` of a constant twist in axes of the outer frame, with the pose's origin as reference
/// point: the origin moves on a straight line, the orientation by the exponential map.
#[must_use]
pub fn integrate(pose: &Pose, twist: SpatialVector, time_s: f64) -> Pose {
    let (linear, angular) = split(twist);
    let turn = rotation::exp(vector::scale(angular, time_s));
    Pose {
        position: vector::add(pose.position, vector::scale(linear, time_s)),
        orientation: rotation::product(turn, pose.orientation),
    }
}

/// Returns the constant twist that leads from `previous` to `pose` in `time_s`, as used by [`integrate`]; by the
/// shorter rotation.
#[must_use]
pub fn difference(previous: &Pose, pose: &Pose, time_s: f64) -> SpatialVector {
    let translation = vector::subtract(pose.position, previous.position);
    let turn = rotation::error(previous.orientation, pose.orientation);
    join(translation, turn).map(|element| element / time_s)
}

/// Rotates both vectors to axes of the outer frame, same reference point.
fn turn(pose: &Pose, six: SpatialVector) -> SpatialVector {
    let (a, b) = split(six);
    join(
        rotation::rotate(pose.orientation, a),
        rotation::rotate(pose.orientation, b),
    )
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use proptest::prelude::*;

    fn far(a: SpatialVector, b: SpatialVector) -> f64 {
        a.iter()
            .zip(b)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max)
    }

    fn power(twist: SpatialVector, wrench: SpatialVector) -> f64 {
        twist.iter().zip(wrench).map(|(v, f)| v * f).sum()
    }

    fn any_pose() -> impl Strategy<Value = Pose> {
        (
            prop::array::uniform3(-2.0..2.0f64),
            prop::array::uniform3(-3.1..3.1f64),
        )
            .prop_map(|(xyz, rpy)| Pose::from_xyz_rpy(xyz, rpy))
    }

    fn any_six() -> impl Strategy<Value = SpatialVector> {
        prop::array::uniform6(-5.0..5.0f64)
    }

    /// Returns the position after `time_s` of the body point that is at `point` now.
    fn carried(twist: SpatialVector, point: Vector, time_s: f64) -> Vector {
        let (linear, angular) = split(twist);
        let turn = rotation::exp(vector::scale(angular, time_s));
        vector::add(rotation::rotate(turn, point), vector::scale(linear, time_s))
    }

    proptest! {
        #[test]
        fn the_power_does_not_depend_on_reference_point_or_frame(
            pose in any_pose(), twist in any_six(), wrench in any_six(), by in prop::array::uniform3(-2.0..2.0f64),
        ) {
            let watts = power(twist, wrench);
            let shifted = power(shift_twist(twist, by), shift_wrench(wrench, by));
            prop_assert!((shifted - watts).abs() < 1e-11);
            let transformed = power(transform_twist(&pose, twist), transform_wrench(&pose, wrench));
            prop_assert!((transformed - watts).abs() < 1e-11);
        }

        #[test]
        fn a_shifted_twist_is_the_velocity_of_that_point(twist in any_six(), by in prop::array::uniform3(-2.0..2.0f64)) {
            let h = 1e-6;
            let (after, before) = (carried(twist, by, h), carried(twist, by, -h));
            let (velocity, _) = split(shift_twist(twist, by));
            let measured = vector::scale(vector::subtract(after, before), 0.5 / h);
            prop_assert!(vector::norm(vector::subtract(measured, velocity)) < 1e-7);
        }

        #[test]
        fn a_transformed_twist_moves_the_body_the_same_way(pose in any_pose(), twist in any_six()) {
            // The body frame C moves in B by the twist about B's origin; seen from A it moves by the transformed twist.
            let h = 1e-6;
            let body = Pose::from_xyz_rpy([0.3, -0.2, 0.5], [0.4, 0.1, -0.7]);
            let moved = |twist: SpatialVector, body: &Pose, time: f64| {
                let (_, angular) = split(twist);
                let turn = rotation::exp(vector::scale(angular, time));
                Pose {
                    position: carried(twist, body.position, time),
                    orientation: rotation::product(turn, body.orientation),
                }
            };
            let inside = pose.compose(&moved(twist, &body, h));
            let outside = moved(transform_twist(&pose, twist), &pose.compose(&body), h);
            prop_assert!(inside.distance_to(&outside) < 1e-9);
            prop_assert!(vector::norm(rotation::error(inside.orientation, outside.orientation)) < 1e-9);
        }

        #[test]
        fn transforming_there_and_back_gives_the_same_vector(pose in any_pose(), six in any_six(), by in prop::array::uniform3(-2.0..2.0f64)) {
            let back = vector::scale(by, -1.0);
            prop_assert!(far(shift_twist(shift_twist(six, by), back), six) < 1e-13);
            prop_assert!(far(shift_wrench(shift_wrench(six, by), back), six) < 1e-13);
            let inverse = pose.inverse();
            prop_assert!(far(transform_twist(&inverse, transform_twist(&pose, six)), six) < 1e-12);
            prop_assert!(far(transform_wrench(&inverse, transform_wrench(&pose, six)), six) < 1e-12);
        }

        #[test]
        fn the_difference_of_an_integrated_pose_is_its_twist(pose in any_pose(), twist in any_six()) {
            for time in [1e-3, 0.1, 0.3] {
                let next = integrate(&pose, twist, time);
                prop_assert!(far(difference(&pose, &next, time), twist) < 1e-14 / time * 10.0);
            }
        }
    }
}
