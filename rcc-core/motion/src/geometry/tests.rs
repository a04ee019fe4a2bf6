//! Geometry against independent checks: difference quotients, points that must be met, smoothness where shapes join.

use proptest::prelude::*;
use rcc_core::pose::Pose;

use super::chain::{Chain, ChainLink, Shape, ShapePoint};
use super::circle::{Circle, CircleOrientation};
use super::jet::{Jet, JetScalar};
use super::line::{JointLine, Line, distance};
use super::spline::Spline;
use super::*;

const METRIC: PathMetric = PathMetric { radius_m: 0.25 };

fn pose(xyz: [f64; 3], rpy: [f64; 3]) -> Pose {
    Pose::from_xyz_rpy(xyz, rpy)
}

/// Values and derivatives of a shape, as numbers: position and orientation, or joints.
fn numbers(at: ShapePoint<Jet>) -> Vec<Jet> {
    match at {
        ShapePoint::Flange(place) => place
            .position
            .into_iter()
            .chain(place.orientation)
            .collect(),
        ShapePoint::Joints(joints) => joints.to_vec(),
    }
}

/// Asserts that every derivative is the difference quotient of the one below it.
fn derivatives_are_right(shape: &Shape, s: f64) {
    let h = 1e-5 * shape.length().max(1e-3);
    let s = s.clamp(2.0 * h, shape.length() - 2.0 * h);
    let at = |s| numbers(shape.at(Jet::variable(s)));
    for ((before, here), behind) in at(s - h).iter().zip(at(s)).zip(at(s + h)) {
        for order in 1..4 {
            let quotient =
                (behind.derivative(order - 1) - before.derivative(order - 1)) / (2.0 * h);
            let scale =
                1.0 + here.derivative(order).abs() + 1.0 / shape.length().powi(order as i32);
            assert!(
                (quotient - here.derivative(order)).abs() < 1e-4 * scale,
                "{order}: {quotient} {here:?}"
            );
        }
    }
    let value = numbers(shape.at(Jet::variable(s)));
    let plain = match shape.at(s) {
        ShapePoint::Flange(place) => place.pose().to_slots().to_vec(),
        ShapePoint::Joints(joints) => joints.to_vec(),
    };
    for (jet, plain) in value.iter().zip(plain) {
        assert!((jet.value() - plain).abs() < 1e-15 * (1.0 + plain.abs()));
    }
}

fn circle(orientation: CircleOrientation, angle: Option<f64>) -> Circle {
    let from = pose([0.5, 0.1, 0.3], [0.1, 0.2, 0.3]);
    let to = pose([0.3, 0.3, 0.35], [0.4, -0.2, 0.9]);
    Circle::new(&from, [0.45, 0.25, 0.4], &to, (orientation, angle), METRIC).unwrap()
}

#[test]
fn a_circle_meets_its_three_points_at_one_distance_from_its_centre() {
    let circle = circle(CircleOrientation::Even, None);
    let (start, end) = (circle.at(0.0), circle.at(circle.length()));
    assert!(distance(start.position, [0.5, 0.1, 0.3]) < 1e-15);
    assert!(distance(end.position, [0.3, 0.3, 0.35]) < 1e-15);
    let nearest = (0..=10_000)
        .map(|i| circle.at(circle.length() * f64::from(i) / 1e4).position)
        .map(|p| distance(p, [0.45, 0.25, 0.4]))
        .fold(f64::INFINITY, f64::min);
    assert!(nearest < 1e-4 * circle.length(), "{nearest}");
    let want = pose([0.3, 0.3, 0.35], [0.4, -0.2, 0.9]);
    assert!(end.pose().angle_to(&want) < 1e-14);
}

#[test]
fn a_full_circle_ends_where_it_began_and_turns_with_its_tangent() {
    let whole = 2.0 * core::f64::consts::PI;
    let path = circle(CircleOrientation::Path, Some(whole));
    let (start, end) = (path.at(0.0).pose(), path.at(path.length()).pose());
    assert!(start.distance_to(&end) < 1e-14 && start.angle_to(&end) < 1e-14);
    // Rotation dominates: its radius is greater than that of the circle.
    assert!((path.length() - whole * path.radius_m().max(METRIC.radius_m)).abs() < 1e-12);
    // The tangent is constant in the flange frame.
    let tangent = |s: f64| {
        let place = path.at(Jet::variable(s));
        let back = rcc_core::rotation::inverse(place.pose().orientation);
        rcc_core::rotation::rotate(back, place.rates().linear[0])
    };
    assert!(distance(tangent(0.0), tangent(0.37 * path.length())) < 1e-13);
    let constant = circle(CircleOrientation::Constant, Some(-1.0));
    let end = constant.at(constant.length()).pose();
    assert!(end.angle_to(&start) < 1e-15);
}

#[test]
fn collinear_or_coincident_points_do_not_define_a_circle() {
    let from = pose([0.0; 3], [0.0; 3]);
    let to = pose([0.2, 0.0, 0.0], [0.0; 3]);
    let mode = (CircleOrientation::Even, None);
    let refused = |via| Circle::new(&from, via, &to, mode, METRIC).unwrap_err();
    assert_eq!(refused([0.1, 0.0, 0.0]), GeometryError::Collinear);
    assert_eq!(refused([0.1, 1e-8, 0.0]), GeometryError::Collinear);
    let none = (CircleOrientation::Even, Some(0.0));
    let refusal = Circle::new(&from, [0.1, 0.1, 0.0], &to, none, METRIC);
    assert_eq!(refusal, Err(GeometryError::NoAngle));
    assert!(matches!(
        refused([0.0, 1e-8, 0.0]),
        GeometryError::Coincident {
            first: 0,
            second: 1,
            ..
        }
    ));
    assert_eq!(refused([f64::NAN, 0.0, 0.0]), GeometryError::NotFinite);
    let same = Circle::new(&from, [0.1, 0.1, 0.0], &from, mode, METRIC);
    assert!(matches!(
        same,
        Err(GeometryError::Coincident {
            first: 0,
            second: 2,
            ..
        })
    ));
}

#[test]
fn half_a_turn_is_refused() {
    let to = pose([0.1, 0.0, 0.0], [core::f64::consts::PI, 0.0, 0.0]);
    let line = Line::new(&Pose::IDENTITY, &to, METRIC);
    assert_eq!(line, Err(GeometryError::HalfTurn));
    let spline = Spline::new(&[Pose::IDENTITY, to], METRIC);
    assert_eq!(spline, Err(GeometryError::HalfTurn));
}

#[test]
fn a_turn_on_the_spot_has_the_length_of_its_angle_times_the_radius() {
    let to = pose([0.0; 3], [0.0, 0.0, 0.8]);
    let line = Line::new(&Pose::IDENTITY, &to, METRIC).unwrap();
    assert!((line.length() - 0.2).abs() < 1e-15);
    let none = Line::new(&to, &to, METRIC).unwrap();
    assert_eq!(none.length(), 0.0);
    assert_eq!(none.at(0.0).pose().position, to.position);
}

fn bends() -> Vec<Pose> {
    vec![
        pose([0.5, 0.0, 0.3], [3.0, 0.0, 0.0]),
        pose([0.55, 0.1, 0.35], [3.1, 0.2, 0.0]),
        pose([0.45, 0.2, 0.4], [3.1, 0.1, 0.4]),
        pose([0.35, 0.15, 0.3], [2.9, 0.0, 0.8]),
        pose([0.4, 0.0, 0.25], [3.1, -0.2, 0.6]),
    ]
}

#[test]
fn a_spline_meets_every_pose_and_runs_by_its_arc_length() {
    let (poses, spline) = (bends(), Spline::new(&bends(), METRIC).unwrap());
    for (s, want) in spline.points().iter().zip(&poses) {
        let at = spline.at(*s).pose();
        assert!(at.distance_to(want) < 1e-13 && at.angle_to(want) < 1e-13);
    }
    assert_eq!(spline.points().len(), poses.len());
    for i in 0..=1000 {
        let rates = spline
            .at(Jet::variable(spline.length() * f64::from(i) / 1e3))
            .rates();
        let speed = rcc_core::vector::norm(rates.linear[0]);
        assert!((speed - 1.0).abs() < 1e-12, "{i}: {speed}");
    }
}

#[test]
fn a_spline_is_smooth_to_the_second_derivative_at_its_points() {
    let spline = Spline::new(&bends(), METRIC).unwrap();
    let points = spline.points();
    for s in &points[1..points.len() - 1] {
        let h = 1e-9;
        let numbers = |s| numbers(ShapePoint::Flange(spline.at(Jet::variable(s))));
        for (before, behind) in numbers(s - h).iter().zip(numbers(s + h)) {
            for order in 0..3 {
                let step = (before.derivative(order) - behind.derivative(order)).abs();
                let next = before.derivative(order + 1).abs();
                assert!(step < 1e-9 + 4.0 * h * next, "{order} {step} {next}");
            }
        }
    }
}

#[test]
fn a_spline_that_rotates_on_the_spot_or_reverses_is_not_parameterized_by_arc_length() {
    let turn = |yaw| pose([0.4, 0.0, 0.3], [0.0, 0.0, yaw]);
    let spline = Spline::new(&[turn(0.0), turn(0.5), turn(0.7)], METRIC).unwrap();
    assert!((spline.length() - 0.7 * 0.25).abs() < 1e-12);
    let at = |x| pose([x, 0.0, 0.0], [0.0; 3]);
    let back = Spline::new(&[at(0.0), at(0.2), at(0.0)], METRIC).unwrap();
    assert!((back.length() - 0.4).abs() < 1e-12);
    let same = Spline::new(&[at(0.0), at(0.2), at(0.2)], METRIC);
    assert!(matches!(
        same,
        Err(GeometryError::Coincident {
            first: 1,
            second: 2,
            ..
        })
    ));
    let far: Vec<Pose> = (0..6).map(|i| turn(2.0 * f64::from(i))).collect();
    assert!(matches!(
        Spline::new(&far, METRIC),
        Err(GeometryError::TurnsTooFar { .. })
    ));
}

/// Line, line, arc, spline and joints, with blends.
fn chain(zone: f64) -> Chain {
    let poses = bends();
    let line = |a: usize, b: usize| Shape::Line(Line::new(&poses[a], &poses[b], METRIC).unwrap());
    let via = [0.38, 0.2, 0.36];
    let mode = (CircleOrientation::Even, None);
    let arc = Circle::new(&poses[2], via, &poses[3], mode, METRIC).unwrap();
    let spline = Spline::new(&[poses[3], poses[4], poses[0]], METRIC).unwrap();
    let shapes = [
        line(0, 1),
        line(1, 2),
        Shape::Circle(arc),
        Shape::Spline(spline),
    ];
    let links = shapes.map(|shape| ChainLink {
        shape,
        zone: [zone; 2],
    });
    Chain::new(links.to_vec(), |_, _, _| Err(())).unwrap()
}

#[test]
fn a_chain_is_smooth_at_every_joint_and_rests_where_it_is_not() {
    let rounded = chain(0.03);
    assert_eq!(rounded.pieces().len(), 7);
    for pair in rounded.pieces().windows(2) {
        let s = Jet::variable(pair[0].end);
        let (before, behind) = (numbers(pair[0].at(s)), numbers(pair[1].at(s)));
        // A quaternion and its opposite are the same orientation.
        let same: f64 = before[3..]
            .iter()
            .zip(&behind[3..])
            .map(|(a, b)| a.value() * b.value())
            .sum();
        for (number, (before, behind)) in before.iter().zip(behind).enumerate() {
            let sign = if number < 3 { 1.0 } else { same.signum() };
            for order in 0..3 {
                let step = (before.derivative(order) - sign * behind.derivative(order)).abs();
                assert!(
                    step < 1e-10 * 30f64.powi(order as i32),
                    "{number} {order} {step}"
                );
            }
        }
        assert!(!pair[0].rest);
    }
    let corners = chain(0.0);
    assert_eq!(corners.pieces().len(), 4);
    assert!(corners.pieces().iter().all(|piece| piece.rest));
    assert!(corners.length() > rounded.length() - 1e-12);
}

#[test]
fn a_blend_takes_at_most_half_of_the_shorter_shape_and_stays_near_the_corner() {
    let wide = chain(1.0);
    let shortest = wide
        .pieces()
        .iter()
        .map(|piece| piece.length())
        .fold(1.0, f64::min);
    assert!(shortest >= 0.0);
    for piece in wide.pieces().iter().filter(|piece| piece.blend) {
        for i in 0..=100 {
            let s = piece.begin + piece.length() * f64::from(i) / 100.0;
            let ShapePoint::Flange(place) = piece.at(Jet::variable(s)) else {
                panic!("joints")
            };
            let speed = rcc_core::vector::norm(place.rates().linear[0]);
            assert!(speed < 1.3, "{speed}");
        }
    }
}

#[test]
fn a_blend_of_two_lines_is_never_faster_than_they_are() {
    let at = |x, y| pose([x, y, 0.0], [0.0; 3]);
    for corner in [[0.3, 0.2], [0.2, 0.3], [0.0, 0.0], [0.1, -0.1]] {
        let line = |a: &Pose, b: &Pose| Shape::Line(Line::new(a, b, METRIC).unwrap());
        let (a, b, c) = (at(0.0, 0.0), at(0.3, 0.0), at(corner[0], corner[1]));
        let links = [line(&a, &b), line(&b, &c)].map(|shape| ChainLink {
            shape,
            zone: [0.05; 2],
        });
        let chain = Chain::new(links.to_vec(), |_, _, _| Err(())).unwrap();
        for i in 0..=1000 {
            let s = Jet::variable(chain.length() * f64::from(i) / 1e3);
            let Some(ShapePoint::Flange(place)) = chain.at(s) else {
                panic!("no place")
            };
            let speed = rcc_core::vector::norm(place.rates().linear[0]);
            assert!(speed <= 1.0 + 1e-12, "{speed}");
        }
    }
}

proptest! {
    #[test]
    fn derivatives_of_every_shape_are_right(
        a in prop::array::uniform3(-0.5..0.5f64), b in prop::array::uniform3(-0.5..0.5f64),
        c in prop::array::uniform3(-0.5..0.5f64), rpy in prop::array::uniform3(-0.7..0.7f64), part in 0.0..1.0f64,
    ) {
        let poses = [pose(a, [0.0; 3]), pose(b, rpy), pose(c, rpy.map(|x| -x))];
        prop_assume!(distance(a, b) > 0.05 && distance(b, c) > 0.05 && distance(a, c) > 0.05);
        let line = Line::new(&poses[0], &poses[1], METRIC).unwrap();
        derivatives_are_right(&Shape::Line(line), part * line.length());
        let mode = (CircleOrientation::Even, None);
        if let Ok(circle) = Circle::new(&poses[0], b, &poses[2], mode, METRIC) {
            prop_assume!(circle.radius_m() < 10.0);
            derivatives_are_right(&Shape::Circle(circle), part * circle.length());
        }
        let spline = Spline::new(&poses, METRIC).unwrap();
        prop_assert!(spline.at(spline.length()).pose().distance_to(&poses[2]) < 1e-12);
    }

    #[test]
    fn a_spline_of_random_points_meets_them(points in prop::collection::vec(prop::array::uniform3(-0.5..0.5f64), 2..12)) {
        let poses: Vec<Pose> = points.iter().map(|xyz| pose(*xyz, [0.1, xyz[0], xyz[1]])).collect();
        prop_assume!(points.windows(2).all(|pair| distance(pair[0], pair[1]) > 0.02));
        let spline = Spline::new(&poses, METRIC).unwrap();
        for (s, want) in spline.points().iter().zip(&poses) {
            let at = spline.at(*s).pose();
            prop_assert!(at.distance_to(want) < 1e-11 && at.angle_to(want) < 1e-11);
        }
    }

    #[test]
    fn a_line_of_joints_is_even_and_ends_exactly(a in prop::array::uniform8(-3.0..3.0f64), b in prop::array::uniform8(-3.0..3.0f64)) {
        let line = JointLine::new(&a, &b, 0.5).unwrap();
        prop_assert_eq!(line.at(0.0), a);
        prop_assert_eq!(line.at(line.length()), b);
        derivatives_are_right(&Shape::Joints(line), 0.4 * line.length());
    }
}

#[test]
fn a_blend_between_joint_space_and_a_line_is_made_in_joint_space() {
    let line = JointLine::new(&[0.0; 8], &[0.5; 8], 1.0).unwrap();
    let other = JointLine::new(&[0.5; 8], &[0.1, 0.9, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5], 1.0).unwrap();
    let links = [line, other].map(|line| ChainLink {
        shape: Shape::Joints(line),
        zone: [0.1, 0.05],
    });
    let joints = |_: usize, shape: &Shape, s: f64| match shape.at(Jet::variable(s)) {
        ShapePoint::Joints(joints) => Ok::<_, ()>(joints),
        ShapePoint::Flange(_) => Err(()),
    };
    let chain = Chain::new(links.to_vec(), joints).unwrap();
    assert_eq!(chain.pieces().len(), 3);
    assert!((chain.length() - 0.9).abs() < 1e-12);
    for pair in chain.pieces().windows(2) {
        let s = Jet::variable(pair[0].end);
        for (a, b) in numbers(pair[0].at(s)).iter().zip(numbers(pair[1].at(s))) {
            for order in 0..3 {
                assert!((a.derivative(order) - b.derivative(order)).abs() < 1e-11);
            }
        }
    }
}
