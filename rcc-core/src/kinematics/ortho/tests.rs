//! Properties of the ortho-parallel arm that hold for any joints: round trips, all branches, singularities, nulls.
//! Tests only; the golden data of independent programs is compared in `tests/kinematics.rs`.
#![allow(clippy::indexing_slicing, clippy::unwrap_used, clippy::expect_used)]

extern crate std;

use super::*;
use crate::testing::arms::KR6;
use core::f64::consts::{FRAC_PI_2, PI};
use proptest::prelude::*;

/// With all lengths nonzero and mirrored joints, unlike any real arm.
const ODD: OrthoParallelArm = OrthoParallelArm {
    lateral_offset: 0.11,
    elbow_offset: 0.07,
    signs: [1.0, -1.0, -1.0, 1.0, -1.0, 1.0],
    zeros: [0.3, -0.4, 0.5, 0.1, -0.2, 1.1],
    ..KR6
};

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

fn joints() -> impl Strategy<Value = [f64; 6]> {
    prop::array::uniform6(-3.1..3.1)
}

/// KUKA's transport position of an Agilus: upper arm upright, forearm forwards, wrist bent by 90°.
#[test]
fn the_well_known_position_has_the_status_that_kuka_shows() {
    let home = [0.0, -FRAC_PI_2, FRAC_PI_2, 0.0, 0.5, 0.0];
    assert_eq!(KR6.status(&home), 0b010);
    assert_eq!(
        KR6.status(&[0.0, -FRAC_PI_2, FRAC_PI_2, 0.0, -0.5, 0.0]),
        0b110
    );
    // Leaning back over axis 1, with the elbow bent the other way.
    assert_eq!(KR6.status(&[0.0, -2.4, 0.3, 0.0, 0.5, 0.0]), 0b011);
    assert_eq!(KR6.status(&[0.0, -1.0, -0.8, 0.0, 0.5, 0.0]), 0b000);
    // The stretched arm is at A3 = atan2(25, 420) = 3.4°, not at 0.
    let stretched = (0.025_f64).atan2(0.42);
    assert_eq!(
        KR6.status(&[0.0, -1.0, stretched - 1e-6, 0.0, 0.5, 0.0]) & 2,
        0
    );
    assert_eq!(
        KR6.status(&[0.0, -1.0, stretched + 1e-6, 0.0, 0.5, 0.0]) & 2,
        2
    );
}

#[test]
fn a_status_and_its_branch_round_trip() {
    for status in 0..8 {
        let branch = KR6.branch_of_status(status);
        assert_eq!(
            KR6.branch_of_status(status | 0b1000),
            branch,
            "bit 3 is not used"
        );
        let pose = KR6.forward(&[0.4, -1.3, 1.1, 0.7, 0.6, 0.2]);
        let found = KR6.inverse(&pose, branch, &[0.0; 6]).unwrap();
        assert_eq!(KR6.status(&found), status);
    }
}

#[test]
fn aligned_axes_take_the_free_angle_from_the_hint() {
    let straight = KR6.forward(&[0.4, -1.0, 0.9, 0.3, 0.0, 0.2]);
    let hint = [0.0, 0.0, 0.0, -0.7, 0.0, 0.0];
    let branch = KR6.branch(&[0.4, -1.0, 0.9, 0.3, 0.0, 0.2]);
    let found = KR6.inverse(&straight, branch, &hint).unwrap();
    assert_eq!(found[3], -0.7);
    assert!(pose_error(&KR6.forward(&found), &straight) < 1e-15);
    // The wrist on axis 1, with the arm leaning back: joint 1 is undetermined.
    let arm = OrthoParallelArm {
        shoulder_offset: 0.0,
        elbow_offset: 0.0,
        ..KR6
    };
    let upright = [0.4, -FRAC_PI_2, 0.0, 0.3, 0.5, 0.2];
    let above = arm.forward(&upright);
    let found = arm.inverse(
        &above,
        arm.branch(&upright),
        &[1.1, 0.0, 0.0, 0.0, 0.0, 0.0],
    );
    let found = found.unwrap();
    assert_eq!(found[0], 1.1);
    assert!(pose_error(&arm.forward(&found), &above) < 1e-12);
}

#[test]
fn poses_out_of_reach_are_refused_with_distance_and_reach() {
    let at = |position| Pose {
        position,
        ..Pose::IDENTITY
    };
    let refusal = KR6.inverse(&at([2.0, 0.0, 0.4]), Branch::default(), &[0.0; 6]);
    assert!(
        matches!(refusal, Err(Unreachable::TooFar { .. })),
        "{refusal:?}"
    );
    let inside = KR6.inverse(&at([0.03, 0.0, 0.49]), Branch::default(), &[0.0; 6]);
    assert!(
        matches!(inside, Err(Unreachable::TooClose { .. })),
        "{inside:?}"
    );
    let beside = ODD.inverse(&at([0.02, 0.0, 0.9]), Branch::default(), &[0.0; 6]);
    assert!(
        matches!(beside, Err(Unreachable::TooClose { reach: 0.11, .. })),
        "{beside:?}"
    );
    let null = KR6.inverse(&Pose::NULL, Branch::default(), &[0.0; 6]);
    assert_eq!(null, Err(Unreachable::NotFinite));
    let straight = KR6.forward(&[0.4, -1.0, 0.9, 0.3, 0.0, 0.2]);
    let hint = KR6.inverse(
        &straight,
        KR6.branch(&[0.4, -1.0, 0.9, 0.3, 0.0, 0.2]),
        &[f64::NAN; 6],
    );
    assert_eq!(hint, Err(Unreachable::NotFinite));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    /// Bit 0 of `which`: the wrist is straight; bit 1: the arm is stretched; bit 2: the wrist is on axis 1.
    #[test]
    fn the_hint_is_the_answer_where_it_reaches_the_pose(
        q in joints(),
        tiny in prop::option::of(-17.0..-4.0f64),
        which in 0..8usize,
        odd in any::<bool>(),
    ) {
        let arm = match (odd, which >> 2) {
            (true, 0) => ODD,
            (_, 0) => KR6,
            _ => OrthoParallelArm { shoulder_offset: 0.0, ..KR6 },
        };
        let beside = tiny.map_or(0.0, |tiny| 10f64.powf(tiny));
        let mut canonical = arm.canonical(&q);
        if which & 1 == 1 {
            canonical[4] = beside;
        }
        if which & 2 == 2 {
            canonical[2] = beside - arm.elbow_offset.atan2(arm.forearm);
        }
        if which & 4 == 4 {
            // Turns the upper arm until the wrist is above axis 2, which is on axis 1.
            let (forward, up) = arm.wrist_in_plane(0.0, canonical[2]);
            canonical[1] = beside - forward.atan2(up);
        }
        let q = arm.joints(&canonical);
        let found = arm.inverse(&arm.forward(&q), arm.branch(&q), &q);
        // The folded arm ends at axis 2.
        prop_assume!(found.is_ok() || which & 4 == 4);
        let found = found.unwrap_or(q);
        prop_assert!(q.iter().zip(found).all(|(a, b)| turn(*a, b) < 1e-9), "{q:?} {found:?}");
    }

    #[test]
    fn the_branch_of_a_position_leads_back_to_it(q in joints(), odd in any::<bool>()) {
        let arm = if odd { ODD } else { KR6 };
        let pose = arm.forward(&q);
        let found = arm.inverse(&pose, arm.branch(&q), &q).unwrap();
        prop_assert!(pose_error(&arm.forward(&found), &pose) < 1e-13, "{q:?} {found:?}");
        prop_assume!(arm.singularity(&q).distance > 0.02);
        prop_assert!(q.iter().zip(found).all(|(a, b)| turn(*a, b) < 1e-9), "{q:?} {found:?}");
    }

    #[test]
    fn every_existing_branch_reaches_the_pose(q in joints(), odd in any::<bool>()) {
        let arm = if odd { ODD } else { KR6 };
        let pose = arm.forward(&q);
        let mut there = 0;
        for branch in Branch::all() {
            let Ok(found) = arm.inverse(&pose, branch, &q) else { continue };
            there += 1;
            prop_assert!(pose_error(&arm.forward(&found), &pose) < 1e-13);
            prop_assume!(arm.singularity(&found).distance > 1e-6);
            prop_assert_eq!(arm.branch(&found), branch);
        }
        prop_assert!(there >= 4 && there % 2 == 0, "{there} branches");
    }

    #[test]
    fn next_to_a_singularity_the_pose_stays_true(
        q in joints(), tiny in -13.0..-3.0f64, which in 1..8usize, odd in any::<bool>()
    ) {
        let arm = if odd { ODD } else { KR6 };
        let tiny = 10f64.powf(tiny);
        let mut theta = arm.canonical(&q);
        if which & 1 == 1 {
            theta[4] = tiny;
        }
        if which & 2 == 2 {
            theta[2] = tiny - arm.elbow_offset.atan2(arm.forearm);
        }
        // (With a lateral offset, a stretched arm near axis 1 loses half of the digits of the reach.)
        if which & 4 == 4 && !(odd && which & 2 == 2) {
            // Rotating the whole arm about axis 2 moves the wrist above axis 1.
            let (x, z) = arm.wrist_in_plane(theta[1], theta[2]);
            let reach = x.hypot(z);
            theta[1] += (-arm.shoulder_offset / reach).asin() - x.atan2(z) + tiny;
        }
        let q = arm.joints(&theta);
        let pose = arm.forward(&q);
        let found = arm.inverse(&pose, arm.branch(&q), &q).unwrap();
        prop_assert!(pose_error(&arm.forward(&found), &pose) < 1e-12, "{q:?} {found:?}");
    }

    #[test]
    fn the_jacobian_is_the_derivative_of_the_pose(q in joints(), joint in 0..6usize) {
        let (h, mut before, mut after) = (1e-6, q, q);
        before[joint] -= h;
        after[joint] += h;
        let (before, after) = (ODD.forward(&before), ODD.forward(&after));
        let turned = before.rotation_vector_to(&after);
        let jacobian = ODD.jacobian(&q);
        for axis in 0..3 {
            let linear = (after.position[axis] - before.position[axis]) / (2.0 * h);
            prop_assert!((linear - jacobian[axis][joint]).abs() < 1e-8);
            prop_assert!((turned[axis] / (2.0 * h) - jacobian[axis + 3][joint]).abs() < 1e-8);
        }
    }

    #[test]
    fn no_number_makes_it_panic(
        slots in prop::array::uniform7(any::<f64>()),
        q in prop::array::uniform6(any::<f64>()),
        lengths in prop::array::uniform7(any::<f64>()),
        index in 0..8u8,
    ) {
        let branch = Branch::from_bits(index);
        let any = OrthoParallelArm::from_lengths(&lengths, KR6.signs, KR6.zeros);
        for arm in [KR6, any] {
            let _ = arm.inverse(&Pose::from_slots(slots), branch, &q);
            let _ = (arm.forward(&q), arm.jacobian(&q), arm.branch(&q), arm.singularity(&q));
        }
    }
}
