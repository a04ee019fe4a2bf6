//! Properties of the S-R-S arm that hold for any joints: round trips, branches, singularities, nulls. Tests only; the
//! golden data of independent programs is compared in `tests/kinematics.rs`.
#![allow(clippy::indexing_slicing, clippy::unwrap_used, clippy::expect_used)]

extern crate std;

use super::*;
use crate::testing::arms::{IIWA, LWR};
use core::f64::consts::PI;
use proptest::prelude::*;
use std::string::ToString;

fn pose_error(a: &Pose, b: &Pose) -> f64 {
    let turned = a
        .rotation_matrix()
        .into_iter()
        .flatten()
        .zip(b.rotation_matrix().into_iter().flatten());
    let moved = a.position.into_iter().zip(b.position);
    turned
        .chain(moved)
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f64::max)
}

fn turn(a: f64, b: f64) -> f64 {
    let difference = (a - b).rem_euclid(2.0 * PI);
    difference.min(2.0 * PI - difference)
}

fn joints() -> impl Strategy<Value = [f64; 7]> {
    prop::array::uniform7(-3.1..3.1)
}

#[test]
fn a_branch_and_its_number_round_trip() {
    for index in 0..8 {
        assert_eq!(Branch::from_index(index).unwrap().index(), index);
    }
    assert_eq!(Branch::from_index(8), None);
}

#[test]
fn the_stretched_arm_takes_the_free_angles_from_the_hint() {
    let stretched = LWR.forward(&[0.0; 7]);
    let hint = [0.4, 0.0, 0.0, 0.0, -0.7, 0.0, 0.0];
    let found = LWR
        .inverse(&stretched, 0.0, Branch::default(), &hint)
        .unwrap();
    assert_eq!((found[0], found[4]), (0.4, -0.7));
    assert!(pose_error(&LWR.forward(&found), &stretched) < 1e-15);
}

#[test]
fn poses_out_of_reach_are_refused_with_distance_and_reach() {
    let far = Pose {
        position: [2.0, 0.0, 0.3105],
        ..Pose::IDENTITY
    };
    let refusal = LWR
        .inverse(&far, 0.0, Branch::default(), &[0.0; 7])
        .unwrap_err();
    assert!(
        matches!(refusal, Unreachable::TooFar { reach: 0.79, .. }),
        "{refusal:?}"
    );
    assert!(
        refusal.to_string().contains("the arm reaches 0.7900 m"),
        "{refusal}"
    );
    let close = Pose {
        position: [0.005, 0.0, 0.3105 + 0.078],
        ..Pose::IDENTITY
    };
    let refusal = LWR
        .inverse(&close, 0.0, Branch::default(), &[0.0; 7])
        .unwrap_err();
    assert!(
        matches!(refusal, Unreachable::TooClose { .. }),
        "{refusal:?}"
    );
}

#[test]
fn null_is_refused_and_propagates_through_the_forward_functions() {
    let null = [f64::NAN; 7];
    let good = LWR.forward(&[0.5; 7]);
    let hint = [0.5; 7];
    assert_eq!(
        LWR.inverse(&Pose::NULL, 0.0, Branch::default(), &hint),
        Err(Unreachable::NotFinite)
    );
    assert_eq!(
        LWR.inverse(&good, f64::NAN, Branch::default(), &hint),
        Err(Unreachable::NotFinite)
    );
    let stretched = LWR.forward(&[0.0; 7]);
    assert_eq!(
        LWR.inverse(&stretched, 0.0, Branch::default(), &null),
        Err(Unreachable::NotFinite)
    );
    assert!(!LWR.forward(&null).is_finite());
    assert!(LWR.arm_angle(&null).is_nan());
    assert!(LWR.jacobian(&null)[0][0].is_nan());
}

#[test]
fn an_arm_without_lengths_does_not_panic() {
    let arm = SrsArm {
        upper_arm: 0.0,
        forearm: 0.0,
        ..LWR
    };
    assert!(
        arm.inverse(&Pose::IDENTITY, 0.0, Branch::default(), &[0.0; 7])
            .is_err()
    );
    let arm = SrsArm {
        upper_arm: f64::NAN,
        ..LWR
    };
    assert!(
        arm.inverse(&LWR.forward(&[0.5; 7]), 0.0, Branch::default(), &[0.0; 7])
            .is_err()
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn the_arm_angle_and_branch_of_a_position_lead_back_to_it(q in joints(), iiwa in any::<bool>()) {
        let arm = if iiwa { IIWA } else { LWR };
        let pose = arm.forward(&q);
        let found = arm.inverse(&pose, arm.arm_angle(&q), arm.branch(&q), &q).unwrap();
        prop_assert!(pose_error(&arm.forward(&found), &pose) < 1e-13);
        // Joints lose digits close to a singularity, poses do not.
        prop_assume!(q.iter().skip(1).step_by(2).all(|x| x.abs() > 0.01 && x.abs() < 3.0));
        prop_assert!(q.iter().zip(found).all(|(a, b)| turn(*a, b) < 1e-9), "{q:?} {found:?}");
    }

    #[test]
    fn every_branch_reaches_the_pose_with_any_arm_angle(q in joints(), angle in -3.1..3.1f64) {
        let pose = LWR.forward(&q);
        for branch in (0..8).filter_map(Branch::from_index) {
            let found = LWR.inverse(&pose, angle, branch, &q).unwrap();
            prop_assert!(pose_error(&LWR.forward(&found), &pose) < 1e-13);
            prop_assume!(found.iter().skip(1).step_by(2).all(|x| x.abs() > 1e-6 && x.abs() < 3.1));
            prop_assert_eq!(LWR.branch(&found), branch);
            prop_assert!(turn(LWR.arm_angle(&found), angle) < 1e-6);
        }
    }

    #[test]
    fn next_to_a_singularity_the_pose_stays_true(q in joints(), tiny in -12.0..-3.0f64, which in 1..8usize) {
        let mut q = q;
        for (bit, joint) in [1, 3, 5].into_iter().enumerate() {
            if which >> bit & 1 == 1 {
                q[joint] = 10f64.powf(tiny);
            }
        }
        let pose = LWR.forward(&q);
        let found = LWR.inverse(&pose, LWR.arm_angle(&q), LWR.branch(&q), &q).unwrap();
        prop_assert!(pose_error(&LWR.forward(&found), &pose) < 2e-12);
    }

    /// Bits 0 to 2 of `which`: joint 2, 4 and 6 are at 0, or next to it. Bit 3: the wrist is above the shoulder.
    #[test]
    fn the_hint_is_the_answer_where_it_reaches_the_pose(
        q in joints(),
        tiny in prop::option::of(-17.0..-4.0f64),
        which in 0..16usize,
        iiwa in any::<bool>(),
    ) {
        let arm = if iiwa { IIWA } else { LWR };
        let mut q = q;
        for (bit, joint) in [1, 3, 5].into_iter().enumerate() {
            if which >> bit & 1 == 1 {
                q[joint] = tiny.map_or(0.0, |tiny| 10f64.powf(tiny));
            }
        }
        if which >> 3 == 1 {
            q[2] = 0.0;
            let (sin4, cos4) = (q[3] * arm.signs[3]).sin_cos();
            let q2 = (-arm.forearm * sin4).atan2(arm.upper_arm + arm.forearm * cos4);
            q[1] = arm.signs[1] * q2;
        }
        let found = arm.inverse(&arm.forward(&q), arm.arm_angle(&q), arm.branch(&q), &q).unwrap();
        prop_assert!(q.iter().zip(found).all(|(a, b)| turn(*a, b) < 1e-9), "{q:?} {found:?}");
    }

    #[test]
    fn the_jacobian_is_the_derivative_of_the_pose(q in joints(), joint in 0..7usize) {
        let (h, mut before, mut after) = (1e-6, q, q);
        before[joint] -= h;
        after[joint] += h;
        let (before, after) = (LWR.forward(&before), LWR.forward(&after));
        let turned = before.rotation_vector_to(&after);
        let jacobian = LWR.jacobian(&q);
        for axis in 0..3 {
            let linear = (after.position[axis] - before.position[axis]) / (2.0 * h);
            prop_assert!((linear - jacobian[axis][joint]).abs() < 1e-8);
            prop_assert!((turned[axis] / (2.0 * h) - jacobian[axis + 3][joint]).abs() < 1e-8);
        }
    }

    #[test]
    fn no_number_makes_it_panic(
        slots in prop::array::uniform7(any::<f64>()),
        q in prop::array::uniform7(any::<f64>()),
        angle in any::<f64>(),
    ) {
        let pose = Pose::from_slots(slots);
        let inverse = LWR.inverse(&pose, angle, LWR.branch(&q), &q);
        std::hint::black_box((inverse.is_ok(), LWR.forward(&q), LWR.jacobian(&q), LWR.arm_angle(&q)));
    }
}
