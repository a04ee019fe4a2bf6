use rcc_core::frame::PrepareFault;
use rcc_core::path::{
    Leg, MotionBuilder, MotionFault, MotionLimits, PathRequest, PathSegment, Quantity,
    SpeedProfile, StopReserve,
};
use rcc_core::pose::Pose;
use rcc_testing::arms::{HOLD as START, lwr};

use super::*;

const LINE: MotionLimits = MotionLimits {
    velocity: 0.2,
    acceleration: 1.0,
    jerk: 10.0,
};
const TURN: MotionLimits = MotionLimits {
    velocity: 1.0,
    acceleration: 4.0,
    jerk: 40.0,
};
const DT: f64 = 1e-3;

fn from() -> Pose {
    lwr().arm.unwrap().forward(&START)
}

/// A line of the arm that is held at [`START`].
fn line_from(from: Option<Pose>, to: Pose) -> Result<MotionSet, PrepareFault> {
    let (models, holds) = ([lwr()], [Some(START)]);
    let mut builder = MotionSetBuilder::new(&models, &holds, DT, 1);
    let request = PathRequest {
        device: 0,
        from,
        legs: &[Leg {
            line: LINE,
            turn: TURN,
            ..Leg::new(PathSegment::Line { to })
        }],
        pace: SpeedProfile::Uniform,
    };
    builder.path(0, &request)?;
    builder.finish()
}

fn line(to: Pose) -> Result<MotionSet, PrepareFault> {
    line_from(None, to)
}

fn step(motions: &mut MotionSet, stop: bool) -> MotionState {
    motions
        .step(
            0,
            SpeedOverride {
                stop,
                ..SpeedOverride::RUN
            },
        )
        .unwrap()
}

#[test]
fn a_line_begins_at_its_start_and_is_straight() {
    let to = from().compose(&Pose::from_xyz_rpy([0.1, -0.15, 0.1], [0.2, 0.0, 0.1]));
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
fn a_line_from_elsewhere_begins_there_with_the_joints_near_the_hold() {
    let arm = lwr().arm.unwrap();
    let elsewhere = from().compose(&Pose::from_xyz_rpy([0.0, 0.1, 0.0], [0.0, 0.2, 0.0]));
    let mut motions = line_from(Some(elsewhere), from()).unwrap();
    let first = step(&mut motions, false);
    assert!(first.pose.distance_to(&elsewhere) < 1e-12 && first.distance == 0.0);
    assert!(arm.forward(&first.joints).distance_to(&elsewhere) < 1e-9);
    let [hold, there] = [START, first.joints].map(|joints| arm.configuration(&joints));
    assert_eq!(there.branch, hold.branch);
    assert!((there.arm_angle - hold.arm_angle).abs() < 1e-9);
    // It goes to the hold pose, and so to the hold joints.
    let last = (0..10_000).map(|_| step(&mut motions, false));
    let last = last.into_iter().find(|state| state.path.done).unwrap();
    for (joint, hold) in last.joints.iter().zip(START).take(7) {
        assert!((joint - hold).abs() < 1e-9);
    }
}

#[test]
fn a_line_from_where_the_arm_cannot_be_is_refused_there() {
    let away = Pose::from_xyz_rpy([2.0, 0.0, 0.4], [3.0, 0.0, 0.0]);
    let refused = line_from(Some(away), from()).unwrap_err();
    let fault = MotionFault::Unreachable { fraction: 0.0 };
    let (motion, leg) = (0, 0);
    assert_eq!(refused, PrepareFault::Motion { motion, leg, fault });
}

#[test]
fn a_speed_is_kept_on_a_line_or_refused_with_one_that_is_possible() {
    let to = from().compose(&Pose::from_xyz_rpy([0.1, -0.1, 0.0], [0.0; 3]));
    let at = |velocity| {
        let (models, holds) = ([lwr()], [Some(START)]);
        let mut builder = MotionSetBuilder::new(&models, &holds, DT, 1);
        let leg = Leg {
            line: MotionLimits::of([velocity, f64::NAN, f64::NAN]),
            ..Leg::new(PathSegment::Line { to })
        };
        let request = PathRequest {
            device: 0,
            from: None,
            legs: &[leg],
            pace: SpeedProfile::Uniform,
        };
        builder
            .path(0, &request)
            .map(|()| builder.finish().unwrap())
    };
    let fault = at(9.0).unwrap_err();
    let PrepareFault::Motion {
        fault:
            MotionFault::TooFast {
                quantity: Quantity::Joint(_),
                possible,
                value,
                limit,
                ..
            },
        ..
    } = fault
    else {
        panic!("{fault:?}")
    };
    assert!(possible > 0.0 && possible < 1.0 && value > limit);
    at(9.0 * possible * 0.999).unwrap();
    let mut slow = at(0.05).unwrap();
    let speeds = (0..4000).map(|_| step(&mut slow, false).speed);
    assert!((speeds.fold(0.0, f64::max) - 0.05).abs() < 1e-9);
}

#[test]
fn a_turn_on_the_spot_with_a_speed_for_lines_is_as_fast_as_the_joints_allow() {
    let (models, holds) = ([lwr()], [Some(START)]);
    let mut builder = MotionSetBuilder::new(&models, &holds, DT, 1);
    let to = from().compose(&Pose::from_xyz_rpy([0.0; 3], [0.3, 0.0, 0.0]));
    let leg = Leg {
        line: MotionLimits::of([0.1, f64::NAN, f64::NAN]),
        ..Leg::new(PathSegment::Line { to })
    };
    let request = PathRequest {
        device: 0,
        from: None,
        legs: &[leg],
        pace: SpeedProfile::Uniform,
    };
    builder.path(0, &request).unwrap();
    let mut motions = builder.finish().unwrap();
    let ends = (0..2000).map(|_| step(&mut motions, false));
    let end = ends.into_iter().find(|state| state.path.done).unwrap();
    assert!(end.pose.angle_to(&to) < 1e-9);
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
fn a_rotation_by_half_a_turn_is_refused() {
    let half = Pose::from_xyz_rpy([0.1, 0.0, 0.0], [core::f64::consts::PI, 0.0, 0.0]);
    let refused = line(from().compose(&half)).unwrap_err();
    let fault = MotionFault::AmbiguousRotation;
    let (motion, leg) = (0, 0);
    assert_eq!(refused, PrepareFault::Motion { motion, leg, fault });
}

#[test]
fn motions_continue_from_their_saved_words() {
    let to = from().compose(&Pose::from_xyz_rpy([0.1, -0.15, 0.1], [0.2, 0.0, 0.1]));
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
    assert_eq!(motions.restore(&[0; 3]), None, "words of other motions");
}

#[test]
fn a_line_is_never_too_short_for_the_speed_that_is_given() {
    for decade in -100..-10 {
        let way = 10.0_f64.powf(f64::from(decade) / 10.0);
        let to = from().compose(&Pose::from_xyz_rpy([0.0, way, way], [0.0; 3]));
        let built = line(to);
        assert!(built.is_ok(), "{way} m: {built:?}");
        let turn = Pose::from_xyz_rpy([way, 0.0, 0.0], [0.0, way, 0.0]);
        let built = line(from().compose(&turn));
        assert!(built.is_ok(), "{way} m: {built:?}");
    }
}

const FASTEST: SpeedProfile = SpeedProfile::TimeOptimal(StopReserve::Keep);
const FASTEST_GIVE: SpeedProfile = SpeedProfile::TimeOptimal(StopReserve::Give);

/// Over an obstacle: up, aside, down, with blended corners.
fn over(pace: SpeedProfile) -> MotionSet {
    over_with(pace, |_| ())
}

/// The same with changed legs.
fn over_with(pace: SpeedProfile, change: impl Fn(&mut [Leg<'_>; 3])) -> MotionSet {
    let (models, holds) = ([lwr()], [Some(START)]);
    let mut builder = MotionSetBuilder::new(&models, &holds, DT, 1);
    let mut to = from();
    let mut legs = [[0.0, 0.0, 0.15], [-0.06, -0.3, 0.0], [0.0, 0.0, -0.15]].map(|way| {
        let places = to.position.iter_mut().zip(way);
        places.for_each(|(place, way)| *place += way);
        Leg {
            blend: 0.04,
            ..Leg::new(PathSegment::Line { to })
        }
    });
    change(&mut legs);
    let request = PathRequest {
        device: 0,
        from: None,
        legs: &legs,
        pace,
    };
    builder.path(0, &request).unwrap();
    builder.finish().unwrap()
}

#[test]
fn a_stop_of_a_time_optimal_motion_that_has_just_begun_is_as_short_as_the_jerk_allows() {
    let [(sooner, _), (later, _)] = [FASTEST, SpeedProfile::Uniform].map(|pace| end_of(over(pace)));
    assert!(sooner < later, "the time law has begun: {sooner} {later}");
    for cycles in [1, 2, 10, 30, 50] {
        let mut motions = over(FASTEST);
        let mut begun = step(&mut motions, false);
        for _ in 1..cycles {
            begun = step(&mut motions, false);
        }
        // With the constant jerk j the speed is v = jt²/2 after t; the shortest way to rest with the same jerk is 11jt³/6.
        let took = f64::from(cycles) * DT;
        let way_max = 1e-9 + 1.35 * 11.0 / 3.0 * begun.speed * took;
        // Increase of the speed while the jerk limit reduces the acceleration to 0.
        let rise = begun.acceleration * begun.acceleration / (2.0 * 2.0);
        let mut words = Vec::new();
        let mut state = step(&mut motions, true);
        motions.save(|some| words.extend_from_slice(some));
        let mut again = over(FASTEST);
        again.restore(&words).unwrap();
        let mut last = begun;
        while !state.path.done {
            assert!(
                state.speed <= begun.speed + rise + 1e-3,
                "{cycles}: {state:?}"
            );
            assert!(state.path.s >= last.path.s && state.progress >= last.progress);
            last = state;
            state = step(&mut motions, true);
            assert_eq!(step(&mut again, true), state, "continues from its words");
        }
        let way = state.distance - begun.distance;
        assert!((0.0..=way_max).contains(&way), "{cycles}: {way} m");
        assert_eq!(step(&mut motions, false), state, "for good");
    }
}

#[test]
fn a_stop_from_the_full_speed_of_a_time_optimal_motion_is_one_checked_for_its_state() {
    // With limits for any state of a part of the path a stop took 379, 403 and 393 cycles.
    for pace in [FASTEST, FASTEST_GIVE] {
        for (cycles, most) in [(100, 250), (150, 200), (200, 170)] {
            let mut motions = over(pace);
            for _ in 0..cycles {
                step(&mut motions, false);
            }
            let took = (0..20_000).find(|_| step(&mut motions, true).path.done);
            assert!(
                took.is_some_and(|took| took <= most),
                "{pace:?} {cycles}: {took:?}"
            );
        }
    }
}

/// The state at the end of a motion that nothing slows down, and the number of cycles until then.
fn end_of(mut motions: MotionSet) -> (usize, MotionState) {
    let states = (0..20_000).map(|_| step(&mut motions, false));
    let mut numbered = states.enumerate();
    numbered.find(|(_, state)| state.path.done).expect("an end")
}

#[test]
fn a_motion_that_gives_its_reserve_ends_sooner_and_pauses_later() {
    let [(kept, _), (given, _)] = [FASTEST, FASTEST_GIVE].map(|pace| end_of(over(pace)));
    assert!(given < kept, "{given} {kept}");
    let slowest = [FASTEST, FASTEST_GIVE].map(|pace| {
        let mut motions = over(pace);
        for _ in 0..100 {
            step(&mut motions, false);
        }
        let states = (0..100).map(|_| motions.step(0, SpeedOverride::PAUSE).expect("a motion"));
        states.map(|state| state.path.velocity).fold(1.0, f64::min)
    });
    let [with_reserve, with_hardly_any] = slowest;
    assert!(with_reserve < with_hardly_any, "{slowest:?}");
}

#[test]
fn a_stop_at_any_time_of_a_time_optimal_motion_ends_before_its_end_or_there() {
    for pace in [FASTEST, FASTEST_GIVE] {
        let (_, whole) = end_of(over(pace));
        for cycles in (1..1700).step_by(61) {
            let mut motions = over(pace);
            let mut last = step(&mut motions, false);
            for _ in 1..cycles {
                last = step(&mut motions, false);
            }
            for _ in 0..4000 {
                let state = step(&mut motions, true);
                assert!(state.path.s >= last.path.s && state.distance >= last.distance - 1e-12);
                last = state;
            }
            assert!(
                last.path.done && last.path.stopping,
                "{pace:?} {cycles}: {last:?}"
            );
            assert!(last.distance <= whole.distance + 1e-12);
        }
    }
}

#[test]
fn a_motion_that_is_slow_because_its_speed_is_given_says_how_much_and_why() {
    let given = |legs: &mut [Leg<'_>; 3]| {
        for leg in legs {
            leg.line.velocity = 0.5;
        }
    };
    let of = |pace| over_with(pace, given);
    let slow: Vec<_> = of(SpeedProfile::Adaptive).slow().collect();
    let [(0, slow)] = slow[..] else {
        panic!("{slow:?}");
    };
    let [kept_s, uniform_s, fastest_s] = [SpeedProfile::Adaptive, SpeedProfile::Uniform, FASTEST]
        .map(|pace| end_of(of(pace)).0 as f64 * DT);
    assert_eq!(kept_s, uniform_s, "the speed is kept");
    assert!(
        (slow.takes_s - kept_s).abs() < 2.0 * DT,
        "{slow:?} {kept_s}"
    );
    assert!(
        (0.8 * fastest_s..kept_s / 1.3).contains(&slow.possible_s),
        "{slow:?} {fastest_s}"
    );
    assert!((0..3).contains(&slow.leg) && (0.0..=1.0).contains(&slow.fraction));
    for pace in [FASTEST, SpeedProfile::Uniform] {
        assert_eq!(of(pace).slow().count(), 0, "{pace:?}");
    }
}

#[test]
fn without_a_given_speed_the_default_follows_a_time_law_and_reports_nothing() {
    let motions = over(SpeedProfile::Adaptive);
    assert_eq!(motions.slow().count(), 0);
    let scaling: Vec<_> = motions.sections().map(|(_, it)| it.time_scaling).collect();
    assert_eq!(scaling, [crate::TimeScaling::Adapted]);
    let [adaptive, uniform, fastest] = [SpeedProfile::Adaptive, SpeedProfile::Uniform, FASTEST]
        .map(|pace| end_of(over(pace)).0 as f64);
    assert!(
        adaptive <= 0.95 * uniform && adaptive <= 1.3 * fastest,
        "{adaptive} cycles, uniform {uniform}, fastest {fastest}"
    );
}
