use crate::read::{JointTrajectory, Point, read};

use super::{Interpolation, PathError, TrajectoryPath};

const TEXT: &str = "joint_names: [a]\npoints:\n\
    - {positions: [0.0], time_from_start: 0}\n\
    - {positions: [0.4], time_from_start: 0.5}\n\
    - {positions: [0.1], time_from_start: 1.25}\n\
    - {positions: [0.3], time_from_start: 2}\n";

fn given() -> JointTrajectory {
    read(TEXT).expect("a trajectory")
}

/// The same points with velocities, and with accelerations.
fn with(velocities: &[f64], accelerations: Option<&[f64]>) -> JointTrajectory {
    let mut given = given();
    for (number, point) in given.points.iter_mut().enumerate() {
        point.velocities = Some(vec![velocities[number]]);
        point.accelerations = accelerations.map(|values| vec![values[number]]);
    }
    given
}

fn assert_near(have: f64, want: f64, what: &str) {
    assert!(
        (have - want).abs() < 1e-9,
        "{what}: {have}, expected {want}"
    );
}

/// The curve passes the points at their times, at rest at both ends, with continuous velocity and acceleration.
fn is_smooth_through(path: &TrajectoryPath, points: &[Point]) {
    for point in points {
        assert_near(
            path.at(0, point.time_s).position,
            point.positions[0],
            "position",
        );
    }
    for time in [0.0, path.duration_s()] {
        assert_near(path.at(0, time).velocity, 0.0, "velocity at an end");
        assert_near(path.at(0, time).acceleration, 0.0, "acceleration at an end");
    }
    for time in &path.times_s[1..path.times_s.len() - 1] {
        let (before, after) = (path.at(0, time - 1e-12), path.at(0, *time));
        assert_near(before.velocity, after.velocity, "velocity");
        assert_near(before.acceleration, after.acceleration, "acceleration");
    }
}

#[test]
fn positions_alone_become_a_smooth_curve() {
    let path = TrajectoryPath::new(&given(), None, 1.0).expect("a path");
    assert_eq!(path.interpolation, Interpolation::Spline);
    is_smooth_through(&path, &given().points);
}

#[test]
fn velocities_and_accelerations_are_those_of_the_file() {
    let velocities = [0.0, 0.2, -0.1, 0.0];
    let cubic = with(&velocities, None);
    let path = TrajectoryPath::new(&cubic, None, 1.0).expect("a path");
    assert_eq!(path.interpolation, Interpolation::Cubic);
    is_smooth_through(&path, &cubic.points);
    let quintic = with(&velocities, Some(&[0.5, -0.3, 0.6, -0.25]));
    let path = TrajectoryPath::new(&quintic, None, 1.0).expect("a path");
    assert_eq!(path.interpolation, Interpolation::Quintic);
    is_smooth_through(&path, &quintic.points);
    for number in 1..3 {
        let there = path.at(0, path.times_s[number]);
        assert_near(there.velocity, velocities[number], "velocity");
        assert_near(
            there.acceleration,
            [0.0, -0.3, 0.6, 0.0][number],
            "acceleration",
        );
    }
    assert_eq!(path.dropped_rad_s2, 0.5);
}

#[test]
fn the_velocities_of_a_spline_are_those_of_a_worked_one() {
    // Clamped cubic spline through 0, 1, 0 at 0, 1, 2 s: by symmetry at rest in the middle, where q″ = -6.
    let text = "joint_names: [a]\npoints: [{positions: [0], time_from_start: 0}, {positions: [1], time_from_start: 1}, \
        {positions: [0], time_from_start: 2}]";
    let path = TrajectoryPath::new(&read(text).expect("three points"), None, 1.0).expect("a path");
    assert_near(path.at(0, 1.0).velocity, 0.0, "velocity");
    assert_near(path.at(0, 1.0).acceleration, -6.0, "acceleration");
}

#[test]
fn stretched_it_is_the_same_curve_slower() {
    let path = TrajectoryPath::new(&given(), None, 1.0).expect("a path");
    let slower = TrajectoryPath::new(&given(), None, 2.0).expect("a path");
    for time in [0.2, 0.9, 1.7] {
        let (fast, slow) = (path.at(0, time), slower.at(0, 2.0 * time));
        assert_near(slow.position, fast.position, "position");
        assert_near(slow.velocity, fast.velocity / 2.0, "velocity");
        assert_near(slow.acceleration, fast.acceleration / 4.0, "acceleration");
        assert_near(slow.jerk, fast.jerk / 8.0, "jerk");
    }
}

#[test]
fn refuses_what_is_no_motion_from_rest_to_rest() {
    let mut late = given();
    late.points.remove(0);
    let start = |start: &[f64], given: &JointTrajectory| {
        TrajectoryPath::new(given, Some(start), 1.0).map(|_| ())
    };
    assert_eq!(
        TrajectoryPath::new(&late, None, 1.0).map(|_| ()),
        Err(PathError::NoStart { first_s: 0.5 })
    );
    assert_eq!(
        start(&[0.0, 0.0], &late),
        Err(PathError::StartWidth { have: 2, joints: 1 })
    );
    assert_eq!(start(&[0.0], &given()), Err(PathError::TwoStarts));
    assert_eq!(start(&[0.0], &late), Ok(()));
    let mut short = given();
    short.points.truncate(1);
    assert_eq!(
        TrajectoryPath::new(&short, None, 1.0).map(|_| ()),
        Err(PathError::OnePoint)
    );
    let moving = with(&[0.0, 0.1, 0.1, 0.1], None);
    let refused = TrajectoryPath::new(&moving, None, 1.0).expect_err("it does not end at rest");
    assert!(
        refused
            .to_string()
            .starts_with("last point: joint `a` moves"),
        "{refused}"
    );
}
