//! The checks on synthetic motions: correct motions pass, and each kind of error is detected.

use super::*;
use rcc_core::path::SpeedOverride;
use rcc_motion::{PathBounds, PathClock};

const DT_S: f64 = 1e-3;
const LIMITS: PathLimits = PathLimits {
    length: 0.3,
    velocity: 0.1,
    acceleration: 0.5,
    jerk: 5.0,
};
const LINE: LineSegment = LineSegment {
    start: [0.5, -0.1, 0.4],
    end: [0.5, 0.2, 0.4],
};

/// Returns the distances of a motion that is stopped at this step.
fn motion(stop: Option<usize>) -> Vec<f64> {
    let bounds = PathBounds::of_limits(&LIMITS, DT_S).expect("sound limits");
    let mut clock = PathClock::new();
    let mut step = 0;
    let mut distances = Vec::new();
    loop {
        let state = clock.step(
            &bounds,
            SpeedOverride {
                stop: stop.is_some_and(|stop| step >= stop),
                ..SpeedOverride::RUN
            },
        );
        distances.push(state.s);
        step += 1;
        if state.done && distances.len() > 10 {
            distances.extend([state.s; 5]);
            return distances;
        }
    }
}

fn track(distances: &[f64]) -> DistanceTrack<'_> {
    DistanceTrack {
        first_cycle: 1000,
        distances,
        limits: LIMITS,
        dt_s: DT_S,
    }
}

fn holds(checks: &[MotionCheck]) -> Vec<bool> {
    checks.iter().map(|check| check.holds).collect()
}

#[test]
fn points_on_the_line_hold_and_one_beside_it_does_not() {
    let mut points: Vec<[f64; 3]> = (0..=10)
        .map(|i| [0.5, -0.1 + 0.03 * f64::from(i), 0.4])
        .collect();
    assert!(on_the_line("", &points, &LINE, SET_POINT_TOLERANCE_M).holds);
    points[4][0] += 2e-9;
    assert!(!on_the_line("", &points, &LINE, SET_POINT_TOLERANCE_M).holds);
}

#[test]
fn a_point_beyond_the_end_is_not_on_the_line() {
    let beyond = [[0.5, 0.2 + 1e-6, 0.4]];
    assert!(!on_the_line("", &beyond, &LINE, SET_POINT_TOLERANCE_M).holds);
}

#[test]
fn null_points_and_no_points_fail() {
    let null = [[0.5, f64::NAN, 0.4], [0.5, 0.0, 0.4]];
    assert!(!on_the_line("", &null, &LINE, ARM_TOLERANCE_M).holds);
    assert!(!on_the_line("", &[], &LINE, ARM_TOLERANCE_M).holds);
}

#[test]
fn a_planned_motion_and_its_stop_keep_the_limits() {
    for distances in [motion(None), motion(Some(1500))] {
        let check = within_limits("", &track(&distances));
        assert!(check.holds, "{check:?}");
    }
}

#[test]
fn a_motion_with_a_step_breaks_the_limits() {
    let mut distances = motion(None);
    for distance in &mut distances[1500..] {
        *distance += 1e-7;
    }
    assert!(
        !within_limits("", &track(&distances)).holds,
        "1e-7 m in a cycle is 100 m/s³ of jerk"
    );
    distances[1700] = f64::NAN;
    assert!(!within_limits("", &track(&distances)).holds);
}

#[test]
fn a_stop_at_once_and_in_time_holds() {
    let distances = motion(Some(1500));
    // Requested in the same cycle, and in the one before (a measurement that is one cycle old).
    for asked in [2500, 2499] {
        let checks = soft_stop("contact", &track(&distances), Some(asked));
        assert_eq!(holds(&checks), [true; 3], "{checks:?}");
    }
}

#[test]
fn a_stop_that_begins_late_or_early_does_not_hold() {
    let distances = motion(Some(1500));
    for asked in [2498, 2501] {
        let checks = soft_stop("contact", &track(&distances), Some(asked));
        assert!(!checks[0].holds, "{checks:?}");
    }
}

#[test]
fn a_stop_that_nobody_asked_for_does_not_hold() {
    let distances = motion(Some(1500));
    assert_eq!(
        holds(&soft_stop("contact", &track(&distances), None)),
        [false]
    );
}

#[test]
fn a_stop_that_takes_too_long_does_not_hold() {
    let mut distances = motion(Some(1500));
    let last = distances.len() - 1;
    distances.extend([distances[last] + 1e-9; 3]);
    assert!(!soft_stop("contact", &track(&distances), Some(2500))[1].holds);
}

#[test]
fn a_motion_that_continues_to_its_end_is_not_a_stop() {
    let distances = motion(None);
    let checks = soft_stop("contact", &track(&distances), Some(2500));
    assert!(!checks[0].holds && !checks[2].holds, "{checks:?}");
}

fn sent(on: std::ops::Range<usize>) -> Vec<SentDatagram> {
    (0..100)
        .map(|i| SentDatagram {
            along: 1e-4 * i as f64,
            on: on.contains(&i),
        })
        .collect()
}

#[test]
fn an_output_that_switches_with_its_set_point_holds() {
    let datagrams = sent(31..80);
    assert!(switches_with("", &datagrams, true, 3.1e-3).holds);
    assert!(switches_with("", &datagrams, false, 8.0e-3).holds);
}

#[test]
fn an_output_one_datagram_late_or_early_does_not_hold() {
    for on in [30..80, 32..80] {
        assert!(!switches_with("", &sent(on), true, 3.1e-3).holds);
    }
    assert!(!switches_with("", &sent(0..0), true, 3.1e-3).holds, "never");
}

#[test]
fn a_bridged_cycle_switches_in_the_first_datagram_that_is_not_before() {
    let mut datagrams = sent(31..80);
    for datagram in &mut datagrams {
        datagram.along += 0.5e-4;
    }
    assert!(switches_with("", &datagrams, true, 3.1e-3).holds);
    assert!(
        !switches_with("", &datagrams, true, 3.2e-3).holds,
        "one too early"
    );
    assert!(
        !switches_with("", &datagrams, true, 3.0e-3).holds,
        "one too late"
    );
}

#[test]
fn an_output_that_flickers_does_not_hold() {
    let mut datagrams = sent(31..80);
    datagrams[40].on = false;
    assert!(!switches_with("", &datagrams, true, 3.1e-3).holds);
    assert!(!switches_with("", &datagrams, false, 8.0e-3).holds);
}

#[test]
fn an_output_that_stays_on_does_not_hold() {
    assert!(!switches_with("", &sent(31..100), false, 8.0e-3).holds);
}

#[test]
fn a_crossing_is_between_the_two_set_points() {
    assert!(crosses("", 0.05, Some((0.05, 0.0501))).holds);
    assert!(!crosses("", 0.05, Some((0.0501, 0.0502))).holds);
    assert!(!crosses("", 0.05, Some((0.0498, 0.0499))).holds);
    assert!(!crosses("", 0.05, None).holds);
}

#[test]
fn a_gap_in_the_cycles_is_found() {
    assert!(without_gaps("", &[5, 6, 7]).holds);
    assert!(!without_gaps("", &[5, 7]).holds && !without_gaps("", &[]).holds);
}
