use rcc_core::path::{Leg, Limits};
use rcc_core::pose::Pose;

use super::*;

const LINE: Limits = Limits {
    velocity: 0.2,
    acceleration: 1.0,
    jerk: 10.0,
};
const TURN: Limits = Limits {
    velocity: 1.0,
    acceleration: 4.0,
    jerk: 40.0,
};
const DT: f64 = 1e-3;

fn from() -> Pose {
    Pose::from_xyz_rpy([0.5, -0.1, 0.4], [3.0, 0.2, -0.3])
}

fn line(to: Pose) -> Result<MotionSet, PrepareFault> {
    let mut builder = Builder::new(&[], &[], DT, 1);
    let request = PathRequest {
        device: 0,
        from: Some(from()),
        legs: &[Leg {
            line: LINE,
            turn: TURN,
            ..Leg::new(Segment::Line { to })
        }],
        joints: false,
    };
    builder.path(0, &request)?;
    builder.finish()
}

fn step(motions: &mut MotionSet, stop: bool) -> MotionState {
    motions.step(0, Drive { stop, ..Drive::RUN }).unwrap()
}

#[test]
fn a_line_begins_at_its_start_and_is_straight() {
    let to = Pose::from_xyz_rpy([0.4, 0.1, 0.5], [3.0, 0.0, 0.0]);
    let mut motions = line(to).unwrap();
    assert!(step(&mut motions, false).pose.distance_to(&from()) < 1e-12);
    let whole = from().distance_to(&to);
    for _ in 0..500 {
        let state = step(&mut motions, false);
        let fraction = state.distance / whole;
        let places = state.pose.position.iter().zip(from().position);
        for ((at, from), to) in places.zip(to.position) {
            assert!((at - (from + fraction * (to - from))).abs() < 1e-12);
        }
    }
    assert!(step(&mut motions, false).distance > 0.01);
}

#[test]
fn a_line_to_where_it_begins_is_done_at_once() {
    let mut motions = line(from()).unwrap();
    let state = step(&mut motions, false);
    assert!(state.path.done && state.pose.distance_to(&from()) < 1e-12);
}

#[test]
fn the_limits_of_line_and_turn_both_hold() {
    for (turn, by) in [(0.01, "line"), (2.5, "turn")] {
        let to = from().compose(&Pose::from_xyz_rpy([0.1, 0.0, 0.0], [turn, 0.0, 0.0]));
        let mut motions = line(to).unwrap();
        let mut last = step(&mut motions, false).pose;
        let mut fastest = [0.0_f64; 2];
        loop {
            let state = step(&mut motions, false);
            fastest[0] = fastest[0].max(state.pose.distance_to(&last) / DT);
            fastest[1] = fastest[1].max(state.pose.angle_to(&last) / DT);
            last = state.pose;
            if state.path.done {
                break;
            }
        }
        assert!(fastest[0] <= 0.2 * (1.0 + 1e-9), "{by}: {fastest:?}");
        assert!(fastest[1] <= 1.0 + 1e-6, "{by}: {fastest:?}");
    }
}

#[test]
fn turning_by_half_a_turn_is_refused() {
    let half = Pose::from_xyz_rpy([0.1, 0.0, 0.0], [core::f64::consts::PI, 0.0, 0.0]);
    let refused = line(from().compose(&half)).unwrap_err();
    let fault = MotionFault::AmbiguousRotation;
    let (motion, leg) = (0, 0);
    assert_eq!(refused, PrepareFault::Motion { motion, leg, fault });
}

#[test]
fn motions_go_on_from_their_words() {
    let to = Pose::from_xyz_rpy([0.4, 0.1, 0.5], [3.0, 0.0, 0.0]);
    let mut motions = line(to).unwrap();
    let fresh = motions.clone();
    for cycle in 0..900 {
        let mut copy = fresh.clone();
        let mut words = Vec::new();
        motions.save(|piece| words.extend_from_slice(piece));
        assert_eq!(words.len(), motions.words());
        copy.restore(&words).unwrap();
        let stop = cycle >= 400;
        assert_eq!(step(&mut copy, stop).path, step(&mut motions, stop).path);
    }
    assert_eq!(motions.restore(&[0; 3]), None, "of other motions");
}
