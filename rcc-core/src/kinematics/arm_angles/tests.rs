//! Intervals of arm angles compared with sampling. Tests only.
#![allow(clippy::indexing_slicing, clippy::unwrap_used, clippy::expect_used)]

use super::*;
use crate::kinematics::OutOfLimits;
use crate::testing::arms::LWR;
use crate::testing::lwr;
use proptest::prelude::*;

const SAMPLES: usize = 80;

fn outside(
    arm: &SrsArm,
    pose: &Pose,
    angle: f64,
    branch: Branch,
    limits: &JointLimits,
) -> Option<OutOfLimits> {
    let [q1, q2, q3, q4, q5, q6, q7] = arm.inverse(pose, angle, branch, &[0.0; 7]).unwrap();
    within_limits(&[q1, q2, q3, q4, q5, q6, q7, 0.0], limits).err()
}

#[test]
fn without_limits_the_whole_circle_is_free() {
    let mut limits = lwr().limits;
    limits.lower = [-4.0; 8];
    limits.upper = [4.0; 8];
    let arm = LWR;
    let pose = arm.forward(&[0.3, 0.5, -0.2, -1.6, 0.1, 1.0, 0.4]);
    let branch = arm.branch(&[0.3, 0.5, -0.2, -1.6, 0.1, 1.0, 0.4]);
    let free = arm.arm_angles(&pose, branch, &limits).unwrap();
    let total: f64 = free
        .intervals()
        .iter()
        .map(|[lower, upper]| upper - lower)
        .sum();
    assert!((total - TAU).abs() < 1e-9, "{free:?}");
    let far = Pose::from_xyz_rpy([3.0, 0.0, 0.0], [0.0; 3]);
    assert!(arm.arm_angles(&far, branch, &limits).is_err());
}

#[test]
fn an_elbow_beyond_its_limit_leaves_no_interval() {
    let arm = LWR;
    let q = [0.3, 0.5, -0.2, -2.5, 0.1, 1.0, 0.4];
    let free = arm.arm_angles(&arm.forward(&q), arm.branch(&q), &lwr().limits);
    assert_eq!(free.unwrap().intervals(), &[] as &[[f64; 2]]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]

    #[test]
    fn an_arm_angle_is_in_an_interval_if_its_joints_are_within_their_limits(
        q in prop::array::uniform7(-2.0..2.0f64), index in 0..8u8, narrow in 0.3..1.0f64, shift in -0.4..0.4f64
    ) {
        let arm = LWR;
        let mut limits = lwr().limits;
        for limit in limits.lower.iter_mut().chain(&mut limits.upper) {
            *limit = *limit * narrow + shift;
        }
        let (pose, branch) = (arm.forward(&q), Branch::from_bits(index));
        let free = arm.arm_angles(&pose, branch, &limits).unwrap();
        for [lower, upper] in free.intervals() {
            prop_assert!(*lower > -PI - 1e-12 && *lower <= PI && upper > lower && upper - lower <= TAU + 1e-12);
        }
        for pair in free.intervals().windows(2) {
            prop_assert!(pair[0][1] < pair[1][0]);
        }
        for sample in 0..SAMPLES {
            let angle = TAU * (sample as f64 + 0.37) / SAMPLES as f64 - PI;
            let around = free.around(angle);
            let edge = free.intervals().iter().flatten().any(|edge| {
                let away = (angle - edge) - TAU * libm::rint((angle - edge) / TAU);
                away.abs() < 1e-7
            });
            prop_assume!(!edge);
            let outside = outside(&arm, &pose, angle, branch, &limits);
            prop_assert_eq!(around.is_some(), outside.is_none(), "{} {:?} {:?}", angle, outside, free);
            if let Some([lower, upper]) = around {
                prop_assert!(lower <= angle && angle <= upper);
            }
        }
    }

    #[test]
    fn no_number_makes_it_panic(
        slots in prop::array::uniform7(any::<f64>()), bound in prop::array::uniform8(any::<f64>())
    ) {
        let mut limits = lwr().limits;
        limits.lower = bound;
        let _ = LWR.arm_angles(&Pose::from_slots(slots), Branch::default(), &limits);
        let there = LWR.forward(&[0.3, 0.5, -0.2, -1.6, 0.1, 1.0, 0.4]);
        let free = LWR.arm_angles(&there, Branch::default(), &limits).unwrap();
        let _ = free.around(slots[0]);
    }
}
