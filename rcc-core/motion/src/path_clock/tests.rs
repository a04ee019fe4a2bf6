//! The clock keeps its limits, never goes back, ends exactly, and stops as fast as rsruckig's velocity interface.
//! Tests only.

use super::*;
use proptest::prelude::*;
use rsruckig::prelude::ControlInterface;

const DT: f64 = 1e-3;
const LINE: PathLimits = PathLimits {
    length: 0.5,
    velocity: 0.25,
    acceleration: 1.0,
    jerk: 10.0,
};

/// A number whose logarithm is even over `low`..`high`.
fn log_even(low: f64, high: f64) -> impl Strategy<Value = f64> {
    (low.ln()..high.ln()).prop_map(f64::exp)
}

/// Limits over four to six orders of magnitude; the shape that `new` refuses is left out.
fn any_limits() -> impl Strategy<Value = PathLimits> {
    let all = (
        log_even(1e-5, 10.0),
        log_even(1e-3, 10.0),
        log_even(1e-2, 100.0),
        log_even(1e-1, 1e4),
    );
    all.prop_map(|(length, velocity, acceleration, jerk)| PathLimits {
        length,
        velocity,
        acceleration,
        jerk,
    })
    .prop_filter("refused shape", |l| {
        l.acceleration * l.acceleration / l.jerk <= SHAPE_MAX * l.velocity
    })
}

/// Steps until done, with the stop in step `stop_at`; at most `steps`.
fn run(clock: &mut PathClock, stop_at: Option<usize>, steps: usize) -> Vec<PathState> {
    let mut states = Vec::new();
    while states.len() < steps && !states.last().is_some_and(|state: &PathState| state.done) {
        states.push(clock.step(stop_at == Some(states.len())));
    }
    states
}

/// Limits on s itself by finite differences, and on the derivatives that come with it.
fn assert_within(states: &[PathState], limits: &PathLimits, dt: f64) -> Result<(), TestCaseError> {
    let rounding = 32.0 * f64::EPSILON * limits.length / dt;
    let within =
        |value: f64, limit: f64, rounding: f64| value.abs() <= limit * (1.0 + 1e-9) + rounding;
    let (mut before, mut speed, mut change) = (PathState::default(), 0.0, 0.0);
    for state in states {
        let velocity = (state.s - before.s) / dt;
        let acceleration = (velocity - speed) / dt;
        let jerk = (acceleration - change) / dt;
        prop_assert!(
            state.s >= before.s && state.s <= limits.length,
            "{state:?} after {before:?}"
        );
        prop_assert!(
            within(velocity, limits.velocity, rounding),
            "velocity {velocity}, {state:?}"
        );
        prop_assert!(
            within(acceleration, limits.acceleration, rounding / dt),
            "{acceleration}, {state:?}"
        );
        prop_assert!(
            within(jerk, limits.jerk, 8.0 * rounding / (dt * dt)),
            "jerk {jerk}, {state:?}"
        );
        prop_assert!(
            state.velocity >= 0.0 && within(state.velocity, limits.velocity, 0.0),
            "{state:?}"
        );
        prop_assert!(
            within(state.acceleration, limits.acceleration, 0.0),
            "{state:?}"
        );
        let change_per_s = (state.acceleration - before.acceleration) / dt;
        prop_assert!(
            within(change_per_s, limits.jerk, limits.acceleration * 1e-14 / dt),
            "{state:?}"
        );
        (before, speed, change) = (*state, velocity, acceleration);
    }
    Ok(())
}

#[test]
fn the_first_step_is_the_start_at_rest() {
    let mut clock = PathClock::new(LINE, DT).unwrap();
    assert_eq!(clock.step(false), PathState::default());
    assert!(clock.step(false).s > 0.0);
}

#[test]
fn a_path_without_length_is_done_at_once() {
    let mut clock = PathClock::new(
        PathLimits {
            length: 0.0,
            ..LINE
        },
        DT,
    )
    .unwrap();
    assert_eq!(
        clock.step(false),
        PathState {
            done: true,
            ..PathState::default()
        }
    );
    assert_eq!(
        clock.step(true),
        PathState {
            done: true,
            stopping: true,
            ..PathState::default()
        }
    );
}

#[test]
fn a_stop_before_the_start_never_moves() {
    let mut clock = PathClock::new(LINE, DT).unwrap();
    assert_eq!(
        clock.step(true),
        PathState {
            done: true,
            stopping: true,
            ..PathState::default()
        }
    );
    assert_eq!(clock.step(false).s, 0.0);
}

#[test]
fn a_stop_changes_the_step_that_asks_for_it() {
    let (mut stopped, mut free) = (
        PathClock::new(LINE, DT).unwrap(),
        PathClock::new(LINE, DT).unwrap(),
    );
    for _ in 0..500 {
        assert_eq!(stopped.step(false), free.step(false));
    }
    let (stopped, free) = (stopped.step(true), free.step(false));
    assert!(stopped.stopping && stopped.velocity < free.velocity);
    // One cycle of full jerk from cruising.
    assert!((stopped.acceleration + LINE.jerk * DT).abs() < 1e-12);
}

#[test]
fn a_stop_cannot_be_taken_back() {
    let mut clock = PathClock::new(LINE, DT).unwrap();
    let states = run(&mut clock, Some(700), 10_000);
    let last = states.last().unwrap();
    assert!(last.done && last.stopping && last.s < LINE.length);
    assert_eq!((last.velocity, last.acceleration), (0.0, 0.0));
    assert_eq!(clock.step(false), *last);
}

#[test]
fn it_stays_at_the_end() {
    let mut clock = PathClock::new(LINE, DT).unwrap();
    let end = *run(&mut clock, None, 10_000).last().unwrap();
    assert_eq!(
        end,
        PathState {
            s: LINE.length,
            done: true,
            ..PathState::default()
        }
    );
    assert_eq!(clock.step(false), end);
    assert_eq!(
        clock.step(true),
        PathState {
            stopping: true,
            ..end
        }
    );
}

#[test]
fn a_reset_clock_is_a_new_one() {
    let mut clock = PathClock::new(LINE, DT).unwrap();
    run(&mut clock, Some(300), 10_000);
    clock.reset();
    assert_eq!(clock, PathClock::new(LINE, DT).unwrap());
}

#[test]
fn limits_that_cannot_be_meant_are_refused_by_name() {
    let refusal = |limits: PathLimits| PathClock::new(limits, DT).unwrap_err();
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let velocity = refusal(PathLimits {
            velocity: bad,
            ..LINE
        });
        let acceleration = refusal(PathLimits {
            acceleration: bad,
            ..LINE
        });
        let jerk = refusal(PathLimits { jerk: bad, ..LINE });
        for (refusal, name) in [
            (velocity, "velocity"),
            (acceleration, "acceleration"),
            (jerk, "jerk"),
        ] {
            assert!(
                matches!(refusal, PathLimitsError::Limit { limit, .. } if limit == name),
                "{refusal:?}"
            );
        }
        assert!(matches!(
            PathClock::new(LINE, bad),
            Err(PathLimitsError::CycleTime { .. })
        ));
    }
    for bad in [-1.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(
            refusal(PathLimits {
                length: bad,
                ..LINE
            }),
            PathLimitsError::Length { .. }
        ));
    }
    let shape = refusal(PathLimits {
        acceleration: 100.0,
        jerk: 1.0,
        ..LINE
    });
    assert_eq!(shape, PathLimitsError::Shape { ratio: 40_000.0 });
    assert!(
        shape.to_string().contains("raise the jerk limit"),
        "{shape}"
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn every_motion_keeps_its_limits_and_ends_exactly(limits in any_limits(), steps in 3.0..2000.0f64) {
        let dt = PathClock::new(limits, 1.0).unwrap().duration_s() / steps;
        let mut clock = PathClock::new(limits, dt).unwrap();
        let states = run(&mut clock, None, 2003);
        assert_within(&states, &limits, dt)?;
        let last = states.last().unwrap();
        prop_assert!(last.done && last.s == limits.length);
        prop_assert!(states.len() as f64 >= steps && states.len() as f64 <= steps + 2.5);
    }

    #[test]
    fn every_stop_keeps_the_limits_and_takes_its_time(
        limits in any_limits(), steps in 3.0..2000.0f64, part in 0.0..1.0f64,
    ) {
        let dt = PathClock::new(limits, 1.0).unwrap().duration_s() / steps;
        let mut clock = PathClock::new(limits, dt).unwrap();
        let stop_at = (part * steps) as usize;
        let states = run(&mut clock, Some(stop_at), 3000);
        assert_within(&states, &limits, dt)?;
        prop_assert!(states.last().unwrap().done);
        let before = stop_at.checked_sub(1).map_or(PathState::default(), |index| states[index]);
        let predicted = stop_time(before.velocity, before.acceleration, &limits) / dt;
        let taken = (states.len() - stop_at) as f64;
        prop_assert!((taken - predicted).abs() <= 1.0 + 1e-6, "{taken} steps, predicted {predicted}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200_000))]

    #[test]
    fn no_limits_that_are_accepted_defeat_the_planner(limits in any_limits()) {
        prop_assert!(PathClock::new(limits, DT).is_ok());
    }

    #[test]
    fn the_stop_is_the_one_of_rsruckigs_velocity_interface(
        velocity in log_even(1e-3, 5.0), share in -1.0..1.0f64, a_max in log_even(0.05, 100.0), jerk in log_even(1.0, 1e4),
    ) {
        let acceleration = share * a_max;
        let mut input = InputParameter::<1>::new(None);
        input.control_interface = ControlInterface::Velocity;
        (input.current_velocity[0], input.current_acceleration[0]) = (velocity, acceleration);
        (input.max_velocity[0], input.max_acceleration[0], input.max_jerk[0]) = (velocity, a_max, jerk);
        let mut trajectory = Trajectory::<1>::new(None);
        let mut planner = Ruckig::<1, ThrowErrorHandler>::new(None, DT);
        prop_assert!(planner.calculate(&input, &mut trajectory).is_ok());

        let stop = Stop::new(velocity, acceleration, a_max, jerk);
        let ours = stop.profile(State { position: 0.0, velocity, acceleration });
        let theirs = &trajectory.get_profiles()[0][0];
        let near = |a: f64, b: f64| (a - b).abs() <= 1e-9 * (1.0 + a.abs());
        prop_assert!(near(stop.duration_s(), trajectory.get_duration()), "{stop:?}");
        prop_assert!(near(ours.end_position(), theirs.p[7]), "{stop:?}");
    }
}
