//! Rotations compared with nalgebra as an independent implementation, and round trips between representations. Test
//! code.

#![allow(clippy::unwrap_used)]
extern crate std;

use super::*;
use core::f64::consts::FRAC_1_SQRT_2;
use nalgebra::{Matrix3, Quaternion as Nalgebra, Rotation3, Unit, UnitQuaternion, Vector3};
use proptest::prelude::*;

fn independent([x, y, z, w]: Quaternion) -> UnitQuaternion<f64> {
    UnitQuaternion::new_normalize(Nalgebra::new(w, x, y, z))
}

/// Returns the angle between two rotations, whatever their signs.
fn apart(a: Quaternion, b: Quaternion) -> f64 {
    let (difference, sum) = (
        a.iter()
            .zip(b)
            .map(|(a, b)| (a - b) * (a - b))
            .sum::<f64>()
            .sqrt(),
        a.iter()
            .zip(b)
            .map(|(a, b)| (a + b) * (a + b))
            .sum::<f64>()
            .sqrt(),
    );
    4.0 * difference.min(sum).atan2(difference.max(sum))
}

fn far(a: Vector, b: Vector) -> f64 {
    vector::norm(vector::subtract(a, b))
}

fn any_rotation() -> impl Strategy<Value = Quaternion> {
    prop::array::uniform4(-1.0..1.0f64).prop_filter_map("a direction", |q| {
        let long = q.iter().map(|x| x * x).sum::<f64>() > 1e-4;
        long.then(|| unit(q)).flatten()
    })
}

fn any_vector() -> impl Strategy<Value = Vector> {
    prop::array::uniform3(-10.0..10.0f64)
}

#[test]
fn logarithm_and_exponential_undo_each_other_near_no_turn_and_near_half_a_turn() {
    let axis = vector::normalized([1.0, -2.0, 0.5]).unwrap();
    for angle in [
        0.0,
        5e-324,
        1e-300,
        1e-160,
        1e-20,
        1e-9,
        9.9e-5,
        1.01e-4,
        1.0,
        PI - 1e-4,
        PI - 1e-9,
        PI - 1e-15,
    ] {
        let vector = vector::scale(axis, angle);
        let back = log(exp(vector));
        assert!(
            far(back, vector) <= 1e-15 * angle.max(1e-300) + 5e-16 * angle,
            "{angle}: {back:?}"
        );
    }
}

#[test]
fn a_million_turns_leave_a_rotation_of_length_one() {
    let step = exp([0.7, -1.1, 0.3]);
    let turned = (0..1_000_000).fold(IDENTITY, |q, _| product(step, q));
    let length: f64 = turned.iter().map(|x| x * x).sum::<f64>().sqrt();
    assert!((length - 1.0).abs() < 1e-15, "{length}");
    // The angle is still that of a million rotations.
    let expected = from_axis_angle([0.7, -1.1, 0.3], 1e6 * vector::norm([0.7, -1.1, 0.3])).unwrap();
    assert!(
        apart(turned, expected) < 1e-9,
        "{}",
        apart(turned, expected)
    );
}

#[test]
fn at_the_gimbal_lock_yaw_is_zero_and_the_rotation_is_kept() {
    for pitch in [FRAC_PI_2, -FRAC_PI_2] {
        let rotation = from_rpy([0.3, pitch, 0.9]);
        let [roll, found, yaw] = to_rpy(rotation);
        assert!((found - pitch).abs() < 1e-15 && yaw == 0.0, "{found} {yaw}");
        assert!(
            (roll - (0.3 - 0.9 * pitch.signum())).abs() < 1e-14,
            "{roll}"
        );
        assert!(apart(from_rpy([roll, found, yaw]), rotation) < 1e-14);
    }
}

#[test]
fn near_the_gimbal_lock_no_digit_is_lost() {
    for off in [1e-3, 1e-6, 1e-8, 1e-11, 1e-13] {
        let rotation = from_rpy([0.3, FRAC_PI_2 - off, 0.9]);
        let back = to_rpy(rotation);
        assert!(apart(from_rpy(back), rotation) < 3e-10, "{off}");
        assert!((back[1] - (FRAC_PI_2 - off)).abs() < 1e-15, "{off}");
    }
}

#[test]
fn opposite_directions_have_no_shortest_turn_and_nearly_opposite_ones_have() {
    assert_eq!(between([1.0, 2.0, 3.0], [-2.0, -4.0, -6.0]), None);
    for off in [1e-3, 1e-6, 1e-8] {
        let to = [-1.0, off, 0.0];
        let turn = between([1.0, 0.0, 0.0], to).unwrap();
        assert!(
            far(
                rotate(turn, [1.0, 0.0, 0.0]),
                vector::normalized(to).unwrap()
            ) < 1e-7,
            "{off}"
        );
    }
    assert_eq!(between([0.0; 3], [1.0, 0.0, 0.0]), None);
}

#[test]
fn an_invalid_rotation_matrix_has_no_rotation() {
    let mirror = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]];
    let stretched = [[1.01, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for matrix in [
        mirror,
        stretched,
        [[0.0; 3]; 3],
        [[f64::NAN; 3]; 3],
        [[f64::INFINITY; 3]; 3],
    ] {
        assert_eq!(from_matrix(&matrix), None, "{matrix:?}");
    }
    let rounded = [[0.0, -0.9999, 0.0], [1.0001, 0.0, 0.0001], [0.0, 0.0, 1.0]];
    let exact = from_axis_angle([0.0, 0.0, 1.0], FRAC_PI_2).unwrap();
    assert!(apart(from_matrix(&rounded).unwrap(), exact) < 1e-4);
}

#[test]
fn a_rotation_by_180_degrees_has_one_rotation_vector_whatever_the_sign() {
    for [x, y, z] in [
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
        [0.6, -0.8, 0.0],
    ] {
        let vector = log([x, y, z, 0.0]);
        assert_eq!(vector, log([-x, -y, -z, 0.0]));
        assert!((vector::norm(vector) - PI).abs() < 1e-15);
    }
    assert_eq!(slerp(IDENTITY, [1.0, 0.0, 0.0, 0.0], 0.5), None);
}

#[test]
fn the_curve_leaves_and_arrives_with_the_velocities_of_its_control_rotations() {
    let (a, d) = (exp([0.1, 0.2, -0.3]), exp([1.0, -0.4, 0.6]));
    let (start, end) = ([0.6, -0.9, 0.3], [-0.2, 0.5, 0.8]);
    let third = |v| vector::scale(v, 1.0 / 3.0);
    let curve = [
        a,
        product(exp(third(start)), a),
        product(inverse(exp(third(end))), d),
        d,
    ];
    let h = 1e-6;
    let rate = |s: f64| {
        let (before, after) = (bezier(curve, s - h).unwrap(), bezier(curve, s + h).unwrap());
        vector::scale(error(before, after), 0.5 / h)
    };
    assert!(
        far(rate(0.0), start) < 1e-8 && far(rate(1.0), end) < 1e-8,
        "{:?} {:?}",
        rate(0.0),
        rate(1.0)
    );
    assert!(
        apart(bezier(curve, 0.0).unwrap(), a) < 1e-15
            && apart(bezier(curve, 1.0).unwrap(), d) < 1e-15
    );
}

#[test]
fn a_quaternion_that_cannot_be_normalized_is_none() {
    for q in [
        [0.0; 4],
        [f64::NAN, 0.0, 0.0, 1.0],
        [f64::INFINITY, 0.0, 0.0, 0.0],
        [1e200; 4],
        [1e-200; 4],
    ] {
        assert_eq!(unit(q), None, "{q:?}");
    }
    assert_eq!(unit([0.0, 0.0, 0.0, 2.0]), Some(IDENTITY));
    assert_eq!(
        unit([FRAC_1_SQRT_2, 0.0, 0.0, FRAC_1_SQRT_2]),
        Some([FRAC_1_SQRT_2, 0.0, 0.0, FRAC_1_SQRT_2])
    );
}

proptest! {
    #[test]
    fn nalgebra_finds_the_same(a in any_rotation(), b in any_rotation(), v in any_vector()) {
        let (p, q) = (independent(a), independent(b));
        prop_assert!((p * q).angle_to(&independent(product(a, b))) < 1e-7);
        let turned: Vector = (p * Vector3::from(v)).into();
        prop_assert!(far(turned, rotate(a, v)) < 1e-13);
        let [[m11, m12, m13], [m21, m22, m23], [m31, m32, m33]] = to_matrix(a);
        let matrix = Matrix3::new(m11, m12, m13, m21, m22, m23, m31, m32, m33);
        prop_assert!((matrix - p.to_rotation_matrix().matrix()).norm() < 1e-14);
        let (roll, pitch, yaw) = Rotation3::from_matrix_unchecked(matrix).euler_angles();
        prop_assert!(apart(from_rpy([roll, pitch, yaw]), a) < 1e-7);
        let (axis, angle) = to_axis_angle(a);
        prop_assert!((angle - p.angle()).abs() < 1e-7);
        prop_assert!(p.axis().is_none_or(|known| known.dot(&Vector3::from(axis)).abs() > 1.0 - 1e-12));
        let built = UnitQuaternion::from_axis_angle(&Unit::new_normalize(Vector3::from(v)), angle);
        let ours = from_axis_angle(v, angle).unwrap();
        prop_assert!(apart(ours, built.into_inner().coords.into()) < 1e-14);
    }

    #[test]
    fn split_and_make_are_inverse(q in any_rotation()) {
        prop_assert!(apart(exp(log(q)), q) < 1e-14);
        prop_assert!(apart(from_rpy(to_rpy(q)), q) < 1e-14);
        prop_assert!(apart(from_matrix(&to_matrix(q)).unwrap(), q) < 1e-14);
        let (axis, angle) = to_axis_angle(q);
        prop_assert!(apart(from_axis_angle(axis, angle).unwrap(), q) < 1e-14);
        let [[a, b, _], [d, e, _], [g, h, _]] = to_matrix(q);
        prop_assert!(apart(from_axes([a, d, g], [b, e, h]).unwrap(), q) < 1e-14);
    }

    #[test]
    fn both_signs_are_the_same_rotation(q in any_rotation(), v in any_vector(), s in 0.0..1.0) {
        let other = q.map(|x| -x);
        prop_assert_eq!(log(q), log(other));
        prop_assert_eq!(to_matrix(q), to_matrix(other));
        prop_assert_eq!(to_axis_angle(q), to_axis_angle(other));
        prop_assert!(far(rotate(q, v), rotate(other, v)) == 0.0);
        prop_assert!(far(to_rpy(q), to_rpy(other)) < 1e-14 || to_rpy(q).iter().any(|a| a.abs() > PI - 1e-9));
        if let (Some(a), Some(b)) = (slerp(IDENTITY, q, s), slerp(IDENTITY, other, s)) {
            prop_assert!(apart(a, b) < 1e-14);
        }
    }

    #[test]
    fn angles_are_in_their_ranges(q in any_rotation()) {
        let [roll, pitch, yaw] = to_rpy(q);
        prop_assert!(roll.abs() <= PI && pitch.abs() <= FRAC_PI_2 && yaw.abs() <= PI);
        prop_assert!((0.0..=PI).contains(&to_axis_angle(q).1));
    }

    #[test]
    fn interpolation_is_uniform(a in any_rotation(), b in any_rotation(), s in -1.0..2.0f64) {
        prop_assume!(apart(a, b) < 3.1);
        let way = slerp(a, b, s).unwrap();
        prop_assert!(far(error(a, way), vector::scale(error(a, b), s)) < 1e-13 || (s * apart(a, b)).abs() > 3.1);
        let independent = independent(a).try_slerp(&independent(b), s, 1e-9).unwrap();
        prop_assert!(apart(way, independent.into_inner().coords.into()) < 1e-7);
    }

    #[test]
    fn the_shortest_turn_brings_one_direction_to_the_other(u in any_vector(), v in any_vector()) {
        prop_assume!(vector::norm(u) > 1e-3 && vector::norm(v) > 1e-3);
        let (from, to) = (vector::normalized(u).unwrap(), vector::normalized(v).unwrap());
        prop_assume!(vector::norm(vector::add(from, to)) > 1e-3);
        let turn = between(u, v).unwrap();
        prop_assert!(far(rotate(turn, from), to) < 1e-12);
        prop_assert!((to_axis_angle(turn).1 - vector::dot(from, to).clamp(-1.0, 1.0).acos()).abs() < 1e-6);
    }

    #[test]
    fn no_number_makes_it_panic(a in prop::array::uniform4(any::<f64>()), b in prop::array::uniform4(any::<f64>()), s in any::<f64>()) {
        let [x, y, z, w] = b;
        let m = [[x, y, z], [w, x, y], [z, w, s]];
        std::hint::black_box((unit(a), product(a, b), log(a), exp([x, y, z]), slerp(a, b, s), bezier([a, b, a, b], s)));
        std::hint::black_box((to_rpy(a), from_rpy([x, y, z]), from_matrix(&m), from_axes([x, y, z], [y, z, w])));
        std::hint::black_box((between([x, y, z], [y, z, w]), to_axis_angle(a), from_axis_angle([x, y, z], s)));
    }
}
