//! Tests of the session while the executor's clock follows the device.
//! Test code only.

use rcc_core::impedance::{ControlMode, ImpedanceLimits};

use super::fixture::{A_MAX, MS, SessionFixture, at, motion, usual};
use super::*;

/// Checks velocity and acceleration against their limits.
fn check_limits(fixture: &SessionFixture) {
    let [velocity, acceleration, _] = fixture.peaks();
    assert!(
        velocity <= 2.0 && acceleration <= A_MAX * 1.000_001,
        "{velocity} {acceleration}"
    );
}

/// Returns the distance from the newest set-point, rad.
fn beside(fixture: &SessionFixture) -> f64 {
    let newest = fixture.image.at(fixture.image.head.sequence).unwrap();
    (fixture.last() - newest.position[0]).abs()
}

#[test]
fn every_set_point_is_sent_in_its_own_exchange_with_its_own_outputs() {
    let mut fixture = SessionFixture::with_leading_clock();
    let points = usual();
    for q in &points {
        fixture.both(at(1, *q));
        assert_eq!(fixture.last(), *q);
        assert_eq!(fixture.session.outputs.digital, u64::from(*q > 0.1));
        assert_eq!(
            (fixture.session.margin(), fixture.session.state()),
            (0, DeviceState::Commanded)
        );
    }
    fixture.idle(1);
    assert_eq!(
        (fixture.last(), fixture.session.state()),
        (0.2, DeviceState::Ready)
    );
    assert_eq!(fixture.session.counts(), PlaybackCounts::default());
}

#[test]
fn an_executor_that_is_late_for_an_exchange_is_bridged() {
    let mut fixture = SessionFixture::with_leading_clock();
    let points = usual();
    fixture.run(1, &points[..150]);
    for late in 1..=3 {
        let from = 150 + 50 * (late - 1);
        fixture.device_alone(late as u64);
        points[from..from + late]
            .iter()
            .for_each(|q| fixture.write(at(1, *q)));
        fixture.run(1, &points[from + late..from + 50]);
    }
    fixture.run(1, &points[300..]);
    check_limits(&fixture);
    assert_eq!(
        fixture.session.counts(),
        PlaybackCounts {
            bridged: 6,
            ..PlaybackCounts::default()
        }
    );
    (0..500).for_each(|_| fixture.both(at(1, 0.2)));
    assert_eq!(fixture.last(), 0.2);
}

#[test]
fn a_cycle_that_was_skipped_leaves_no_delay() {
    let mut fixture = SessionFixture::with_leading_clock();
    let points = motion(0.0, 1.0, 2000);
    for part in points[..1800].chunks(300) {
        fixture.run(1, part);
        fixture.device_alone(1);
    }
    assert!(beside(&fixture) > 1e-5, "the arm went on");
    fixture.run(1, &points[1800..]);
    check_limits(&fixture);
    assert_eq!(fixture.session.counts().bridged, 6);
    (0..500).for_each(|_| fixture.both(at(1, 1.0)));
    assert_eq!((fixture.last(), fixture.session.margin()), (1.0, 0));
}

#[test]
fn two_cycles_in_one_exchange_are_caught_up_with() {
    let mut fixture = SessionFixture::with_leading_clock();
    let points = motion(0.0, 1.0, 2000);
    fixture.run(1, &points[..700]);
    fixture.write(at(1, points[700]));
    fixture.run(1, &points[701..]);
    check_limits(&fixture);
    (0..500).for_each(|_| fixture.both(at(1, 1.0)));
    assert_eq!((fixture.last(), fixture.session.margin()), (1.0, 0));
}

/// From rest to 2 rad/s, the limit, and back, at 16 rad/s² with a jerk of 1000 rad/s³; `joint 1` at `sign` times that.
fn at_the_velocity_limit(sign: f64) -> Vec<f64> {
    let (mut acceleration, mut velocity, mut place) = (0.0_f64, 0.0_f64, 0.0);
    let mut points = vec![0.0; 2];
    for step in 0..500 {
        // Acceleration up and down in 16 ms each, with 109 ms between: 16 · 0.125 = 2 rad/s.
        acceleration += match step {
            0..16 | 466..482 => 1.0,
            125..141 | 341..357 => -1.0,
            _ => 0.0,
        };
        velocity += acceleration * 1e-3;
        place += velocity * 1e-3;
        points.push(sign * place);
    }
    assert!(velocity.abs() < 1e-9, "{velocity}");
    points
}

/// Checks both limits up to rounding, and that the guard has refused nothing.
fn check_at_the_limits(fixture: &SessionFixture) {
    let [velocity, acceleration, _] = fixture.peaks();
    assert!(
        velocity <= 2.0 * 1.000_000_001 && acceleration <= A_MAX * 1.000_001,
        "{velocity} {acceleration}"
    );
    let violation = fixture.session.violation();
    assert_eq!(fixture.session.counts().violations, 0, "{violation:?}");
}

#[test]
fn two_cycles_in_one_exchange_at_the_velocity_limit_are_caught_up_with_while_the_net_brakes() {
    for sign in [1.0, -1.0] {
        let points = at_the_velocity_limit(sign);
        let last = points[points.len() - 1];
        // Before, while and after the velocity reaches its limit.
        for twice in [130, 138, 143, 200] {
            let mut fixture = SessionFixture::with_leading_clock();
            fixture.run(1, &points[..twice]);
            fixture.write(at(1, points[twice]));
            fixture.run(1, &points[twice + 1..]);
            (0..1000).for_each(|_| fixture.both(at(1, last)));
            check_at_the_limits(&fixture);
            assert_eq!(fixture.last(), last, "{twice}");
        }
    }
}

#[test]
fn a_bridge_at_the_end_of_an_acceleration_keeps_the_velocity_limit() {
    for sign in [1.0, -1.0] {
        let points = at_the_velocity_limit(sign);
        let last = points[points.len() - 1];
        for late in 120..145 {
            let mut fixture = SessionFixture::with_leading_clock();
            fixture.run(1, &points[..late]);
            fixture.device_alone(5);
            points[late..late + 5]
                .iter()
                .for_each(|q| fixture.write(at(1, *q)));
            fixture.run(1, &points[late + 5..]);
            (0..1000).for_each(|_| fixture.both(at(1, last)));
            check_at_the_limits(&fixture);
            assert_eq!(fixture.last(), last, "{late}");
        }
    }
}

#[test]
fn a_start_beside_the_hold_position_leaves_the_limits_to_the_net() {
    for (from, way) in [
        (-0.0019, 0.25),
        (0.0019, 0.25),
        (-0.0019, -0.25),
        (0.0019, -0.25),
    ] {
        for lockstep in [true, false] {
            let mut fixture = match lockstep {
                true => SessionFixture::with_leading_clock(),
                false => SessionFixture::new(),
            };
            fixture.run(1, &motion(from, way, 277));
            (0..1000).for_each(|_| fixture.both(at(1, from + way)));
            check_at_the_limits(&fixture);
            assert_eq!(fixture.last(), from + way, "{from} {way} {lockstep}");
        }
    }
}

#[test]
fn whatever_the_executors_rhythm_the_limits_hold_and_it_ends_where_it_should() {
    // 1.7 rad/s, and 94 % of the acceleration limit at its peaks.
    let points = motion(0.0, 0.25, 277);
    for seed in 1..40_u64 {
        let mut fixture = SessionFixture::with_leading_clock();
        let (mut chance, mut left) = (seed, points.iter());
        let mut chance = move || {
            chance = chance
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(seed);
            chance >> 59
        };
        while left.len() > 0 {
            match chance() {
                0 => fixture.device_alone(1),
                1 => fixture.device_alone(2),
                2 => {
                    left.next()
                        .into_iter()
                        .for_each(|q| fixture.write(at(1, *q)));
                    left.next()
                        .into_iter()
                        .for_each(|q| fixture.both(at(1, *q)));
                }
                _ => left
                    .next()
                    .into_iter()
                    .for_each(|q| fixture.both(at(1, *q))),
            }
        }
        (0..1000).for_each(|_| fixture.both(at(1, 0.25)));
        assert_eq!(
            fixture.session.counts().violations,
            0,
            "seed {seed}: {:?}",
            fixture.session.violation()
        );
        assert_eq!(
            fixture.last(),
            0.25,
            "seed {seed}: {}",
            fixture.session.reason()
        );
        check_limits(&fixture);
    }
}

#[test]
fn a_bridge_is_bounded() {
    let mut fixture = SessionFixture::with_leading_clock();
    fixture.run(1, &usual()[..200]);
    fixture.device_alone(10);
    assert_eq!(fixture.session.state(), DeviceState::Commanded);
    fixture.device_alone(1);
    assert_eq!(
        (fixture.session.state(), fixture.session.counts().starved),
        (DeviceState::Stopping, 1)
    );
    fixture.device_alone(200);
    assert_eq!(fixture.session.state(), DeviceState::Online);
    check_limits(&fixture);
}

#[test]
fn at_rest_nothing_is_bridged() {
    let mut fixture = SessionFixture::with_leading_clock();
    (0..50).for_each(|_| fixture.both(at(1, 0.0)));
    fixture.device_alone(20);
    assert_eq!(
        (fixture.session.state(), fixture.session.counts().bridged),
        (DeviceState::Commanded, 0)
    );
    fixture.sent.clear();
    fixture.run(1, &usual());
    assert_eq!(fixture.positions(), usual());
}

#[test]
fn null_in_motion_brings_the_arm_to_rest_in_the_same_exchange() {
    let mut fixture = SessionFixture::with_leading_clock();
    fixture.run(1, &usual()[..200]);
    fixture.idle(1);
    assert_eq!(fixture.session.state(), DeviceState::Stopping);
    fixture.idle(300);
    assert_eq!(fixture.session.state(), DeviceState::Ready);
    check_limits(&fixture);
}

#[test]
fn a_faster_executor_gives_each_exchange_its_newest_set_point() {
    let mut fixture = SessionFixture::with_leading_clock();
    fixture.image.head.period_ns = MS / 8;
    let points = motion(0.0, 0.2, 3200);
    for part in points.chunks(8) {
        for (q, step) in part.iter().zip(1..) {
            fixture.now_ns += MS / 8;
            match step {
                8 => fixture.both_now(at(1, *q)),
                _ => fixture.write(at(1, *q)),
            }
        }
    }
    let sent = fixture.positions();
    let newest: Vec<f64> = points.chunks_exact(8).map(|part| part[7]).collect();
    assert!(sent[1..] == newest[1..], "not the newest of each exchange");
    assert_eq!(fixture.session.counts(), PlaybackCounts::default());
}

/// The net begins with 4 set-points before the first exchange, and changes its stiffness as fast as is permitted.
#[test]
fn a_faster_executor_may_change_its_stiffness_while_its_net_begins() {
    let limits = ImpedanceLimits {
        translation: [0.01, 5000.0],
        rotation: [0.01, 300.0],
        joint: [0.01, 2000.0],
        damping: [0.1, 1.0],
        rate: 2.0,
        force: 50.0,
        torque: 10.0,
        joint_torque: 15.0,
    };
    let mode = ControlMode::JointImpedance;
    // 2000 N·m/rad times 2/s, in periods of 125 µs; more than one period's change is missing in 1.5 of them.
    for (change, refused) in [(0.5, false), (0.75, true)] {
        let mut fixture = SessionFixture::with_leading_clock();
        fixture.session.settings.limits.impedance = Some(limits);
        fixture.session.impedance_ramp = ImpedanceRamp::new(Some(limits), 7);
        fixture.device.strategy = mode;
        fixture.image.head.period_ns = MS / 8;
        let mut entry = at(1, 0.0);
        entry.impedance = limits.default_hold(mode, 7);
        for step in 1..=400 {
            entry.impedance.stiffness[0] += change;
            fixture.now_ns += MS / 8;
            match step % 8 {
                4 => fixture.both_now(entry),
                _ => fixture.write(entry),
            }
        }
        let violation = fixture.session.violation();
        assert_eq!(violation.is_some(), refused, "{violation:?}");
        let followed = fixture.session.state() == DeviceState::Commanded;
        assert_eq!(followed, !refused, "{change}");
    }
}
