//! Blends: quintic curves from a point of one shape to a point of the next, C2 at both ends. Plain numbers; evaluated
//! by the real-time thread.
//!
//! Between two straight lines with zones of equal length, the derivative by s is a weighted mean of the two directions
//! with weights in [0, 1], so the blend is never faster than the lines; a blend of 180° reverses through rest.

use rcc_core::rotation::{self, Quaternion};

use super::Placement;
use super::jet::{self, Jet, JetScalar};
use super::quintic::{Quintic, QuinticEnd};

/// A blend of the flange: position, and orientation in modified Rodrigues parameters relative to its beginning.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseBlend {
    curve: Quintic<6>,
    reference: Quaternion,
}

impl PoseBlend {
    /// The blend from one placement to another over `length` (> 0) of s. `None` if it rotates by more than 4 rad.
    #[must_use]
    pub fn between(from: &Placement<Jet>, to: &Placement<Jet>, length: f64) -> Option<Self> {
        let reference = from.orientation.map(JetScalar::value);
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

    /// The pose at `s`.
    #[inline]
    pub fn at<T: JetScalar>(&self, s: T) -> Placement<T> {
        let [x, y, z, a, b, c] = self.curve.at(s);
        let reference = self.reference.map(T::constant);
        Placement {
            position: [x, y, z],
            orientation: jet::product(reference, jet::from_rodrigues([a, b, c])),
        }
    }
}

/// A blend in joint space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointBlend {
    curve: Quintic<8>,
}

impl JointBlend {
    /// The blend from joints to joints over `length` (> 0) of s.
    #[must_use]
    pub fn between(from: [Jet; 8], to: [Jet; 8], length: f64) -> Self {
        Self {
            curve: Quintic::between(ends(from), ends(to), length),
        }
    }

    /// The joints at `s`, rad.
    #[inline]
    pub fn at<T: JetScalar>(&self, s: T) -> [T; 8] {
        self.curve.at(s)
    }
}

fn ends<const N: usize>(values: [Jet; N]) -> QuinticEnd<N> {
    [0, 1, 2].map(|order| values.map(|x| x.derivative(order)))
}
