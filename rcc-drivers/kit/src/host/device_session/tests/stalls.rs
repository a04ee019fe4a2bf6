//! Exchanges that a device skips, in virtual time.
//! Test code only.

use super::fixture::{DELAY, MS, SessionFixture, at, motion, usual};
use super::*;

#[test]
fn a_stall_over_the_end_of_a_net_drops_none_of_its_last_set_points() {
    for stall in 1..=DELAY + 5 {
        let mut fixture = SessionFixture::new();
        fixture.run(1, &usual());
        // The net has ended; the device goes on without an exchange, and says so in the next one.
        for _ in 1..stall {
            fixture.now_ns += MS;
            fixture.write(SetPoint::NONE);
            fixture.observe();
        }
        fixture.device.ticks = stall;
        fixture.idle(1);
        fixture.device.ticks = 1;
        fixture.idle(2 * DELAY);
        assert_eq!(
            (fixture.session.reason(), fixture.last()),
            (0, 0.2),
            "{stall} ms"
        );
    }
}

#[test]
fn a_device_that_stalled_loses_no_set_point_and_catches_up() {
    let mut fixture = SessionFixture::new();
    let points = motion(0.0, 1.0, 2000);
    for (cycle, q) in points.iter().enumerate() {
        fixture.now_ns += MS;
        fixture.write(at(1, *q));
        if (500..530).contains(&cycle) {
            fixture.observe();
        } else {
            fixture.exchange();
        }
        if cycle == 530 {
            assert_eq!(fixture.session.margin(), DELAY + 30);
        }
    }
    assert!(
        fixture.session.margin() <= DELAY + 1,
        "{}",
        fixture.session.margin()
    );
    assert_eq!(fixture.session.counts(), PlaybackCounts::default());
    fixture.check_peaks();
}

#[test]
fn lost_device_periods_count_as_time() {
    let mut fixture = SessionFixture::new();
    let points = usual();
    for (cycle, q) in points.iter().enumerate() {
        fixture.now_ns += MS;
        fixture.write(at(1, *q));
        match cycle {
            200 | 201 => fixture.observe(),
            _ => {
                fixture.device.ticks = if cycle == 202 { 3 } else { 1 };
                fixture.exchange();
            }
        }
    }
    assert_eq!(fixture.last(), points[400 - DELAY as usize]);
    assert_eq!(fixture.session.margin(), DELAY);
}

#[test]
fn set_points_missed_in_a_stall_are_played_at_once_if_the_device_has_continued() {
    let mut fixture = SessionFixture::new();
    let points = motion(0.0, 1.0, 2000);
    fixture.run(1, &points[..1000]);
    fixture.executor_alone(1, &points[1000..1039]);
    fixture.device.ticks = 40;
    fixture.run(1, &points[1039..=1039]);
    fixture.device.ticks = 1;
    assert!((fixture.last() - points[1039 - DELAY as usize]).abs() < 1e-12);
    fixture.run(1, &points[1040..]);
    (0..DELAY).for_each(|_| fixture.both(at(1, 1.0)));
    assert_eq!((fixture.session.reason(), fixture.last()), (0, 1.0));
}

#[test]
fn a_device_that_falls_behind_by_more_than_the_time_out_stops() {
    let mut fixture = SessionFixture::new();
    let points = motion(0.0, 1.0, 2000);
    fixture.run(1, &points[..1000]);
    fixture.executor_alone(1, &points[1000..1060]);
    fixture.run(1, &points[1060..1100]);
    assert_eq!(fixture.session.reason(), reason::SET_POINTS_LOST);
    fixture.check_peaks();
}

#[test]
fn at_rest_the_delay_is_restored_without_slowing_anything() {
    let mut fixture = SessionFixture::new();
    let points = usual();
    (0..50).for_each(|_| fixture.both(at(1, 0.0)));
    fixture.device_alone(8);
    (0..20).for_each(|_| fixture.both(at(1, 0.0)));
    assert_eq!(fixture.session.margin(), DELAY);
    fixture.sent.clear();
    fixture.run(1, &points);
    assert_eq!(
        fixture.positions()[DELAY as usize..],
        points[..points.len() - DELAY as usize]
    );
}

#[test]
fn set_points_that_piled_up_in_motion_are_caught_up_smoothly() {
    let mut fixture = SessionFixture::new();
    let points = motion(0.0, 1.0, 2000);
    fixture.run(1, &points[..700]);
    // The device stands still for 4 ms; the executor does not.
    fixture.executor_alone(1, &points[700..704]);
    fixture.run(1, &points[704..720]);
    assert_eq!(fixture.session.margin(), DELAY + 4);
    fixture.run(1, &points[720..1200]);
    assert!(
        fixture.session.margin() <= DELAY + 1,
        "{}",
        fixture.session.margin()
    );
    assert_eq!(fixture.session.counts(), PlaybackCounts::default());
    fixture.check_peaks();
    for (_, q) in &fixture.sent {
        assert!((q[1] - 0.5 * q[0]).abs() < 1e-15, "off the path");
    }
}

#[test]
fn equal_set_points_that_piled_up_at_rest_are_left_out_at_once() {
    let mut fixture = SessionFixture::new();
    (0..50).for_each(|_| fixture.both(at(1, 0.0)));
    for _ in 0..5 {
        fixture.now_ns += MS;
        fixture.write(at(1, 0.0));
    }
    fixture.both(at(1, 0.0));
    assert_eq!(fixture.session.margin(), DELAY);
    fixture.sent.clear();
    let points = usual();
    fixture.run(1, &points);
    assert_eq!(
        fixture.positions()[DELAY as usize..],
        points[..points.len() - DELAY as usize]
    );
}
