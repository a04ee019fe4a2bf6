//! The rules of the guard, individually and as properties of arbitrary motions. Tests only.
#![allow(clippy::indexing_slicing, clippy::unwrap_used, clippy::expect_used)]

extern crate std;

use super::*;
use proptest::prelude::*;
use std::string::ToString;

const DT: f64 = 1e-3;

fn guard() -> Guard {
    let limits = JointLimits {
        lower: [-2.0; JOINTS_MAX],
        upper: [2.0; JOINTS_MAX],
        velocity_max: [1.5; JOINTS_MAX],
        acceleration_max: [10.0; JOINTS_MAX],
        jerk_max: [1000.0; JOINTS_MAX],
        joints: 2,
    };
    Guard::new(limits, 1e-3)
}

fn started(position: f64) -> Guard {
    let mut guard = guard();
    guard.first(&[position; 2], &[position; 2]).unwrap();
    guard
}

/// Feeds positions to joint 2 and returns the first refusal.
fn feed(guard: &mut Guard, positions: impl IntoIterator<Item = f64>) -> Option<Violation> {
    positions
        .into_iter()
        .find_map(|p| guard.check(&[0.0, p], DT).err())
}

#[test]
fn resting_at_the_hold_position_is_accepted() {
    assert_eq!(feed(&mut started(0.0), [0.0; 10]), None);
}

#[test]
fn the_first_set_point_must_match_the_hold_position() {
    assert_eq!(guard().first(&[0.5, 0.5], &[0.5, 0.5009]), Ok(()));
    let refusal = guard().first(&[0.5, 0.5], &[0.5, 0.502]).unwrap_err();
    assert_eq!(
        (refusal.kind, refusal.joint, refusal.limit),
        (ViolationKind::Jump, 1, 1e-3)
    );
    assert!((refusal.value + 0.002).abs() < 1e-12);
}

#[test]
fn without_a_first_set_point_any_set_point_is_a_jump() {
    assert_eq!(
        guard().check(&[0.0, 0.0], DT).unwrap_err().kind,
        ViolationKind::Jump
    );
}

#[test]
fn non_finite_or_missing_positions_are_refused() {
    for bad in [[0.0, f64::NAN], [0.0, f64::INFINITY]] {
        let refusal = started(0.0).check(&bad, DT).unwrap_err();
        assert_eq!((refusal.kind, refusal.joint), (ViolationKind::NotFinite, 1));
    }
    assert_eq!(
        started(0.0).check(&[0.0], DT).unwrap_err().kind,
        ViolationKind::NotFinite
    );
    assert_eq!(
        guard().first(&[f64::NAN; 2], &[0.0; 2]).unwrap_err().kind,
        ViolationKind::NotFinite
    );
    assert_eq!(
        guard().first(&[0.0; 2], &[f64::NAN; 2]).unwrap_err().kind,
        ViolationKind::Jump
    );
}

#[test]
fn a_position_out_of_range_is_refused() {
    let refusal = guard().first(&[0.0, 2.1], &[0.0, 2.1]).unwrap_err();
    assert_eq!(
        (refusal.kind, refusal.value, refusal.limit),
        (ViolationKind::Range, 2.1, 2.0)
    );
    assert_eq!(started(2.0).check(&[2.0, 2.0], DT), Ok(()));
    assert_eq!(
        started(2.0).check(&[2.0, 2.00001], DT).unwrap_err().kind,
        ViolationKind::Range
    );
    assert_eq!(
        started(-2.0)
            .check(&[-2.00001, -2.0], DT)
            .unwrap_err()
            .limit,
        -2.0
    );
}

#[test]
fn the_velocity_limit_may_be_used_fully_but_not_exceeded() {
    let ramp = |rate: f64| (1..=400).map(move |k| rate * 0.5 * (f64::from(k) * DT).powi(2));
    assert_eq!(feed(&mut started(0.0), ramp(3.7)), None); // reaches 1.48 rad/s
    let refusal = feed(&mut started(0.0), ramp(3.9)).unwrap(); // would reach 1.56 rad/s
    assert_eq!(
        (refusal.kind, refusal.limit),
        (ViolationKind::Velocity, 1.5)
    );
    assert!(refusal.value > 1.5 && refusal.value < 1.51, "{refusal}");
}

#[test]
fn the_acceleration_limit_may_be_used_fully_but_not_exceeded() {
    let ramp = |rate: f64| (1..=100).map(move |k| rate * 0.5 * (f64::from(k) * DT).powi(2));
    assert_eq!(feed(&mut started(0.0), ramp(10.0)), None);
    let refusal = feed(&mut started(0.0), ramp(10.1)).unwrap();
    assert_eq!(
        (refusal.kind, refusal.limit),
        (ViolationKind::Acceleration, 10.0)
    );
}

#[test]
fn stopping_dead_is_an_acceleration_beyond_the_limit() {
    let mut guard = started(0.0);
    let ramp = (1..=100).map(|k| 5.0 * (f64::from(k) * DT).powi(2));
    assert_eq!(feed(&mut guard, ramp), None);
    assert_eq!(
        feed(&mut guard, [0.05]).unwrap().kind,
        ViolationKind::Acceleration
    );
}

#[test]
fn a_step_too_large_for_a_motion_is_a_jump() {
    let refusal = started(0.0).check(&[0.0, 0.5], DT).unwrap_err();
    assert_eq!(
        (refusal.kind, refusal.value, refusal.limit),
        (ViolationKind::Jump, 0.5, 0.0015)
    );
}

#[test]
fn logical_time_that_does_not_pass_is_refused() {
    for dt in [0.0, -DT, f64::NAN] {
        assert!(started(0.0).check(&[0.0, 1e-6], dt).is_err(), "{dt}");
    }
    assert!(started(0.0).check(&[0.0, 0.0], 0.0).is_err());
}

#[test]
fn a_late_set_point_is_checked_over_the_time_that_passed() {
    let mut guard = started(0.0);
    assert_eq!(guard.check(&[0.0, 4e-6], DT), Ok(()));
    assert_eq!(guard.check(&[0.0, 36e-6], 2.0 * DT), Ok(()));
}

#[test]
fn a_refused_set_point_leaves_the_history_unchanged() {
    let mut guard = started(0.0);
    assert!(guard.check(&[1e-6, 1.0], DT).is_err());
    assert_eq!(guard.check(&[0.0, 0.0], DT), Ok(()));
}

#[test]
fn a_violation_names_joint_value_limit_and_unit() {
    let violation = Violation {
        kind: ViolationKind::Velocity,
        joint: 2,
        value: -1.9,
        limit: 1.75,
    };
    assert_eq!(
        violation.to_string(),
        "joint 3: velocity -1.9 rad/s exceeds 1.75 rad/s"
    );
}

proptest! {
    #[test]
    fn a_sine_within_the_limits_passes_and_one_beyond_does_not(amplitude in 0.01..1.9f64, frequency in 0.1..40.0f64) {
        // Starts at rest at its turning point.
        let wave = (1..=2000).map(|k| amplitude * (1.0 - (frequency * f64::from(k) * DT).cos()) - amplitude);
        let mut guard = guard();
        guard.first(&[0.0, -amplitude], &[0.0, -amplitude]).unwrap();
        let refusal = wave.into_iter().find_map(|p| guard.check(&[0.0, p + amplitude - amplitude], DT).err());
        let (velocity, acceleration) = (amplitude * frequency, amplitude * frequency * frequency);
        if velocity <= 1.5 && acceleration <= 10.0 {
            prop_assert_eq!(refusal, None);
        } else if (velocity > 1.52 && frequency > 1.0) || acceleration > 10.2 {
            prop_assert!(refusal.is_some());
        }
    }

    #[test]
    fn accepted_set_points_are_within_range(positions in prop::collection::vec(any::<f64>(), 0..4), dt in any::<f64>()) {
        let mut guard = started(0.0);
        if guard.check(&positions, dt).is_ok() {
            prop_assert!(positions.len() >= 2);
            prop_assert!(positions.iter().take(2).all(|p| p.abs() <= 2.0 * (1.0 + 1e-9)));
        }
    }
}
