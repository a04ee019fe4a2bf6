//! The rules of the player of a device that the executor's clock follows.
//! Test code only.

use super::bench::{A_MAX, Bench, MS, at, motion, usual};
use super::*;

/// Velocity and acceleration within their limits.
fn check_limits(bench: &Bench) {
    let [velocity, acceleration, _] = bench.peaks();
    assert!(
        velocity <= 2.0 && acceleration <= A_MAX * 1.000_001,
        "{velocity} {acceleration}"
    );
}

/// Beside the newest set-point, rad.
fn beside(bench: &Bench) -> f64 {
    let newest = bench.image.at(bench.image.head.sequence).unwrap();
    (bench.last() - newest.position[0]).abs()
}

#[test]
fn every_set_point_is_sent_in_its_own_exchange_with_its_own_outputs() {
    let mut bench = Bench::leading();
    let points = usual();
    for q in &points {
        bench.both(at(1, *q));
        assert_eq!(bench.last(), *q);
        assert_eq!(bench.player.outputs().digital, u64::from(*q > 0.1));
        assert_eq!(
            (bench.player.margin(), bench.player.state()),
            (0, DeviceState::Commanded)
        );
    }
    bench.idle(1);
    assert_eq!(
        (bench.last(), bench.player.state()),
        (0.2, DeviceState::Ready)
    );
    assert_eq!(bench.player.counts(), PlayerCounts::default());
}

#[test]
fn an_executor_that_is_late_for_an_exchange_is_bridged() {
    let mut bench = Bench::leading();
    let points = usual();
    bench.run(1, &points[..150]);
    for late in 1..=3 {
        let from = 150 + 50 * (late - 1);
        bench.device_alone(late as u64);
        points[from..from + late]
            .iter()
            .for_each(|q| bench.write(at(1, *q)));
        bench.run(1, &points[from + late..from + 50]);
    }
    bench.run(1, &points[300..]);
    check_limits(&bench);
    assert_eq!(
        bench.player.counts(),
        PlayerCounts {
            bridged: 6,
            ..PlayerCounts::default()
        }
    );
    (0..500).for_each(|_| bench.both(at(1, 0.2)));
    assert_eq!(bench.last(), 0.2);
}

#[test]
fn a_cycle_that_was_skipped_leaves_no_delay() {
    let mut bench = Bench::leading();
    let points = motion(0.0, 1.0, 2000);
    for part in points[..1800].chunks(300) {
        bench.run(1, part);
        bench.device_alone(1);
    }
    assert!(beside(&bench) > 1e-5, "the arm went on");
    bench.run(1, &points[1800..]);
    check_limits(&bench);
    assert_eq!(bench.player.counts().bridged, 6);
    (0..500).for_each(|_| bench.both(at(1, 1.0)));
    assert_eq!((bench.last(), bench.player.margin()), (1.0, 0));
}

#[test]
fn two_cycles_in_one_exchange_are_caught_up_with() {
    let mut bench = Bench::leading();
    let points = motion(0.0, 1.0, 2000);
    bench.run(1, &points[..700]);
    bench.write(at(1, points[700]));
    bench.run(1, &points[701..]);
    check_limits(&bench);
    (0..500).for_each(|_| bench.both(at(1, 1.0)));
    assert_eq!((bench.last(), bench.player.margin()), (1.0, 0));
}

#[test]
fn whatever_the_executors_rhythm_the_limits_hold_and_it_ends_where_it_should() {
    // 1.7 rad/s, and 94 % of the acceleration limit at its peaks.
    let points = motion(0.0, 0.25, 277);
    for seed in 1..40_u64 {
        let mut bench = Bench::leading();
        let (mut chance, mut left) = (seed, points.iter());
        let mut chance = move || {
            chance = chance
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(seed);
            chance >> 59
        };
        while left.len() > 0 {
            match chance() {
                0 => bench.device_alone(1),
                1 => bench.device_alone(2),
                2 => {
                    left.next().into_iter().for_each(|q| bench.write(at(1, *q)));
                    left.next().into_iter().for_each(|q| bench.both(at(1, *q)));
                }
                _ => left.next().into_iter().for_each(|q| bench.both(at(1, *q))),
            }
        }
        (0..1000).for_each(|_| bench.both(at(1, 0.25)));
        assert_eq!(
            bench.player.counts().violations,
            0,
            "seed {seed}: {:?}",
            bench.player.violation()
        );
        assert_eq!(bench.last(), 0.25, "seed {seed}: {}", bench.player.reason());
        check_limits(&bench);
    }
}

#[test]
fn an_executor_that_stays_away_is_not_bridged_for_ever() {
    let mut bench = Bench::leading();
    bench.run(1, &usual()[..200]);
    bench.device_alone(10);
    assert_eq!(bench.player.state(), DeviceState::Commanded);
    bench.device_alone(1);
    assert_eq!(
        (bench.player.state(), bench.player.counts().starved),
        (DeviceState::Stopping, 1)
    );
    bench.device_alone(200);
    assert_eq!(bench.player.state(), DeviceState::Online);
    check_limits(&bench);
}

#[test]
fn at_rest_nothing_is_bridged() {
    let mut bench = Bench::leading();
    (0..50).for_each(|_| bench.both(at(1, 0.0)));
    bench.device_alone(20);
    assert_eq!(
        (bench.player.state(), bench.player.counts().bridged),
        (DeviceState::Commanded, 0)
    );
    bench.sent.clear();
    bench.run(1, &usual());
    assert_eq!(bench.positions(), usual());
}

#[test]
fn null_in_motion_brings_the_arm_to_rest_in_the_same_exchange() {
    let mut bench = Bench::leading();
    bench.run(1, &usual()[..200]);
    bench.idle(1);
    assert_eq!(bench.player.state(), DeviceState::Stopping);
    bench.idle(300);
    assert_eq!(bench.player.state(), DeviceState::Ready);
    check_limits(&bench);
}

#[test]
fn a_faster_executor_gives_each_exchange_its_newest_set_point() {
    let mut bench = Bench::leading();
    bench.image.head.period_ns = MS / 8;
    let points = motion(0.0, 0.2, 3200);
    for part in points.chunks(8) {
        for (q, step) in part.iter().zip(1..) {
            bench.now_ns += MS / 8;
            match step {
                8 => bench.both_now(at(1, *q)),
                _ => bench.write(at(1, *q)),
            }
        }
    }
    let sent = bench.positions();
    let newest: Vec<f64> = points.chunks_exact(8).map(|part| part[7]).collect();
    assert!(sent[1..] == newest[1..], "not the newest of each exchange");
    assert_eq!(bench.player.counts(), PlayerCounts::default());
}
