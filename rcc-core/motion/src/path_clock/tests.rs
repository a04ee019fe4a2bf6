//! The path clock keeps its limits, never goes back, ends exactly, and is as fast as rsruckig's plans from rest to
//! rest.

use super::*;
use proptest::prelude::*;
use rsruckig::prelude::{
    ControlInterface, DataArrayOrVec, InputParameter, Ruckig, ThrowErrorHandler, Trajectory,
};

mod random;

const DT: f64 = 1e-3;
const LINE: PathLimits = PathLimits {
    length: 0.5,
    velocity: 0.25,
    acceleration: 1.0,
    jerk: 10.0,
};

pub(super) const RUN: SpeedOverride = SpeedOverride::RUN;

pub(super) const STOP: SpeedOverride = SpeedOverride::STOP;
const PAUSE: SpeedOverride = SpeedOverride::PAUSE;

fn at(speed: f64) -> SpeedOverride {
    SpeedOverride { speed, ..RUN }
}

pub(super) fn line() -> PathBounds {
    PathBounds::of_limits(&LINE, DT).unwrap()
}

fn pieces(pieces: &[(f64, f64)]) -> Vec<PathPiece> {
    let piece = |&(end_s, velocity)| PathPiece { end_s, velocity };
    pieces.iter().map(piece).collect()
}

/// Fast, slower, much slower, fast again.
pub(super) fn stairs() -> PathBounds {
    let pieces = pieces(&[(0.2, 0.2), (0.5, 0.4), (0.7, 0.1), (0.8, 0.02), (1.0, 0.3)]);
    PathBounds::new(&pieces, 1.0, 10.0, DT).unwrap()
}

/// A number whose logarithm is uniformly distributed over `low`..`high`.
fn log_even(low: f64, high: f64) -> impl Strategy<Value = f64> {
    (low.ln()..high.ln()).prop_map(f64::exp)
}

/// Steps until done with the override that `speed_override` returns in each cycle; at most `steps`.
fn run(
    bounds: &PathBounds,
    steps: usize,
    speed_override: impl Fn(usize) -> SpeedOverride,
) -> Vec<PathState> {
    let mut clock = PathClock::new();
    let mut states = Vec::new();
    while states.len() < steps && !states.last().is_some_and(|state: &PathState| state.done) {
        states.push(clock.step(bounds, speed_override(states.len())));
    }
    states
}

fn resting(s: f64) -> PathState {
    PathState {
        s,
        ..PathState::default()
    }
}

fn done(s: f64) -> PathState {
    PathState {
        done: true,
        ..resting(s)
    }
}

fn stopped(s: f64) -> PathState {
    PathState {
        stopping: true,
        ..done(s)
    }
}

#[test]
fn the_first_step_is_the_start_at_rest() {
    let mut clock = PathClock::new();
    let first = clock.step(&line(), RUN);
    assert_eq!(
        (first.s, first.velocity, first.acceleration),
        (0.0, 0.0, 0.0)
    );
    assert!(clock.step(&line(), RUN).s > 0.0);
}

#[test]
fn a_path_without_length_is_done_at_once() {
    let nowhere = PathLimits {
        length: 0.0,
        ..LINE
    };
    let bounds = PathBounds::of_limits(&nowhere, DT).unwrap();
    let mut clock = PathClock::new();
    assert_eq!(clock.step(&bounds, RUN), done(0.0));
    assert_eq!(clock.step(&bounds, STOP), stopped(0.0));
}

#[test]
fn a_stop_before_the_start_never_moves() {
    let mut clock = PathClock::new();
    assert_eq!(clock.step(&line(), STOP), stopped(0.0));
    assert_eq!(clock.step(&line(), RUN).s, 0.0);
}

#[test]
fn a_pause_before_the_start_waits() {
    let mut clock = PathClock::new();
    for _ in 0..10 {
        assert_eq!(clock.step(&line(), PAUSE), resting(0.0));
        assert_eq!(clock.step(&line(), at(0.0)), resting(0.0));
        assert_eq!(clock.step(&line(), at(f64::NAN)), resting(0.0));
    }
    clock.step(&line(), RUN);
    assert!(clock.step(&line(), RUN).s > 0.0);
}

#[test]
fn a_stop_changes_the_step_that_asks_for_it() {
    let (mut stopped, mut free) = (PathClock::new(), PathClock::new());
    for _ in 0..500 {
        assert_eq!(stopped.step(&line(), RUN), free.step(&line(), RUN));
    }
    let (stopped, free) = (stopped.step(&line(), STOP), free.step(&line(), RUN));
    assert!(stopped.stopping && stopped.velocity < free.velocity);
    // One cycle of full jerk from cruising.
    assert!((stopped.acceleration + LINE.jerk * DT).abs() < 1e-12);
    assert_eq!(stopped.jerk, -LINE.jerk);
}

#[test]
fn a_stop_cannot_be_taken_back() {
    let states = run(&line(), 10_000, |step| if step == 700 { STOP } else { RUN });
    let last = states.last().unwrap();
    assert!(last.done && last.stopping && last.s < LINE.length);
    assert_eq!((last.velocity, last.acceleration), (0.0, 0.0));
}

#[test]
fn a_pause_comes_to_rest_like_a_stop_and_goes_on_afterwards() {
    let paused = |step| (700..3000).contains(&step);
    let pausing = run(
        &line(),
        10_000,
        |step| if paused(step) { PAUSE } else { RUN },
    );
    let stopping = run(
        &line(),
        10_000,
        |step| if paused(step) { STOP } else { RUN },
    );
    let rest = stopping.last().unwrap().s;
    assert_eq!(pausing[2999], resting(rest));
    assert_eq!(*pausing.last().unwrap(), done(LINE.length));
}

#[test]
fn a_pause_may_become_a_stop() {
    let states = run(&line(), 10_000, |step| match step {
        700..720 => PAUSE,
        720.. => STOP,
        _ => RUN,
    });
    let direct = run(&line(), 10_000, |step| if step >= 700 { STOP } else { RUN });
    assert_eq!(states.last(), direct.last());
    assert_eq!(states.len(), direct.len());
}

#[test]
fn it_stays_at_the_end() {
    let mut clock = PathClock::new();
    let ends = (0..10_000).find(|_| clock.step(&line(), RUN).done);
    assert!(ends.is_some());
    assert_eq!(clock.step(&line(), RUN), done(LINE.length));
    assert_eq!(clock.step(&line(), PAUSE), done(LINE.length));
    assert_eq!(clock.step(&line(), STOP), stopped(LINE.length));
}

#[test]
fn half_the_speed_cruises_at_half_of_every_limit() {
    let states = run(&stairs(), 100_000, |_| at(0.5));
    assert_eq!(*states.last().unwrap(), done(1.0));
    for (from, to, limit) in [
        (0.1, 0.2, 0.2),
        (0.3, 0.35, 0.4),
        (0.55, 0.65, 0.1),
        (0.71, 0.8, 0.02),
    ] {
        let inside = states.iter().filter(|state| state.s > from && state.s < to);
        let fastest = inside.map(|state| state.velocity).fold(0.0, f64::max);
        assert!(
            (fastest - 0.5 * limit).abs() < 1e-9,
            "{fastest} in {from}..{to}"
        );
    }
}

#[test]
fn a_speed_override_above_1_counts_as_1() {
    assert_eq!(
        run(&stairs(), 100_000, |_| at(7.0)),
        run(&stairs(), 100_000, |_| RUN)
    );
}

#[test]
fn a_lowered_speed_slows_down_at_once_and_not_below_it() {
    let states = run(&line(), 10_000, |step| {
        at(if step >= 700 { 0.4 } else { 1.0 })
    });
    assert_eq!(states[700].jerk, -LINE.jerk);
    let slow = &states[1300..1500];
    assert!(
        slow.iter()
            .all(|state| (state.velocity - 0.1).abs() < 1e-12)
    );
    assert!(
        states
            .iter()
            .skip(700)
            .take(800)
            .all(|state| state.velocity > 0.1 - 1e-12)
    );
}

#[test]
fn it_speeds_up_in_the_step_that_enters_a_faster_piece() {
    let states = run(&stairs(), 100_000, |_| RUN);
    let entered = states
        .iter()
        .position(|state| state.s > 0.2 + 1e-9)
        .unwrap();
    assert!((states[entered - 1].velocity - 0.2).abs() < 1e-12);
    assert!(states[entered].jerk == 10.0 && states[entered].velocity > 0.2);
}

#[test]
fn pieces_of_one_velocity_are_one_piece() {
    let parts = pieces(&[(0.1, 0.25), (0.2, 0.25), (0.2, 0.25), (0.5, 0.25)]);
    let parts = PathBounds::new(&parts, LINE.acceleration, LINE.jerk, DT).unwrap();
    assert_eq!(parts, line());
}

#[test]
fn a_piece_that_is_passed_in_less_than_a_step_takes_the_lower_limit() {
    let parts = pieces(&[(0.25, 0.25), (0.2501, 0.2), (0.5, 0.25)]);
    let bounds = PathBounds::new(&parts, LINE.acceleration, LINE.jerk, DT).unwrap();
    assert!(bounds.velocity_at(0.25005) <= 0.2);
    assert_eq!(*run(&bounds, 10_000, |_| RUN).last().unwrap(), done(0.5));
}

#[test]
fn invalid_limits_are_refused_by_name() {
    let refusal = |limits: PathLimits| PathBounds::of_limits(&limits, DT).unwrap_err();
    let of = |velocity, acceleration, jerk| PathLimits {
        velocity,
        acceleration,
        jerk,
        ..LINE
    };
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        for (limits, name) in [
            (of(bad, 1.0, 1.0), "velocity"),
            (of(1.0, bad, 1.0), "acceleration"),
            (of(1.0, 1.0, bad), "jerk"),
        ] {
            let refusal = refusal(limits);
            assert!(
                matches!(refusal, PathLimitsError::Limit { limit, .. } if limit == name),
                "{refusal:?}"
            );
        }
        assert!(matches!(
            PathBounds::of_limits(&LINE, bad),
            Err(PathLimitsError::CycleTime { .. })
        ));
    }
    for length in [-1.0, f64::NAN, f64::INFINITY] {
        let refusal = refusal(PathLimits { length, ..LINE });
        assert!(matches!(refusal, PathLimitsError::Length { .. }));
    }
    let new = |parts: &[(f64, f64)]| PathBounds::new(&pieces(parts), 1.0, 1.0, DT);
    assert_eq!(new(&[]), Err(PathLimitsError::Empty));
    let order = new(&[(0.5, 1.0), (0.4, 1.0)]).unwrap_err();
    assert!(
        order.to_string().contains("piece 1 of a path ends at 0.4"),
        "{order}"
    );
}

/// rsruckig's duration from rest to rest, in units in which length and jerk are 1, because its tolerances are absolute.
fn ruckig_duration_s(limits: &PathLimits) -> f64 {
    let unit_s = libm::cbrt(limits.length / limits.jerk);
    let mut input = InputParameter::<1>::new(None);
    input.target_position[0] = 1.0;
    input.max_velocity[0] = (limits.velocity * unit_s / limits.length).min(1.0);
    input.max_acceleration[0] = (limits.acceleration * unit_s / limits.length * unit_s).min(1.0);
    input.max_jerk[0] = 1.0;
    input.min_velocity = Some(DataArrayOrVec::Stack([0.0]));
    let mut trajectory = Trajectory::<1>::new(None);
    let mut planner = Ruckig::<1, ThrowErrorHandler>::new(None, 1.0);
    planner.calculate(&input, &mut trajectory).unwrap();
    trajectory.get_duration() * unit_s
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20_000))]

    #[test]
    fn from_rest_to_rest_it_takes_as_long_as_rsruckigs_plan(
        length in log_even(1e-5, 10.0), velocity in log_even(1e-3, 10.0),
        acceleration in log_even(1e-2, 100.0), jerk in log_even(1e-1, 1e4),
    ) {
        // If a²/j exceeds 1000 v, rsruckig sometimes fails.
        let jerk = jerk.max(acceleration * acceleration / (1000.0 * velocity));
        let limits = PathLimits { length, velocity, acceleration, jerk };
        let ours = duration_s(&PathBounds::of_limits(&limits, DT).unwrap());
        let theirs = ruckig_duration_s(&limits);
        prop_assert!((ours - theirs).abs() <= 1e-9 * theirs, "{ours}, {theirs}");
    }

    #[test]
    fn a_change_of_velocity_is_the_one_of_rsruckigs_velocity_interface(
        from in log_even(1e-3, 5.0), to in log_even(1e-3, 5.0), share in -1.0..1.0f64,
        a_max in log_even(0.05, 100.0), jerk in log_even(1.0, 1e4),
    ) {
        let acceleration = share * a_max;
        let mut input = InputParameter::<1>::new(None);
        input.control_interface = ControlInterface::Velocity;
        (input.current_velocity[0], input.current_acceleration[0]) = (from, acceleration);
        input.target_velocity[0] = to;
        (input.max_velocity[0], input.max_acceleration[0], input.max_jerk[0]) = (5.0, a_max, jerk);
        let mut trajectory = Trajectory::<1>::new(None);
        let mut planner = Ruckig::<1, ThrowErrorHandler>::new(None, DT);
        prop_assert!(planner.calculate(&input, &mut trajectory).is_ok());

        let change = VelocityChange::new(from - to, acceleration, AccelerationLimits { acceleration: a_max, jerk });
        let ours = change.profile(AxisState { position: 0.0, velocity: from, acceleration });
        let theirs = &trajectory.get_profiles()[0][0];
        let near = |a: f64, b: f64| (a - b).abs() <= 1e-9 * (1.0 + a.abs());
        prop_assert!(near(change.duration_s(), trajectory.get_duration()), "{change:?}");
        prop_assert!(near(ours.end_position(), theirs.p[7]), "{change:?}");
    }
}
