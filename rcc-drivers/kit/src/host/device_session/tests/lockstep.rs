//! Tests of the session while the executor's clock follows the device.
//! Test code only.

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
