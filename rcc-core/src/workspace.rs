//! Where an arm may be: a box in its base frame, for the flange or a point that is fixed to it, and not next to a singular
//! position.
//! Plain data and arithmetic; what a net would do is held against it before the net starts.

use crate::kinematics::Singularity;
use crate::pose::Pose;

/// A box whose edges are parallel to the axes of the arm's base, bounds included.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Workspace {
    /// Smallest x, y and z, m; -∞ = no bound.
    pub lower: [f64; 3],
    /// Largest x, y and z, m; ∞ = no bound.
    pub upper: [f64; 3],
    /// What must stay inside, in the frame of the flange, m; the origin is the flange itself.
    pub point: [f64; 3],
    /// An arm does not come nearer to a singular position than this, as [`Singularity::distance`] measures it; 0 = it may.
    pub singularity_min: f64,
}

/// Where a point is outside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outside {
    /// 0, 1, 2: x, y, z.
    pub axis: u8,
    /// Where the point is on that axis, m.
    pub value: f64,
    /// The bound that it is beyond, m.
    pub limit: f64,
}

/// Rounding, m: a pose that was made for the bound itself is inside.
const ROUNDING_M: f64 = 1e-9;
/// Rounding of a distance to a singular position.
const ROUNDING_SINE: f64 = 1e-12;

impl Workspace {
    /// Without any bound, for the flange.
    pub const ANYWHERE: Workspace = Workspace {
        lower: [f64::NEG_INFINITY; 3],
        upper: [f64::INFINITY; 3],
        point: [0.0; 3],
        singularity_min: 0.0,
    };

    /// The point in the base when the flange is there.
    #[must_use]
    pub fn point_at(&self, flange: &Pose) -> [f64; 3] {
        let [x, y, z] = flange.rotate(self.point);
        let [a, b, c] = flange.position;
        [a + x, b + y, c + z]
    }

    /// Whether an arm that was so far from a singular position (`before`, NaN = not known) comes too near to one. Who is too
    /// near may go away from it: an arm that rests there can be moved.
    #[must_use]
    pub fn comes_too_near(&self, now: &Singularity, before: f64) -> bool {
        let nearer = before.is_nan() || now.distance < before - ROUNDING_SINE;
        now.distance < self.singularity_min && nearer
    }

    /// The first bound that the point is beyond, if the flange is there; a pose that is not finite is beyond.
    #[must_use]
    pub fn outside(&self, flange: &Pose) -> Option<Outside> {
        let point = self.point_at(flange);
        let bounds = self.lower.into_iter().zip(self.upper);
        for ((value, (lower, upper)), axis) in point.into_iter().zip(bounds).zip(0..) {
            let limit = if value >= lower - ROUNDING_M {
                upper
            } else {
                lower
            };
            let inside = value >= lower - ROUNDING_M && value <= upper + ROUNDING_M;
            if !inside {
                return Some(Outside { axis, value, limit });
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kinematics::SingularityKind;

    const BOX: Workspace = Workspace {
        lower: [0.2, -0.5, f64::NEG_INFINITY],
        upper: [0.8, 0.5, 1.0],
        point: [0.0, 0.0, 0.1],
        singularity_min: 0.0,
    };

    #[test]
    fn bounds_are_inside_and_what_is_beyond_is_named() {
        let down = [core::f64::consts::PI, 0.0, 0.0];
        let at = |x, y, z| Pose::from_xyz_rpy([x, y, z], down);
        // The tool points down: its tip is 0.1 m below the flange.
        assert_eq!(BOX.outside(&at(0.2, 0.5, 1.1)), None);
        assert_eq!(BOX.outside(&at(0.3, 0.0, -5.0)), None);
        let above = BOX.outside(&at(0.3, 0.0, 1.2)).unwrap();
        assert_eq!((above.axis, above.limit), (2, 1.0));
        assert!((above.value - 1.1).abs() < 1e-12);
        let left = BOX.outside(&at(0.3, -0.6, 0.0)).unwrap();
        assert_eq!((left.axis, left.value, left.limit), (1, -0.6, -0.5));
    }

    #[test]
    fn an_arm_may_go_away_from_a_singular_position_but_not_nearer() {
        let space = Workspace {
            singularity_min: 0.1,
            ..BOX
        };
        let at = |distance| Singularity {
            kind: SingularityKind::Elbow,
            distance,
        };
        assert!(!space.comes_too_near(&at(0.1), 0.2), "the bound itself");
        assert!(space.comes_too_near(&at(0.09), 0.11));
        assert!(space.comes_too_near(&at(0.09), f64::NAN));
        assert!(!space.comes_too_near(&at(0.05), 0.04), "away from it");
        assert!(!space.comes_too_near(&at(0.05), 0.05), "at rest");
        assert!(!BOX.comes_too_near(&at(0.0), 0.1), "without a bound");
    }

    #[test]
    fn what_is_no_pose_is_outside_even_of_what_has_no_bounds() {
        let nowhere = Pose::from_slots([f64::NAN; 7]);
        assert!(Workspace::ANYWHERE.outside(&nowhere).is_some());
    }
}
