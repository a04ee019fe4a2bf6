//! Whole turns of joints: nearest, within limits, by sign. Tests only.
#![allow(clippy::indexing_slicing, clippy::unwrap_used, clippy::expect_used)]

use super::*;
use core::f64::consts::PI;
use proptest::prelude::*;

fn limits(lower: f64, upper: f64) -> JointLimits {
    JointLimits {
        lower: [lower; 8],
        upper: [upper; 8],
        velocity_max: [1.0; 8],
        acceleration_max: [1.0; 8],
        jerk_max: [1.0; 8],
        joints: 6,
    }
}

#[test]
fn a_null_or_distant_hint_leaves_joints_unchanged() {
    for hint in [f64::NAN, f64::INFINITY, 1e300, -1e4] {
        assert_eq!(nearest_turns(&[0.3; 8], &[hint; 8]), [0.3; 8]);
    }
}

#[test]
fn a_sign_determines_the_turn() {
    assert_eq!(turns_by_signs(&[0.5; 8], 0), [0.5; 8]);
    assert_eq!(turns_by_signs(&[0.5; 8], 0xff), [0.5 - TAU; 8]);
    assert_eq!(turns_by_signs(&[0.5 - TAU; 8], 0), [0.5; 8]);
    // Close to 0 both signs are accepted.
    assert_eq!(turns_by_signs(&[-1e-12; 8], 0), [-1e-12; 8]);
}

proptest! {
    #[test]
    fn no_joint_is_more_than_180_degrees_from_the_hint(q in -7.0..7.0f64, hint in -7.0..7.0f64) {
        let [turned, ..] = nearest_turns(&[q; 8], &[hint; 8]);
        prop_assert!((turned - hint).abs() <= PI + 1e-12);
        let turns = (turned - q) / TAU;
        prop_assert!((turns - libm::rint(turns)).abs() < 1e-12);
    }

    #[test]
    fn within_limits_the_nearest_turn_is_taken_and_otherwise_the_joint_is_named(
        q in -7.0..7.0f64, hint in -7.0..7.0f64, lower in -6.3..0.0f64, upper in 0.0..6.3f64
    ) {
        let allowed = (-4..=4).map(|n| q + TAU * f64::from(n)).filter(|q| *q >= lower && *q <= upper);
        let nearest = allowed.min_by(|a, b| (a - hint).abs().total_cmp(&(b - hint).abs()));
        let found = turns_within(&[q; 8], &[hint; 8], &limits(lower, upper));
        match (nearest, found) {
            (Some(nearest), Ok(found)) => prop_assert!((found[0] - nearest).abs() < 1e-9),
            (None, Err(fault)) => prop_assert!(fault.joint == 0 && (fault.value > upper || fault.value < lower)),
            other => prop_assert!(false, "{other:?}"),
        }
    }
}
