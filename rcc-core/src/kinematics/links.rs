//! The ends of an arm's links, as they are drawn. Plain data without heap.

use super::axes::AXES_MAX;

/// Base, axes and flange.
const POINTS_MAX: usize = AXES_MAX + 2;

/// Points in the base frame from the base to the flange, m, one after the other along the arm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinkPoints {
    points: [[f64; 3]; POINTS_MAX],
    count: usize,
}

impl LinkPoints {
    /// Collects the points; those beyond an axis more than any arm has are ignored.
    pub(super) fn of(points: impl IntoIterator<Item = [f64; 3]>) -> LinkPoints {
        let mut all = LinkPoints {
            points: [[0.0; 3]; POINTS_MAX],
            count: 0,
        };
        for (place, point) in all.points.iter_mut().zip(points) {
            *place = point;
            all.count += 1;
        }
        all
    }

    /// Returns the points, at least base and flange.
    #[must_use]
    pub fn as_slice(&self) -> &[[f64; 3]] {
        self.points.get(..self.count).unwrap_or(&[])
    }
}
