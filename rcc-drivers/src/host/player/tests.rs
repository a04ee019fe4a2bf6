//! The rules of the player in virtual time: an executor and a device with periods of 1 ms, each of which may stall.
//! Test code only.

use rcc_core::message::JOINTS_MAX;

use super::*;

mod bench;
mod direct;

use bench::{Bench, DELAY, MS, at, motion, usual};

#[test]
fn after_the_delay_every_set_point_is_sent_once_with_its_own_outputs() {
    let mut bench = Bench::new();
    let points = usual();
    let mut outputs = Vec::new();
    for cycle in 0..points.len() + DELAY as usize {
        let q = points.get(cycle).or(points.last()).copied().unwrap_or(0.0);
        bench.both(at(1, q));
        outputs.push((bench.player.outputs().digital, bench.last()));
        assert_eq!(bench.player.state(), DeviceState::Commanded);
        assert_eq!(bench.player.settled_ns(), 0);
    }
    let delay = DELAY as usize;
    assert_eq!(bench.positions()[delay..], points);
    assert_eq!(bench.positions()[..delay], [0.0; DELAY as usize]);
    assert_eq!(bench.player.margin(), DELAY);
    for (digital, q) in outputs {
        assert_eq!(digital, u64::from(q > 0.1), "at {q}");
    }
}

#[test]
fn a_net_that_ends_at_rest_leaves_the_arm_ready_and_settled() {
    let mut bench = Bench::new();
    bench.run(1, &usual());
    bench.idle(DELAY - 1);
    assert_eq!(bench.player.state(), DeviceState::Commanded);
    bench.idle(1);
    assert_eq!(
        (bench.last(), bench.player.state()),
        (0.2, DeviceState::Commanded)
    );
    bench.idle(1);
    assert_eq!(bench.player.state(), DeviceState::Ready);
    assert_eq!(bench.player.settled_ns(), bench.image.head.sequence * MS);
    assert_eq!(bench.player.reason(), 0);
}

#[test]
fn outputs_are_those_of_the_newest_cycle_when_nobody_commands_the_joints() {
    let mut bench = Bench::new();
    let only_output = SetPoint {
        digital: 0b10,
        digital_commanded: 0b10,
        ..SetPoint::NONE
    };
    bench.both(only_output);
    assert_eq!(bench.player.outputs().digital, 0b10);
    assert_eq!(bench.player.state(), DeviceState::Ready);
}

#[test]
fn outputs_do_not_change_while_set_points_wait() {
    let mut bench = Bench::new();
    for _ in 0..DELAY {
        bench.both(at(1, 0.0));
        assert_eq!(bench.player.outputs().digital_commanded, 0);
    }
    bench.both(at(1, 0.0));
    assert_eq!(bench.player.outputs().digital_commanded, 1);
}

#[test]
fn a_first_set_point_elsewhere_is_refused_and_nothing_moves() {
    let mut bench = Bench::new();
    bench.run(1, &motion(0.01, 0.2, 400));
    assert_eq!(bench.last(), 0.0);
    assert_eq!(bench.player.reason(), reason::FIRST_SET_POINT);
    assert_eq!(bench.player.state(), DeviceState::Online);
    bench.idle(1);
    assert_eq!(bench.player.state(), DeviceState::Ready);
}

#[test]
fn what_the_tolerance_allows_is_bridged_smoothly() {
    let mut bench = Bench::new();
    let points = motion(0.0019, 0.2, 400);
    bench.run(1, &points);
    (0..DELAY).for_each(|_| bench.both(at(1, points[400])));
    assert_eq!(bench.last(), points[400]);
    bench.check_peaks();
}

#[test]
fn a_late_executor_slows_the_motion_on_its_path_and_the_margin_comes_back() {
    let mut bench = Bench::new();
    let points = motion(0.0, 1.0, 2000);
    let (early, rest) = points.split_at(800);
    bench.run(1, early);
    bench.device_alone(7);
    assert!((DELAY - 7..DELAY - 5).contains(&bench.player.margin()));
    bench.run(1, rest);
    assert_eq!(bench.player.counts(), PlayerCounts::default());
    assert!(
        bench.player.margin() >= DELAY - 1,
        "{}",
        bench.player.margin()
    );
    bench.check_peaks();
    for (_, q) in &bench.sent {
        assert!((q[1] - 0.5 * q[0]).abs() < 1e-15, "off the path");
    }
    bench.idle(DELAY + 5);
    assert_eq!(
        (bench.last(), bench.player.state()),
        (1.0, DeviceState::Ready)
    );
}

#[test]
fn a_device_that_stalled_loses_no_set_point_and_catches_up() {
    let mut bench = Bench::new();
    let points = motion(0.0, 1.0, 2000);
    for (cycle, q) in points.iter().enumerate() {
        bench.now_ns += MS;
        bench.write(at(1, *q));
        if (500..530).contains(&cycle) {
            bench.observe();
        } else {
            bench.exchange();
        }
        if cycle == 530 {
            assert_eq!(bench.player.margin(), DELAY + 30);
        }
    }
    assert!(
        bench.player.margin() <= DELAY + 1,
        "{}",
        bench.player.margin()
    );
    assert_eq!(bench.player.counts(), PlayerCounts::default());
    bench.check_peaks();
}

#[test]
fn lost_device_periods_count_as_time() {
    let mut bench = Bench::new();
    let points = usual();
    for (cycle, q) in points.iter().enumerate() {
        bench.now_ns += MS;
        bench.write(at(1, *q));
        match cycle {
            200 | 201 => bench.observe(),
            _ => {
                bench.tick.ticks = if cycle == 202 { 3 } else { 1 };
                bench.exchange();
            }
        }
    }
    assert_eq!(bench.last(), points[400 - DELAY as usize]);
    assert_eq!(bench.player.margin(), DELAY);
}

#[test]
fn when_set_points_end_in_motion_the_arm_comes_to_rest_within_its_limits() {
    let mut bench = Bench::new();
    bench.run(1, &usual()[..200]);
    bench.device_alone(11);
    assert_eq!(bench.player.state(), DeviceState::Stopping);
    assert_eq!(bench.player.counts().starved, 1);
    bench.device_alone(200);
    assert_eq!(bench.player.state(), DeviceState::Online);
    bench.check_peaks();
    let rest = bench.last();
    bench.run(1, &usual()[200..]);
    assert_eq!(bench.last(), rest, "its owner is refused");
    bench.idle(1);
    bench.run(2, &motion(rest, 0.1, 300));
    assert_eq!(bench.player.state(), DeviceState::Commanded);
    assert!(bench.last() > rest, "another owner is followed");
}

#[test]
fn null_in_motion_brings_the_arm_to_rest_and_releases_outputs_at_once() {
    let mut bench = Bench::new();
    bench.run(1, &usual()[..300]);
    bench.idle(DELAY + 1);
    assert_eq!(bench.player.state(), DeviceState::Stopping);
    assert_eq!(bench.player.reason(), reason::RELEASED_MOVING);
    assert_eq!(bench.player.outputs().digital_commanded, 0);
    assert_eq!(bench.player.settled_ns(), 0);
    bench.idle(300);
    assert_eq!(bench.player.state(), DeviceState::Ready);
    bench.check_peaks();
}

#[test]
fn a_start_while_the_arm_is_being_stopped_is_refused() {
    let mut bench = Bench::new();
    bench.run(1, &usual()[..300]);
    bench.idle(DELAY + 1);
    let points: Vec<f64> = vec![bench.last(); 400];
    bench.run(2, &points);
    assert_eq!(bench.player.reason(), reason::NOT_STARTABLE);
    assert_eq!(bench.player.state(), DeviceState::Online);
}

#[test]
fn a_stale_board_at_rest_releases_outputs_and_its_net() {
    let mut bench = Bench::new();
    let points = usual();
    bench.run(1, &points);
    (0..20).for_each(|_| bench.both(at(1, 0.2)));
    assert_eq!(bench.player.outputs().digital_commanded, 1);
    bench.device_alone(51);
    assert_eq!(bench.player.outputs().digital_commanded, 0);
    assert_eq!(bench.player.executor(), 0);
    bench.device_alone(5);
    assert_eq!(bench.player.state(), DeviceState::Online);
    (0..100).for_each(|_| bench.both(at(1, 0.2)));
    assert_eq!(
        bench.player.state(),
        DeviceState::Online,
        "the same net is not followed again"
    );
    assert_eq!(bench.last(), 0.2);
}

#[test]
fn a_board_stamped_in_the_future_is_as_stale_as_an_old_one() {
    let mut bench = Bench::new();
    bench.now_ns += MS;
    bench.write(SetPoint::NONE);
    bench.image.head.stamp_ns = bench.now_ns + 1_000 * MS;
    bench.exchange();
    assert_eq!(bench.player.executor(), 0);
    assert_ne!(bench.player.state(), DeviceState::Ready);
}

#[test]
fn when_the_executor_goes_in_motion_the_arm_comes_to_rest() {
    let mut bench = Bench::new();
    bench.run(1, &usual()[..200]);
    bench.connected = false;
    bench.device_alone(1);
    assert_eq!(bench.player.state(), DeviceState::Stopping);
    assert_eq!(bench.player.reason(), reason::NO_EXECUTOR);
    assert_eq!(bench.player.outputs().digital_commanded, 0);
    bench.device_alone(200);
    bench.check_peaks();
    bench.sent.clear();
    bench.device_alone(50);
    assert_eq!(bench.peaks()[0], 0.0);
}

#[test]
fn another_executor_is_not_followed_in_motion() {
    let mut bench = Bench::new();
    bench.run(1, &usual()[..200]);
    bench.image.head.executor = 8;
    bench.run(1, &usual()[200..]);
    assert_eq!(bench.player.state(), DeviceState::Online);
    bench.check_peaks();
    bench.idle(1);
    assert_eq!(
        (bench.player.state(), bench.player.executor()),
        (DeviceState::Ready, 8)
    );
}

#[test]
fn set_points_that_go_on_under_another_owner_are_followed() {
    let mut bench = Bench::new();
    let points = usual();
    bench.run(1, &points[..200]);
    bench.run(2, &points[200..]);
    (0..DELAY).for_each(|_| bench.both(at(2, 0.2)));
    assert_eq!(bench.positions()[DELAY as usize..], points);
}

#[test]
fn a_net_that_follows_a_cycle_later_begins_without_a_gap_of_its_own() {
    let mut bench = Bench::new();
    let (there, back) = (usual(), motion(0.2, -0.2, 400));
    bench.run(1, &there);
    bench.idle(1);
    bench.run(2, &back);
    (0..DELAY).for_each(|_| bench.both(at(2, 0.0)));
    let positions = bench.positions();
    let start = DELAY as usize;
    assert_eq!(positions[start..start + there.len()], there);
    assert_eq!(positions[start + there.len()], 0.2);
    assert_eq!(positions[start + there.len() + 1..], back);
}

#[test]
fn a_driver_that_comes_back_does_not_move() {
    let mut bench = Bench::new();
    bench.run(1, &usual()[..200]);
    let mut again = Bench::new();
    again.player = Player::new(bench.player.settings);
    again.image = bench.image;
    again.now_ns = bench.now_ns;
    again.tick.mirror = *bench.player.position();
    again.tick.commandable = false;
    again.exchange();
    again.tick.commandable = true;
    again.sent.clear();
    again.run(1, &usual()[200..]);
    assert_eq!(again.peaks()[0], 0.0);
    assert_eq!(again.player.reason(), reason::ALREADY_COMMANDED);
    assert_eq!(again.player.state(), DeviceState::Online);
}

#[test]
fn a_device_that_left_command_mode_is_mirrored_and_its_net_is_not_followed_again() {
    let mut bench = Bench::new();
    bench.run(1, &usual()[..200]);
    bench.tick.commandable = false;
    bench.tick.mirror[0] = 0.123;
    bench.run(1, &usual()[200..210]);
    assert_eq!(
        (bench.last(), bench.player.state()),
        (0.123, DeviceState::Online)
    );
    bench.tick.commandable = true;
    bench.run(1, &[0.123; 100]);
    assert_eq!(bench.last(), 0.123);
    assert_eq!(bench.player.reason(), reason::DEVICE_STOPPED);
}

#[test]
fn a_device_that_is_not_startable_goes_on_but_nothing_begins() {
    let mut bench = Bench::new();
    bench.run(1, &usual()[..200]);
    bench.tick.startable = false;
    bench.run(1, &usual()[200..]);
    bench.idle(20);
    assert_eq!(bench.last(), 0.2);
    assert_eq!(bench.player.state(), DeviceState::Online);
    bench.run(2, &motion(0.2, 0.1, 300));
    assert_eq!(
        (bench.last(), bench.player.reason()),
        (0.2, reason::NOT_STARTABLE)
    );
}

#[test]
fn a_set_point_that_breaks_a_limit_is_not_sent_but_stops_the_arm() {
    let mut bench = Bench::new();
    let mut points = usual();
    points.iter_mut().skip(250).for_each(|q| *q += 1e-3);
    bench.run(1, &points);
    assert_eq!(bench.player.reason(), reason::LIMIT);
    let violation = bench.player.violation().map(|violation| violation.joint);
    assert_eq!(violation, Some(0));
    bench.idle(200);
    bench.check_peaks();
    assert!(bench.last() < 0.2);
}

#[test]
fn a_driver_asked_to_stop_brings_its_arm_to_rest_and_follows_nobody() {
    let mut bench = Bench::new();
    bench.run(1, &usual()[..200]);
    bench.player.terminate();
    bench.run(1, &usual()[200..]);
    assert!(bench.player.is_holding());
    bench.check_peaks();
    let rest = bench.last();
    bench.idle(5);
    bench.run(2, &motion(rest, 0.1, 300));
    assert_eq!(bench.last(), rest);
    assert_eq!(bench.player.reason(), reason::TERMINATING);
}

#[test]
fn what_the_driver_slept_through_is_played_at_once_if_the_device_has_gone_on() {
    let mut bench = Bench::new();
    let points = motion(0.0, 1.0, 2000);
    bench.run(1, &points[..1000]);
    for q in &points[1000..1039] {
        bench.now_ns += MS;
        bench.write(at(1, *q));
    }
    bench.tick.ticks = 40;
    bench.run(1, &points[1039..=1039]);
    bench.tick.ticks = 1;
    assert!((bench.last() - points[1039 - DELAY as usize]).abs() < 1e-12);
    bench.run(1, &points[1040..]);
    (0..DELAY).for_each(|_| bench.both(at(1, 1.0)));
    assert_eq!((bench.player.reason(), bench.last()), (0, 1.0));
}

#[test]
fn a_device_that_falls_behind_by_more_than_the_time_out_stops() {
    let mut bench = Bench::new();
    let points = motion(0.0, 1.0, 2000);
    bench.run(1, &points[..1000]);
    for q in &points[1000..1060] {
        bench.now_ns += MS;
        bench.write(at(1, *q));
    }
    bench.run(1, &points[1060..1100]);
    assert_eq!(bench.player.reason(), reason::SET_POINTS_LOST);
    bench.check_peaks();
}

#[test]
fn at_rest_the_delay_is_won_back_without_slowing_anything() {
    let mut bench = Bench::new();
    let points = usual();
    (0..50).for_each(|_| bench.both(at(1, 0.0)));
    bench.device_alone(8);
    (0..20).for_each(|_| bench.both(at(1, 0.0)));
    assert_eq!(bench.player.margin(), DELAY);
    bench.sent.clear();
    bench.run(1, &points);
    assert_eq!(
        bench.positions()[DELAY as usize..],
        points[..points.len() - DELAY as usize]
    );
}

#[test]
fn set_points_that_piled_up_in_motion_are_caught_up_smoothly() {
    let mut bench = Bench::new();
    let points = motion(0.0, 1.0, 2000);
    bench.run(1, &points[..700]);
    for q in &points[700..704] {
        // The device stands still for 4 ms; the executor does not.
        bench.now_ns += MS;
        bench.write(at(1, *q));
    }
    bench.run(1, &points[704..720]);
    assert_eq!(bench.player.margin(), DELAY + 4);
    bench.run(1, &points[720..1200]);
    assert!(
        bench.player.margin() <= DELAY + 1,
        "{}",
        bench.player.margin()
    );
    assert_eq!(bench.player.counts(), PlayerCounts::default());
    bench.check_peaks();
    for (_, q) in &bench.sent {
        assert!((q[1] - 0.5 * q[0]).abs() < 1e-15, "off the path");
    }
}

#[test]
fn equal_set_points_that_piled_up_at_rest_are_left_out_at_once() {
    let mut bench = Bench::new();
    (0..50).for_each(|_| bench.both(at(1, 0.0)));
    for _ in 0..5 {
        bench.now_ns += MS;
        bench.write(at(1, 0.0));
    }
    bench.both(at(1, 0.0));
    assert_eq!(bench.player.margin(), DELAY);
    bench.sent.clear();
    let points = usual();
    bench.run(1, &points);
    assert_eq!(
        bench.positions()[DELAY as usize..],
        points[..points.len() - DELAY as usize]
    );
}

#[test]
fn a_driver_that_starts_while_its_device_follows_begins_where_the_device_holds_itself() {
    let elsewhere = [0.7; JOINTS_MAX];
    let mut bench = Bench::new();
    let tick = Tick {
        mirror: elsewhere,
        ..bench.tick
    };
    let mut player = Player::new(bench.player.settings);
    player.tick(&tick);
    assert_eq!(*player.position(), elsewhere);
    // And after it was out of reach for so long that nobody knows where it is.
    bench.player.lose();
    bench.player.tick(&tick);
    assert_eq!(*bench.player.position(), elsewhere);
}
