//! Devices that are lost, or change their clock, while they move, in virtual time.
//! Test code only.

use super::fixture::{A_MAX, DELAY, MS, SessionFixture, at, motion};
use super::*;

/// A socket that fails for a moment while the controller bridges the missing answers: the arm is lost for the executor at
/// once, and goes on from where it is, not at once to rest.
#[test]
fn an_arm_lost_in_motion_that_answers_again_at_once_is_brought_to_rest_within_its_limits() {
    let mut fixture = SessionFixture::new();
    let points = motion(0.0, 1.0, 2000);
    fixture.run(1, &points[..1000]);
    for missing in 1..=3 {
        fixture.now_ns += MS;
        fixture.write(at(1, points[999 + missing]));
        fixture.session.handle_link_error(fixture.now_ns, Some(1));
        assert_eq!(
            fixture.session.measurement().state,
            DeviceState::Offline as u32
        );
    }
    let before = fixture.sent.len();
    fixture.device.ticks = 4;
    fixture.both(at(1, points[1003]));
    fixture.device.ticks = 1;
    assert_eq!(fixture.session.state(), DeviceState::Stopping);
    fixture.run(1, &points[1004..1300]);
    let mut velocity = points[1000 - DELAY as usize] - points[999 - DELAY as usize];
    let mut periods = 4.0;
    let mut last = fixture.sent[before - 1].1[0];
    for (_, q) in &fixture.sent[before..] {
        let now = (q[0] - last) / periods;
        assert!(
            (now - velocity).abs() <= 1.001 * A_MAX * 1e-6 * periods,
            "{now} {velocity}"
        );
        (velocity, last, periods) = (now, q[0], 1.0);
    }
    assert_eq!(velocity, 0.0);
    assert_eq!(fixture.session.state(), DeviceState::Online);
    assert_eq!(fixture.session.reason(), reason::DEVICE_STOPPED);
}

#[test]
fn an_arm_lost_in_motion_for_long_begins_where_it_holds_itself() {
    let mut fixture = SessionFixture::new();
    fixture.run(1, &motion(0.0, 1.0, 2000)[..1000]);
    fixture.session.handle_link_error(fixture.now_ns, Some(1));
    fixture.now_ns += 100 * MS;
    fixture.session.handle_link_error(fixture.now_ns, Some(1));
    fixture.device.mirror = [0.7; JOINTS_MAX];
    fixture.exchange();
    assert_eq!(fixture.last(), 0.7);
    assert_ne!(fixture.session.state(), DeviceState::Stopping);
}

/// A driver tells a loss once per attempt to reach its device, and is silent between them.
#[test]
fn the_reason_of_a_loss_stays_until_the_device_is_only_silent() {
    let mut fixture = SessionFixture::new();
    let mut reason_after = |ms: u64, lost| {
        fixture.now_ns += ms * MS;
        fixture.session.handle_link_error(fixture.now_ns, lost);
        fixture.session.measurement().reason
    };
    assert_eq!(reason_after(100, Some(5)), 5);
    assert_eq!(reason_after(1_000, None), 5);
    assert_eq!(reason_after(500, Some(6)), 6);
    assert_eq!(reason_after(1_999, None), 6);
    assert_eq!(reason_after(1, None), reason::SILENT);
    fixture.exchange();
    fixture.now_ns += 100 * MS;
    fixture.session.handle_link_error(fixture.now_ns, None);
    assert_eq!(fixture.session.measurement().reason, reason::SILENT);
}

/// The set-points of 1 ms each would move the arm at another speed in steps of another length.
#[test]
fn an_arm_whose_period_changes_in_motion_is_brought_to_rest_within_its_limits() {
    for (ns, stops) in [(15_100_000, true), (500_000, true), (1_050_000, false)] {
        let mut fixture = SessionFixture::new();
        let points = motion(0.0, 1.0, 2000);
        fixture.run(1, &points[..700]);
        let sent = fixture.sent.len();
        fixture.device.period_ns = ns;
        fixture.run(1, &points[700..701]);
        let state = match stops {
            true => DeviceState::Stopping,
            false => DeviceState::Commanded,
        };
        assert_eq!(fixture.session.state(), state, "{ns} ns");
        if !stops {
            continue;
        }
        fixture.device_alone(2000);
        assert_eq!(fixture.session.state(), DeviceState::Online);
        assert_eq!(fixture.session.reason(), reason::PERIOD_CHANGED);
        let period_s = ns as f64 * 1e-9;
        let before = points[700 - DELAY as usize] - points[699 - DELAY as usize];
        let mut velocity = before / 1e-3;
        let mut last = fixture.sent[sent - 1].1[0];
        for (_, q) in &fixture.sent[sent..] {
            let now = (q[0] - last) / period_s;
            let change = (now - velocity).abs();
            assert!(
                change <= 1.001 * A_MAX * period_s,
                "{now} {velocity} at {ns} ns"
            );
            (velocity, last) = (now, q[0]);
        }
        assert_eq!(velocity, 0.0);
    }
}

/// A stop that began with one period goes on with another, also more than once.
#[test]
fn an_arm_whose_period_changes_during_its_stop_keeps_its_limits() {
    for periods_ns in [
        [500_000, 500_000],
        [3_000_000, 3_000_000],
        [1_200_000, 400_000],
    ] {
        let mut fixture = SessionFixture::new();
        let points = motion(0.0, 1.0, 2000);
        fixture.run(1, &points[..1000]);
        let mut last = fixture.last();
        let mut velocity = (points[999 - DELAY as usize] - points[998 - DELAY as usize]) / 1e-3;
        let mut before_s = 1e-3;
        fixture.idle(1);
        for step in 0..2000 {
            let now = fixture.last();
            let dt_s = fixture.device.period_ns as f64 * 1e-9;
            let rate = (now - last) / dt_s;
            let acceleration = (rate - velocity) / (0.5 * (dt_s + before_s));
            assert!(
                acceleration.abs() <= 1.001 * A_MAX && rate.abs() <= 2.0,
                "{acceleration} {rate} in step {step} with {periods_ns:?} ns"
            );
            (last, velocity, before_s) = (now, rate, dt_s);
            if step == 15 {
                assert_eq!(fixture.session.state(), DeviceState::Stopping);
            }
            if step < 15 {
                fixture.idle(1);
            } else {
                fixture.device.period_ns = periods_ns[step % 2];
                fixture.device_alone(1);
            }
        }
        assert_eq!(velocity, 0.0);
        assert_eq!(fixture.session.reason(), reason::RELEASED_MOVING);
    }
}
