//! Tests of the session in virtual time: an executor and a device with periods of 1 ms, each of which may stall.
//! Test code only.

use super::*;

mod fixture;
mod lockstep;
mod losses;
mod stalls;

use fixture::{DELAY, MS, SessionFixture, at, motion, session, usual};

#[test]
fn after_the_delay_every_set_point_is_sent_once_with_its_own_outputs() {
    let mut fixture = SessionFixture::new();
    let points = usual();
    let mut outputs = Vec::new();
    for cycle in 0..points.len() + DELAY as usize {
        let q = points.get(cycle).or(points.last()).copied().unwrap_or(0.0);
        fixture.both(at(1, q));
        outputs.push((fixture.session.outputs.digital, fixture.last()));
        assert_eq!(fixture.session.state(), DeviceState::Commanded);
        assert_eq!(fixture.session.settled_ns(), 0);
    }
    let delay = DELAY as usize;
    assert_eq!(fixture.positions()[delay..], points);
    assert_eq!(fixture.positions()[..delay], [0.0; DELAY as usize]);
    assert_eq!(fixture.session.margin(), DELAY);
    for (digital, q) in outputs {
        assert_eq!(digital, u64::from(q > 0.1), "at {q}");
    }
}

#[test]
fn a_net_that_ends_at_rest_leaves_the_arm_ready_and_settled() {
    let mut fixture = SessionFixture::new();
    fixture.run(1, &usual());
    fixture.idle(DELAY - 1);
    assert_eq!(fixture.session.state(), DeviceState::Commanded);
    fixture.idle(1);
    assert_eq!(
        (fixture.last(), fixture.session.state()),
        (0.2, DeviceState::Commanded)
    );
    fixture.idle(1);
    assert_eq!(fixture.session.state(), DeviceState::Ready);
    assert_eq!(
        fixture.session.settled_ns(),
        fixture.image.head.sequence * MS
    );
    assert_eq!(fixture.session.reason(), 0);
}

#[test]
fn outputs_are_those_of_the_newest_cycle_when_the_joints_are_not_commanded() {
    let mut fixture = SessionFixture::new();
    let only_output = SetPoint {
        digital: 0b10,
        digital_commanded: 0b10,
        ..SetPoint::NONE
    };
    fixture.both(only_output);
    assert_eq!(fixture.session.outputs.digital, 0b10);
    assert_eq!(fixture.session.state(), DeviceState::Ready);
}

/// A station with the output `keeps`, which holds, and `safe`, which does not.
fn station() -> SessionFixture {
    use rcc_config::OnRelease::{Hold, Safe};
    use rcc_core::primitive::ChannelKind::DigitalOutput;
    let channels = [
        ("keeps", DigitalOutput, 0.into(), Some(Hold), None),
        ("safe", DigitalOutput, 1.into(), Some(Safe(0.0)), None),
    ];
    let device = crate::conformance::device("none", serde_json::json!({}), &channels);
    let mut fixture = SessionFixture::new();
    fixture.session.output_release = OutputRelease::new(&device);
    fixture
}

/// Both outputs are commanded to be on.
const BOTH_ON: SetPoint = SetPoint {
    digital: 0b11,
    digital_commanded: 0b11,
    ..SetPoint::NONE
};

/// Digital outputs that are on, and those that have a value.
fn digital(fixture: &SessionFixture) -> (u64, u64) {
    let values = fixture.session.output_release.values();
    (values.digital, values.digital_set)
}

#[test]
fn a_command_between_two_exchanges_stays_with_the_outputs_that_hold() {
    let mut fixture = station();
    assert_eq!(digital(&fixture), (0b00, 0b10));
    fixture.write(BOTH_ON);
    fixture.write(SetPoint::NONE);
    fixture.both(SetPoint::NONE);
    assert_eq!(digital(&fixture), (0b01, 0b11));
    let off = SetPoint {
        digital: 0,
        ..BOTH_ON
    };
    fixture.write(BOTH_ON);
    fixture.write(off);
    fixture.both(SetPoint::NONE);
    assert_eq!(digital(&fixture), (0b00, 0b11));
}

#[test]
fn a_command_while_the_device_was_lost_has_no_effect_later() {
    let mut fixture = station();
    fixture.session.handle_link_error(fixture.now_ns, Some(1));
    fixture.write(BOTH_ON);
    fixture.both(SetPoint::NONE);
    assert_eq!(digital(&fixture), (0b00, 0b10));
}

#[test]
fn outputs_do_not_change_while_set_points_wait() {
    let mut fixture = SessionFixture::new();
    for _ in 0..DELAY {
        fixture.both(at(1, 0.0));
        assert_eq!(fixture.session.outputs.digital_commanded, 0);
    }
    fixture.both(at(1, 0.0));
    assert_eq!(fixture.session.outputs.digital_commanded, 1);
}

#[test]
fn a_first_set_point_elsewhere_is_refused_and_nothing_moves() {
    let mut fixture = SessionFixture::new();
    fixture.run(1, &motion(0.01, 0.2, 400));
    assert_eq!(fixture.last(), 0.0);
    assert_eq!(fixture.session.reason(), reason::FIRST_SET_POINT);
    assert_eq!(fixture.session.state(), DeviceState::Online);
    fixture.idle(1);
    assert_eq!(fixture.session.state(), DeviceState::Ready);
}

#[test]
fn a_step_within_the_tolerance_is_blended() {
    let mut fixture = SessionFixture::new();
    let points = motion(0.0019, 0.2, 400);
    fixture.run(1, &points);
    (0..DELAY).for_each(|_| fixture.both(at(1, points[400])));
    assert_eq!(fixture.last(), points[400]);
    fixture.check_peaks();
}

#[test]
fn a_late_executor_slows_the_motion_on_its_path_and_the_margin_comes_back() {
    let mut fixture = SessionFixture::new();
    let points = motion(0.0, 1.0, 2000);
    let (early, rest) = points.split_at(800);
    fixture.run(1, early);
    fixture.device_alone(7);
    assert!((DELAY - 7..DELAY - 5).contains(&fixture.session.margin()));
    fixture.run(1, rest);
    assert_eq!(fixture.session.counts(), PlaybackCounts::default());
    assert!(
        fixture.session.margin() >= DELAY - 1,
        "{}",
        fixture.session.margin()
    );
    fixture.check_peaks();
    for (_, q) in &fixture.sent {
        assert!((q[1] - 0.5 * q[0]).abs() < 1e-15, "off the path");
    }
    fixture.idle(DELAY + 5);
    assert_eq!(
        (fixture.last(), fixture.session.state()),
        (1.0, DeviceState::Ready)
    );
}

#[test]
fn when_set_points_end_in_motion_the_arm_comes_to_rest_within_its_limits() {
    let mut fixture = SessionFixture::new();
    fixture.run(1, &usual()[..200]);
    fixture.device_alone(11);
    assert_eq!(fixture.session.state(), DeviceState::Stopping);
    assert_eq!(fixture.session.counts().starved, 1);
    fixture.device_alone(200);
    assert_eq!(fixture.session.state(), DeviceState::Online);
    fixture.check_peaks();
    let rest = fixture.last();
    fixture.run(1, &usual()[200..]);
    assert_eq!(fixture.last(), rest, "its owner is refused");
    fixture.idle(1);
    fixture.run(2, &motion(rest, 0.1, 300));
    assert_eq!(fixture.session.state(), DeviceState::Commanded);
    assert!(fixture.last() > rest, "another owner is followed");
}

#[test]
fn null_in_motion_brings_the_arm_to_rest_and_releases_outputs_at_once() {
    let mut fixture = SessionFixture::new();
    fixture.run(1, &usual()[..300]);
    fixture.idle(DELAY + 1);
    assert_eq!(fixture.session.state(), DeviceState::Stopping);
    assert_eq!(fixture.session.reason(), reason::RELEASED_MOVING);
    assert_eq!(fixture.session.outputs.digital_commanded, 0);
    assert_eq!(fixture.session.settled_ns(), 0);
    fixture.idle(300);
    assert_eq!(fixture.session.state(), DeviceState::Ready);
    fixture.check_peaks();
}

#[test]
fn a_start_while_the_arm_is_being_stopped_is_refused() {
    let mut fixture = SessionFixture::new();
    fixture.run(1, &usual()[..300]);
    fixture.idle(DELAY + 1);
    let points: Vec<f64> = vec![fixture.last(); 400];
    fixture.run(2, &points);
    assert_eq!(fixture.session.reason(), reason::NOT_STARTABLE);
    assert_eq!(fixture.session.state(), DeviceState::Online);
}

#[test]
fn a_stale_board_at_rest_releases_outputs_and_its_net() {
    let mut fixture = SessionFixture::new();
    let points = usual();
    fixture.run(1, &points);
    (0..20).for_each(|_| fixture.both(at(1, 0.2)));
    assert_eq!(fixture.session.outputs.digital_commanded, 1);
    fixture.device_alone(51);
    assert_eq!(fixture.session.outputs.digital_commanded, 0);
    assert_eq!(fixture.session.feed.executor(), 0);
    fixture.device_alone(5);
    assert_eq!(fixture.session.state(), DeviceState::Online);
    (0..100).for_each(|_| fixture.both(at(1, 0.2)));
    assert_eq!(
        fixture.session.state(),
        DeviceState::Online,
        "the same net is not followed again"
    );
    assert_eq!(fixture.last(), 0.2);
}

#[test]
fn a_board_stamped_in_the_future_is_as_stale_as_an_old_one() {
    let mut fixture = SessionFixture::new();
    fixture.now_ns += MS;
    fixture.write(SetPoint::NONE);
    fixture.image.head.stamp_ns = fixture.now_ns + 1_000 * MS;
    fixture.exchange();
    assert_eq!(fixture.session.feed.executor(), 0);
    assert_ne!(fixture.session.state(), DeviceState::Ready);
}

#[test]
fn when_the_executor_goes_in_motion_the_arm_comes_to_rest() {
    let mut fixture = SessionFixture::new();
    fixture.run(1, &usual()[..200]);
    fixture.connected = false;
    fixture.device_alone(1);
    assert_eq!(fixture.session.state(), DeviceState::Stopping);
    assert_eq!(fixture.session.reason(), reason::NO_EXECUTOR);
    assert_eq!(fixture.session.outputs.digital_commanded, 0);
    fixture.device_alone(200);
    fixture.check_peaks();
    fixture.sent.clear();
    fixture.device_alone(50);
    assert_eq!(fixture.peaks()[0], 0.0);
}

#[test]
fn another_executor_is_not_followed_in_motion() {
    let mut fixture = SessionFixture::new();
    fixture.run(1, &usual()[..200]);
    fixture.image.head.executor = 8;
    fixture.run(1, &usual()[200..]);
    assert_eq!(fixture.session.state(), DeviceState::Online);
    fixture.check_peaks();
    fixture.idle(1);
    assert_eq!(
        (fixture.session.state(), fixture.session.feed.executor()),
        (DeviceState::Ready, 8)
    );
}

#[test]
fn set_points_that_go_on_under_another_owner_are_followed() {
    let mut fixture = SessionFixture::new();
    let points = usual();
    fixture.run(1, &points[..200]);
    fixture.run(2, &points[200..]);
    (0..DELAY).for_each(|_| fixture.both(at(2, 0.2)));
    assert_eq!(fixture.positions()[DELAY as usize..], points);
}

#[test]
fn a_net_that_follows_a_cycle_later_begins_without_a_gap_of_its_own() {
    let mut fixture = SessionFixture::new();
    let (there, back) = (usual(), motion(0.2, -0.2, 400));
    fixture.run(1, &there);
    fixture.idle(1);
    fixture.run(2, &back);
    (0..DELAY).for_each(|_| fixture.both(at(2, 0.0)));
    let positions = fixture.positions();
    let start = DELAY as usize;
    assert_eq!(positions[start..start + there.len()], there);
    assert_eq!(positions[start + there.len()], 0.2);
    assert_eq!(positions[start + there.len() + 1..], back);
}

#[test]
fn a_restarted_driver_does_not_move() {
    let mut fixture = SessionFixture::new();
    fixture.run(1, &usual()[..200]);
    let mut again = SessionFixture::new();
    again.session = session(fixture.session.settings);
    again.image = fixture.image;
    again.now_ns = fixture.now_ns;
    again.device.mirror = fixture.session.position;
    again.device.commandable = false;
    again.exchange();
    again.device.commandable = true;
    again.sent.clear();
    again.run(1, &usual()[200..]);
    assert_eq!(again.peaks()[0], 0.0);
    assert_eq!(again.session.reason(), reason::ALREADY_COMMANDED);
    assert_eq!(again.session.state(), DeviceState::Online);
}

#[test]
fn a_device_that_left_command_mode_is_mirrored_and_its_net_is_not_followed_again() {
    let mut fixture = SessionFixture::new();
    fixture.run(1, &usual()[..200]);
    fixture.device.commandable = false;
    fixture.device.mirror[0] = 0.123;
    fixture.run(1, &usual()[200..210]);
    assert_eq!(
        (fixture.last(), fixture.session.state()),
        (0.123, DeviceState::Online)
    );
    fixture.device.commandable = true;
    fixture.run(1, &[0.123; 100]);
    assert_eq!(fixture.last(), 0.123);
    assert_eq!(fixture.session.reason(), reason::DEVICE_STOPPED);
}

#[test]
fn a_device_that_is_not_startable_goes_on_but_nothing_begins() {
    let mut fixture = SessionFixture::new();
    fixture.run(1, &usual()[..200]);
    fixture.device.startable = false;
    fixture.run(1, &usual()[200..]);
    fixture.idle(20);
    assert_eq!(fixture.last(), 0.2);
    assert_eq!(fixture.session.state(), DeviceState::Online);
    fixture.run(2, &motion(0.2, 0.1, 300));
    assert_eq!(
        (fixture.last(), fixture.session.reason()),
        (0.2, reason::NOT_STARTABLE)
    );
}

#[test]
fn a_set_point_that_breaks_a_limit_is_not_sent_but_stops_the_arm() {
    let mut fixture = SessionFixture::new();
    let mut points = usual();
    points.iter_mut().skip(250).for_each(|q| *q += 1e-3);
    fixture.run(1, &points);
    assert_eq!(fixture.session.reason(), reason::LIMIT);
    let violation = fixture.session.violation().map(|violation| violation.joint);
    assert_eq!(violation, Some(0));
    fixture.idle(200);
    fixture.check_peaks();
    assert!(fixture.last() < 0.2);
}

#[test]
fn a_driver_asked_to_stop_brings_its_arm_to_rest_and_follows_no_further_net() {
    let mut fixture = SessionFixture::new();
    fixture.run(1, &usual()[..200]);
    fixture.session.terminate();
    fixture.run(1, &usual()[200..]);
    assert!(!fixture.session.phase.is_engaged());
    fixture.check_peaks();
    let rest = fixture.last();
    fixture.idle(5);
    fixture.run(2, &motion(rest, 0.1, 300));
    assert_eq!(fixture.last(), rest);
    assert_eq!(fixture.session.reason(), reason::TERMINATING);
}

#[test]
fn a_driver_that_starts_while_its_device_follows_begins_where_the_device_holds_itself() {
    let elsewhere = [0.7; JOINTS_MAX];
    let mut fixture = SessionFixture::new();
    fixture.device.mirror = elsewhere;
    fixture.session = session(fixture.session.settings);
    fixture.exchange();
    assert_eq!(fixture.session.position, elsewhere);
    // The same after a loss of the device, when its position is unknown.
    let mut fixture = SessionFixture::new();
    fixture.device.mirror = elsewhere;
    fixture.session.lose_device();
    fixture.exchange();
    assert_eq!(fixture.session.position, elsewhere);
}
