//! Vectors of three numbers: the basic operations for directions, rotations, twists and wrenches. Pure mathematics
//! without allocation or panic; NaN in, NaN out. Used by the loader and by the real-time thread.

/// Three numbers along x, y and z.
pub type Vector = [f64; 3];

/// Two directions count as parallel if the sine of the angle between them is below this, and as opposite if their sum
/// is shorter: below it, rounding dominates.
pub const PARALLEL_SINE: f64 = 1e-9;

/// a + b.
#[must_use]
pub fn add([a, b, c]: Vector, [x, y, z]: Vector) -> Vector {
    [a + x, b + y, c + z]
}

/// a − b.
#[must_use]
pub fn subtract([a, b, c]: Vector, [x, y, z]: Vector) -> Vector {
    [a - x, b - y, c - z]
}

/// Returns the vector multiplied by `factor`.
#[must_use]
pub fn scale([x, y, z]: Vector, factor: f64) -> Vector {
    [x * factor, y * factor, z * factor]
}

/// a · b, summed in the order x, y, z.
#[must_use]
pub fn dot([a, b, c]: Vector, [x, y, z]: Vector) -> f64 {
    a * x + b * y + c * z
}

/// a × b, right-handed.
#[must_use]
pub fn cross([a, b, c]: Vector, [x, y, z]: Vector) -> Vector {
    [b * z - c * y, c * x - a * z, a * y - b * x]
}

/// Returns the length; overflows only if the length itself is out of range.
#[must_use]
pub fn norm([x, y, z]: Vector) -> f64 {
    libm::hypot(libm::hypot(x, y), z)
}

/// Returns the unit vector; `None` for a vector of length zero, or one that is not finite.
#[must_use]
pub fn normalized(vector: Vector) -> Option<Vector> {
    // The largest element is scaled to 1 first, so that no square underflows or overflows.
    let [x, y, z] = vector.map(libm::fabs);
    let largest = libm::fmax(libm::fmax(x, y), z);
    if !is_finite(vector) || largest == 0.0 {
        return None;
    }
    let near_one = vector.map(|element| element / largest);
    let length = libm::sqrt(dot(near_one, near_one));
    Some(near_one.map(|element| element / length))
}

/// Returns true if every element is finite.
#[must_use]
pub fn is_finite(vector: Vector) -> bool {
    vector.iter().all(|element| element.is_finite())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    extern crate std;
    use super::*;
    use nalgebra::Vector3;
    use proptest::prelude::*;

    #[test]
    fn the_longest_and_the_shortest_vector_are_normalized() {
        for size in [f64::MAX, 1e200, 1.0, f64::MIN_POSITIVE, 5e-324] {
            let direction = normalized([size, 0.0, -size]).unwrap();
            let half = core::f64::consts::FRAC_1_SQRT_2;
            assert!(
                (direction[0] - half).abs() < 1e-15 && (direction[2] + half).abs() < 1e-15,
                "{size}"
            );
        }
        assert_eq!(normalized([0.0; 3]), None);
        assert_eq!(normalized([f64::INFINITY, 0.0, 0.0]), None);
        assert_eq!(normalized([f64::NAN, 0.0, 1.0]), None);
    }

    proptest! {
        #[test]
        fn everything_agrees_with_nalgebra(
            a in prop::array::uniform3(-1e3..1e3), b in prop::array::uniform3(-1e3..1e3), factor in -10.0..10.0,
        ) {
            let (u, v) = (Vector3::from(a), Vector3::from(b));
            prop_assert_eq!(add(a, b), <Vector>::from(u + v));
            prop_assert_eq!(subtract(a, b), <Vector>::from(u - v));
            prop_assert_eq!(scale(a, factor), <Vector>::from(u * factor));
            prop_assert!((dot(a, b) - u.dot(&v)).abs() <= 1e-9);
            prop_assert!((Vector3::from(cross(a, b)) - u.cross(&v)).norm() <= 1e-9);
            prop_assert!((norm(a) - u.norm()).abs() <= 1e-12 * u.norm());
        }
    }
}
