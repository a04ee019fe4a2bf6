//! Joints come to rest within their limits, together, and stay on a straight line if they were on one.

use super::*;
use proptest::prelude::*;

const DT: f64 = 1e-3;
const N: usize = 7;

fn limits() -> StopLimits {
    let (mut acceleration_max, mut jerk_max) = ([0.0; JOINTS_MAX], [0.0; JOINTS_MAX]);
    acceleration_max[..N].copy_from_slice(&[5.0, 5.0, 8.0, 8.0, 10.0, 10.0, 12.0]);
    jerk_max[..N].copy_from_slice(&[100.0, 50.0, 80.0, 200.0, 100.0, 400.0, 100.0]);
    StopLimits {
        velocity_max: [2.0; JOINTS_MAX],
        acceleration_max,
        jerk_max,
        joints: N,
    }
}

fn begun(velocity: &[f64; N], acceleration: &[f64; N]) -> StopTrajectory {
    let mut rest = StopTrajectory::new(limits(), DT).unwrap();
    rest.begin(&[0.5; N], velocity, acceleration).unwrap();
    rest
}

/// Positions of all steps until rest, including the beginning.
fn run(rest: &mut StopTrajectory) -> Vec<[f64; JOINTS_MAX]> {
    let mut begin = [0.0; JOINTS_MAX];
    begin[..N].fill(0.5);
    let mut positions = vec![begin];
    while !rest.is_resting() && positions.len() < 100_000 {
        positions.push(rest.step().0);
    }
    assert!(rest.is_resting());
    positions
}

fn sevenfold(range: std::ops::Range<f64>) -> impl Strategy<Value = [f64; N]> {
    prop::array::uniform7(range)
}

#[test]
fn positions_are_nan_before_a_stop_begins() {
    let mut rest = StopTrajectory::new(limits(), DT).unwrap();
    let (position, resting) = rest.step();
    assert!(resting && rest.is_resting() && position.iter().all(|q| q.is_nan()));
}

#[test]
fn joints_at_rest_stay_where_they_are() {
    let mut rest = begun(&[0.0; N], &[0.0; N]);
    assert!(!rest.is_resting());
    let (position, resting) = rest.step();
    assert!(resting && position[..N] == [0.5; N] && position[N] == 0.0);
}

#[test]
fn without_acceleration_the_distance_is_half_of_velocity_times_time() {
    let velocity = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let position = *run(&mut begun(&velocity, &[0.0; N])).last().unwrap();
    let duration = 1.0 / 5.0 + 5.0 / 100.0;
    assert!(
        (position[0] - 0.5 - duration / 2.0).abs() < 1e-12,
        "{position:?}"
    );
}

#[test]
fn a_state_that_is_not_finite_is_refused_and_changes_nothing() {
    let mut rest = begun(&[0.3; N], &[0.0; N]);
    let twin = &mut rest.clone();
    let mut bad = [0.0; N];
    bad[2] = f64::NAN;
    for refusal in [
        rest.begin(&bad, &[0.0; N], &[0.0; N]),
        rest.begin(&[0.0; N], &bad, &[0.0; N]),
        rest.begin(&[0.0; N], &[0.0; N], &[0.0, 0.0]),
    ] {
        assert_eq!(refusal, Err(StopFault::NotFinite { joint: 2 }));
    }
    assert_eq!(rest.step(), twin.step());
}

#[test]
fn invalid_limits_are_refused_by_joint() {
    let mut bad = limits();
    bad.jerk_max[3] = 0.0;
    let refusal = StopTrajectory::new(bad, DT).unwrap_err();
    assert_eq!(
        refusal,
        StopLimitsError::Limit {
            joint: 3,
            limit: "jerk",
            value: 0.0
        }
    );
    assert!(
        refusal.to_string().starts_with("joint 4: jerk limit 0"),
        "{refusal}"
    );
    let many = StopLimits {
        joints: JOINTS_MAX + 1,
        ..limits()
    };
    assert!(matches!(
        StopTrajectory::new(many, DT),
        Err(StopLimitsError::Joints { joints: 9 })
    ));
    assert!(matches!(
        StopTrajectory::new(limits(), f64::NAN),
        Err(StopLimitsError::CycleTime { .. })
    ));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn every_joint_keeps_its_limits(velocity in sevenfold(-2.0..2.0), share in sevenfold(-1.0..1.0)) {
        let limits = limits();
        let mut acceleration = [0.0; N];
        acceleration.iter_mut().zip(share).zip(limits.acceleration_max).for_each(|((a, s), max)| *a = s * max);
        let positions = run(&mut begun(&velocity, &acceleration));
        for joint in 0..N {
            let (v, a) = (velocity[joint], acceleration[joint]);
            let (a_max, jerk_max) = (limits.acceleration_max[joint], limits.jerk_max[joint]);
            let path: Vec<f64> = positions.iter().map(|q| q[joint]).collect();
            let speeds: Vec<f64> = path.windows(2).map(|w| (w[1] - w[0]) / DT).collect();
            let changes: Vec<f64> = speeds.windows(2).map(|w| (w[1] - w[0]) / DT).collect();
            let unavoidable = v.abs().max((v + a * a.abs() / (2.0 * jerk_max)).abs());
            let fastest = unavoidable.max(limits.velocity_max[joint]);
            prop_assert!(speeds.iter().all(|s| s.abs() <= fastest * (1.0 + 1e-8)), "joint {joint}");
            prop_assert!(changes.iter().all(|c| c.abs() <= a_max * (1.0 + 1e-9) + 1e-8), "joint {joint}");
            prop_assert!(changes.windows(2).all(|w| (w[1] - w[0]).abs() / DT <= jerk_max * (1.0 + 1e-9) + 1e-5));
            let way = positions.last().unwrap()[joint] - 0.5;
            prop_assert!(way.abs() <= fastest * positions.len() as f64 * DT);
        }
    }

    #[test]
    fn joints_on_a_straight_line_stop_on_it(velocity in sevenfold(-1.5..1.5), ratio in -1.0..1.0f64) {
        prop_assume!(velocity[0].abs() > 0.1);
        // Acceleration parallel to the velocity, within every joint's limit.
        let acceleration = velocity.map(|v| v * ratio * 5.0 / 2.0);
        let positions = run(&mut begun(&velocity, &acceleration));
        for position in positions {
            let along = (position[0] - 0.5) / velocity[0];
            for joint in 0..N {
                prop_assert!((position[joint] - 0.5 - along * velocity[joint]).abs() < 1e-10, "{position:?}");
            }
        }
    }

    #[test]
    fn all_joints_need_no_longer_than_the_slowest_and_the_line(
        velocity in sevenfold(-2.0..2.0), share in sevenfold(-1.0..1.0),
    ) {
        let StopLimits { acceleration_max, jerk_max, .. } = limits();
        let mut acceleration = [0.0; N];
        acceleration.iter_mut().zip(share).zip(acceleration_max).for_each(|((a, s), max)| *a = s * max);
        let duration = (run(&mut begun(&velocity, &acceleration)).len() - 1) as f64 * DT;
        let joints = (0..N).map(|i| {
            let own = AccelerationLimits { acceleration: acceleration_max[i], jerk: jerk_max[i] };
            own.stop(AxisState { position: 0.0, velocity: velocity[i], acceleration: acceleration[i] })
        });
        let slowest = joints.map(|stop| stop.duration_s()).fold(0.0, f64::max);
        let release = (0..N).map(|i| acceleration_max[i] / jerk_max[i]).fold(0.0, f64::max);
        let brake = (0..N).map(|i| velocity[i].abs() / acceleration_max[i]).fold(0.0, f64::max);
        prop_assert!(duration <= slowest.max(2.5 * release + brake) * (1.0 + 1e-6) + DT);
    }
}
