//! Profiles against results known by hand, and the limits of their moving average.

use super::super::super::speed_limits::QUANTITIES;
use super::*;

/// Constraints of one quantity that moves uniformly over a length of 2, with these limits.
fn uniform(velocity: f64, acceleration: f64) -> Vec<PathConstraints> {
    let mut slopes = [[0.0; 3]; QUANTITIES];
    slopes[2] = [1.0, 0.0, 0.0];
    let mut bounds = [[f64::INFINITY; 3]; QUANTITIES];
    bounds[2] = [velocity, acceleration, f64::INFINITY];
    let place = |number: u32| PathConstraints::new(f64::from(number) / 500.0, &slopes, &bounds);
    (0..=1000).map(place).collect()
}

#[test]
fn a_uniform_path_uses_the_greatest_acceleration_and_deceleration() {
    let profile = AccelerationProfile::new(&uniform(f64::INFINITY, 4.5)).unwrap();
    let want = 2.0 * (2.0 / 4.5_f64).sqrt();
    assert!((profile.duration_s() - want).abs() < 1e-9 * want);
    // With a velocity limit: two ramps and a constant speed between them.
    let profile = AccelerationProfile::new(&uniform(1.5, 4.5)).unwrap();
    let want = 2.0 / 1.5 + 1.5 / 4.5;
    assert!((profile.duration_s() - want).abs() < 2e-3 * want);
}

#[test]
fn a_circle_is_followed_as_fast_as_its_curvature_allows() {
    // Two joints that follow a circle of radius 1 once: |y''| ≤ a requires s'² ≤ a, and nearly all of it is at that
    // speed.
    let acceleration = 3.0;
    let constraints: Vec<PathConstraints> = (0..=4000)
        .map(|number| {
            let s = core::f64::consts::TAU * f64::from(number) / 4000.0;
            let mut slopes = [[0.0; 3]; QUANTITIES];
            (slopes[2], slopes[3]) = ([-s.sin(), -s.cos(), 0.0], [s.cos(), -s.sin(), 0.0]);
            let mut bounds = [[f64::INFINITY; 3]; QUANTITIES];
            (bounds[2][1], bounds[3][1]) = (acceleration, acceleration);
            PathConstraints::new(s, &slopes, &bounds)
        })
        .collect();
    let profile = AccelerationProfile::new(&constraints).unwrap();
    let steps = profile.knots.windows(2);
    for (pair, place) in steps.zip(&constraints) {
        let [_, _, v, u, _] = pair[0];
        for [a, b, c] in &place.rows {
            assert!(a * u + b * v * v <= c + 2e-2, "{a} {b} {c}: {v} {u}");
        }
    }
    // Each joint may use all of its acceleration, so it is faster than with one limit for both, by less than √2.
    let uniform = core::f64::consts::TAU / acceleration.sqrt();
    let time = profile.duration_s();
    assert!(
        time < 1.15 * uniform && time > uniform / 2.0_f64.sqrt(),
        "{time} {uniform}"
    );
}

#[test]
fn the_moving_average_goes_forward_between_the_ends() {
    let profile = AccelerationProfile::new(&uniform(1.5, 4.5)).unwrap();
    let average = |number: u32| profile.averaged(0.2, f64::from(number) / 1000.0);
    assert_eq!((average(0), average(1000)), (0.0, 2.0));
    assert!((1..=1000).all(|number| average(number) >= average(number - 1)));
    assert!((average(500) - 1.0).abs() < 1e-6, "{}", average(500));
}
