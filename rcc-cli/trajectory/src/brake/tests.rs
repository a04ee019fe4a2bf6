use rcc_config::JointConfig;

use super::Brake;
use crate::path::TrajectoryPath;
use crate::read::read;

const STEP_S: f64 = 1e-4;

fn joint(acceleration_rad_s2: f64, jerk_rad_s3: f64) -> JointConfig {
    JointConfig {
        name: "a".to_owned(),
        lower_rad: -3.0,
        upper_rad: 3.0,
        velocity_rad_s: 2.0,
        acceleration_rad_s2,
        jerk_rad_s3,
    }
}

fn path() -> TrajectoryPath {
    let text = "joint_names: [a]\npoints: [{positions: [0], time_from_start: 0}, {positions: [0.4], time_from_start: 0.6}, \
        {positions: [0.1], time_from_start: 1.5}, {positions: [0.3], time_from_start: 2.2}]";
    TrajectoryPath::new(&read(text).expect("points"), None, 1.0).expect("a path")
}

/// Times along the path for a stop that begins at `begin`: the rate of the pace goes to its largest value and back to 0, so
/// that the pace ends at 0.
fn stopped(brake: Brake, begin_s: f64) -> Vec<f64> {
    let (mut time, mut pace, mut rate) = (begin_s, 1.0_f64, 0.0_f64);
    let mut times = vec![begin_s - 2.0 * STEP_S, begin_s - STEP_S, begin_s];
    while pace > 1e-9 && times.len() < 100_000 {
        // The pace decreases further while the rate returns to 0.
        let returning = rate * rate / (2.0 * brake.change_per_s2);
        let change = if returning >= pace { -1.0 } else { 1.0 };
        rate = (rate + change * brake.change_per_s2 * STEP_S).clamp(0.0, brake.rate_per_s);
        if rate == 0.0 {
            break;
        }
        pace = (pace - rate * STEP_S).max(0.0);
        time += pace * STEP_S;
        times.push(time);
    }
    times
}

#[test]
fn a_stop_keeps_the_limits_wherever_it_begins() {
    let (path, joint) = (path(), joint(8.0, 120.0));
    let brake = Brake::of(&path, &[&joint]).expect("there is room for a stop");
    for tenth in 1..22 {
        let times = stopped(brake, f64::from(tenth) * 0.1);
        let positions: Vec<f64> = times
            .iter()
            .map(|time| path.at(0, *time).position)
            .collect();
        for q in positions.windows(3) {
            let acceleration = (q[2] - 2.0 * q[1] + q[0]) / STEP_S.powi(2);
            assert!(acceleration.abs() <= 8.0, "{tenth}: {acceleration} rad/s²");
        }
    }
}

#[test]
fn a_trajectory_at_its_limits_leaves_no_room_for_a_stop() {
    let path = path();
    let decelerates = (0..2200).map(|ms| path.at(0, f64::from(ms) * 1e-3));
    let most = decelerates
        .filter(|there| there.velocity * there.acceleration < 0.0)
        .fold(0.0_f64, |most, there| most.max(there.acceleration.abs()));
    assert_eq!(Brake::of(&path, &[&joint(most * 0.9, 1e4)]), None);
    assert!(Brake::of(&path, &[&joint(most * 1.5, 1e4)]).is_some());
}
