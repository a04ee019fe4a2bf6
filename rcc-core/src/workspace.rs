//! The region that an arm may occupy: a box in its base frame, for the flange or a point fixed to it, and a minimum
//! distance from singularities. Plain data and arithmetic. A net is checked against it before it starts, and each
//! set-point by the guard.

use crate::joints::Joints;
use crate::kinematics::{Arm, Singularity};
use crate::pose::Pose;

/// A box whose edges are parallel to the axes of the arm's base, bounds included, and a minimum distance from
/// singularities.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Workspace {
    /// Smallest x, y and z, m; -∞ = no bound.
    pub lower: [f64; 3],
    /// Largest x, y and z, m; ∞ = no bound.
    pub upper: [f64; 3],
    /// The point that must stay inside, in the flange frame, m; the origin is the flange itself.
    pub point: [f64; 3],
    /// Smallest distance from a singularity, as in [`Singularity::distance`]; 0 = unrestricted.
    pub singularity_min: f64,
}

/// The way in which an arm leaves its workspace.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum WorkspaceViolation {
    /// Through a side of the box.
    Box {
        /// 0, 1, 2: x, y, z.
        axis: u8,
        /// Requested coordinate of the point on that axis, m.
        value: f64,
        /// The bound that it exceeds, m.
        limit: f64,
    },
    /// Too close to a singularity.
    Singular {
        /// The singularity and its distance.
        near: Singularity,
        /// Smallest allowed distance.
        limit: f64,
    },
}

/// Checks that an arm stays in its workspace. An arm at rest outside may come back or stay, but not move further out.
#[derive(Clone, Copy, Debug)]
pub struct WorkspaceGuard {
    arm: Arm,
    space: Workspace,
    /// For the last set-point: how far the point is beyond the bounds of each axis, m (negative = inside), and the
    /// distance from a singularity. ∞ and 0 = any start is accepted.
    beyond: [f64; 3],
    distance: f64,
}

/// Tolerance for rounding, m: a pose made for the bound itself is inside.
const ROUNDING_M: f64 = 1e-9;
/// Tolerance for rounding in the computed position of an arm that rests outside (m, or a sine).
const ROUNDING: f64 = 1e-12;

impl Workspace {
    /// A workspace without bounds, for the flange.
    pub const ANYWHERE: Workspace = Workspace {
        lower: [f64::NEG_INFINITY; 3],
        upper: [f64::INFINITY; 3],
        point: [0.0; 3],
        singularity_min: 0.0,
    };

    /// Returns the monitored point in the base frame for a pose of the flange, m.
    #[must_use]
    pub fn point_at(&self, flange: &Pose) -> [f64; 3] {
        let [x, y, z] = flange.rotate(self.point);
        let [a, b, c] = flange.position;
        [a + x, b + y, c + z]
    }
}

impl WorkspaceGuard {
    /// Creates a check for an arm that may start at rest anywhere.
    #[must_use]
    pub fn new(arm: Arm, space: Workspace) -> WorkspaceGuard {
        WorkspaceGuard {
            arm,
            space,
            beyond: [f64::INFINITY; 3],
            distance: 0.0,
        }
    }

    /// Sets the position at which the arm is at rest, rad; it may be outside.
    pub fn begin(&mut self, joints: &Joints) {
        let (point, near) = self.at(joints);
        self.beyond = self.beyond_of(&point).map(|(beyond, _)| beyond);
        self.distance = near.map_or(0.0, |near| near.distance);
    }

    /// Checks a further set-point, rad.
    ///
    /// # Errors
    /// Returns how the set-point leaves the workspace; a null set-point counts as outside. The next set-point is then
    /// compared with the last accepted one.
    pub fn check(&mut self, joints: &Joints) -> Result<(), WorkspaceViolation> {
        let (point, near) = self.at(joints);
        let now = self.beyond_of(&point);
        for (((beyond, limit), last), (value, axis)) in now
            .into_iter()
            .zip(self.beyond)
            .zip(point.into_iter().zip(0..))
        {
            // The comparison is written so that NaN is a violation.
            let stays = beyond <= ROUNDING_M || beyond <= last + ROUNDING;
            if !stays {
                return Err(WorkspaceViolation::Box { axis, value, limit });
            }
        }
        if let Some(near) = near {
            let limit = self.space.singularity_min;
            let stays = near.distance >= limit || near.distance >= self.distance - ROUNDING;
            if !stays {
                return Err(WorkspaceViolation::Singular { near, limit });
            }
            self.distance = near.distance;
        }
        self.beyond = now.map(|(beyond, _)| beyond);
        Ok(())
    }

    /// Returns the monitored point, and the nearest singularity if its distance is limited.
    fn at(&self, joints: &Joints) -> ([f64; 3], Option<Singularity>) {
        let point = self.space.point_at(&self.arm.forward(joints));
        let bounded = self.space.singularity_min > 0.0;
        (point, bounded.then(|| self.arm.singularity(joints)))
    }

    /// Returns how far a point is beyond the nearer bound of each axis, and that bound.
    fn beyond_of(&self, point: &[f64; 3]) -> [(f64, f64); 3] {
        let Workspace { lower, upper, .. } = self.space;
        core::array::from_fn(|axis| {
            let [value, lower, upper] =
                [point, &lower, &upper].map(|of| of.get(axis).copied().unwrap_or(f64::NAN));
            if lower - value > value - upper {
                (lower - value, lower)
            } else {
                (value - upper, upper)
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::lwr;

    const REST: Joints = [0.3, -0.5, -0.2, 1.4, 0.1, -1.0, 0.3, 0.0];

    fn arm() -> Arm {
        lwr().arm.unwrap()
    }

    fn resting(space: Workspace, joints: &Joints) -> WorkspaceGuard {
        let mut stay = WorkspaceGuard::new(arm(), space);
        stay.begin(joints);
        assert_eq!(stay.check(joints), Ok(()), "at rest");
        stay
    }

    /// `REST` with joint 1 rotated by `by`, which moves the flange along y.
    fn turned(by: f64) -> Joints {
        let mut joints = REST;
        joints[0] += by;
        joints
    }

    fn y_of(joints: &Joints) -> f64 {
        arm().forward(joints).position[1]
    }

    #[test]
    fn the_bounds_are_inside_and_a_violated_bound_is_named() {
        let mut space = Workspace::ANYWHERE;
        space.upper[1] = y_of(&turned(0.1));
        let mut stay = resting(space, &REST);
        assert_eq!(stay.check(&turned(0.1)), Ok(()), "the bound itself");
        let outside = stay.check(&turned(0.11));
        let (value, limit) = (y_of(&turned(0.11)), space.upper[1]);
        assert_eq!(
            outside,
            Err(WorkspaceViolation::Box {
                axis: 1,
                value,
                limit
            })
        );
        assert_eq!(stay.check(&turned(-0.5)), Ok(()), "the other way");
        space.lower[1] = y_of(&turned(-0.1));
        let outside = resting(space, &REST).check(&turned(-0.2));
        assert!(
            matches!(outside, Err(WorkspaceViolation::Box { axis: 1, limit, .. }) if limit == space.lower[1])
        );
    }

    #[test]
    fn the_monitored_point_stays_inside() {
        let at = |point| {
            Workspace {
                point,
                ..Workspace::ANYWHERE
            }
            .point_at(&arm().forward(&REST))
        };
        let (flange, tip) = (at([0.0; 3]), at([0.0, 0.0, 0.2]));
        let mut space = Workspace::ANYWHERE;
        space.point = [0.0, 0.0, 0.2];
        space.lower[2] = (flange[2] + tip[2]) / 2.0;
        assert!(tip[2] < flange[2], "the tool points down");
        let mut stay = WorkspaceGuard::new(arm(), space);
        stay.begin(&[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        let Err(WorkspaceViolation::Box { axis: 2, value, .. }) = stay.check(&REST) else {
            panic!("the tip is below");
        };
        assert!((value - tip[2]).abs() < 1e-12);
    }

    #[test]
    fn an_arm_outside_may_come_back_but_not_go_further() {
        let mut space = Workspace::ANYWHERE;
        space.upper[1] = y_of(&turned(-0.2));
        let mut stay = resting(space, &REST);
        assert!(stay.check(&turned(1e-6)).is_err(), "further out");
        assert_eq!(stay.check(&turned(-0.1)), Ok(()), "nearer");
        assert!(stay.check(&turned(-0.09)).is_err(), "out again");
        assert_eq!(stay.check(&turned(-0.3)), Ok(()), "inside");
        assert!(stay.check(&turned(-0.19)).is_err(), "it was inside");
    }

    #[test]
    fn an_arm_may_go_away_from_a_singular_position_but_not_nearer() {
        let bent = |by: f64| {
            let mut joints = REST;
            joints[3] = by;
            joints
        };
        let space = Workspace {
            singularity_min: libm::sin(0.1),
            ..Workspace::ANYWHERE
        };
        let mut stay = resting(space, &bent(0.2));
        assert_eq!(stay.check(&bent(0.11)), Ok(()));
        let Err(WorkspaceViolation::Singular { near, .. }) = stay.check(&bent(0.09)) else {
            panic!("too near");
        };
        assert!((near.distance - libm::sin(0.09)).abs() < 1e-12);
        let mut stay = resting(space, &bent(0.04));
        assert_eq!(stay.check(&bent(0.05)), Ok(()), "away from it");
        assert!(stay.check(&bent(0.045)).is_err(), "nearer again");
        assert_eq!(
            resting(Workspace::ANYWHERE, &bent(0.04)).check(&bent(0.0)),
            Ok(())
        );
    }

    #[test]
    fn null_is_outside_even_an_unbounded_workspace() {
        let nowhere = [f64::NAN; crate::message::JOINTS_MAX];
        assert!(resting(Workspace::ANYWHERE, &REST).check(&nowhere).is_err());
    }
}
