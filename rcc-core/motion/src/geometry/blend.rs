//! Roundings: curves of the fifth degree from a point of one path to a point of the next, C2 at both.
//! Evaluated by the real-time thread; plain numbers.
//!
//! Between two straight lines with zones of equal length the derivative by s is a mean of the two directions with weights
//! in [0, 1], so that the rounding is never faster than the lines; a rounding of 180° runs back through rest.

use rcc_core::rotation::{self, Quaternion};

use super::Placement;
use super::jet::{self, Jet, Scalar};
use super::quintic::{Quintic, QuinticEnd};

/// A rounding of the flange: position, and orientation in modified Rodrigues parameters relative to its beginning.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseBlend {
    curve: Quintic<6>,
    reference: Quaternion,
}

impl PoseBlend {
    /// From one place to another one, over `length` (> 0) of s. `None` if it turns by more than 4 rad.
    #[must_use]
    pub fn between(from: &Placement<Jet>, to: &Placement<Jet>, length: f64) -> Option<Self> {
        let reference = from.orientation.map(Scalar::value);
        let end = |place: &Placement<Jet>| {
            let back = rotation::inverse(reference).map(Jet::constant);
            let turn = jet::product(back, place.orientation);
            let near = turn[3].value();
            let turn = if near < 0.0 { turn.map(|x| -x) } else { turn };
            let ([x, y, z], [a, b, c]) = (place.position, jet::to_rodrigues(turn));
            ends([x, y, z, a, b, c])
        };
        let (from, to) = (end(from), end(to));
        let finite = from.iter().chain(&to).flatten().all(|x| x.is_finite());
        finite.then(|| Self {
            curve: Quintic::between(from, to, length),
            reference,
        })
    }

    /// Where the flange is.
    #[inline]
    pub fn at<T: Scalar>(&self, s: T) -> Placement<T> {
        let [x, y, z, a, b, c] = self.curve.at(s);
        let reference = self.reference.map(T::constant);
        Placement {
            position: [x, y, z],
            orientation: jet::product(reference, jet::from_rodrigues([a, b, c])),
        }
    }
}

/// A rounding of the joints.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointBlend {
    curve: Quintic<8>,
}

impl JointBlend {
    /// From joints to joints, over `length` (> 0) of s.
    #[must_use]
    pub fn between(from: [Jet; 8], to: [Jet; 8], length: f64) -> Self {
        Self {
            curve: Quintic::between(ends(from), ends(to), length),
        }
    }

    /// Where the joints are, rad.
    #[inline]
    pub fn at<T: Scalar>(&self, s: T) -> [T; 8] {
        self.curve.at(s)
    }
}

fn ends<const N: usize>(values: [Jet; N]) -> QuinticEnd<N> {
    [0, 1, 2].map(|order| values.map(|x| x.derivative(order)))
}
