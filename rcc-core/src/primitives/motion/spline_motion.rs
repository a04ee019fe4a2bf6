//! `SplineMotion`: a jerk-limited smooth curve of the flange through poses, with a stop on the path.
//!
//! A natural spline of degree 5 in position and orientation: among all curves through the poses, it has the least mean
//! square of the third derivative. Joints are computed as well, with the arm angle and the branch of the start.

use super::path_motion::{self, motion_operands};
use crate::frame::{Preparation, PrepareFault};
use crate::path::{LEGS_MAX, PathSegment};
use crate::pose::Pose;
use crate::primitive::{
    CatalogueEntry, Dim, Kernel, NullRule, Parameter, ParameterKind, Prepare, Role, Slot, Spec,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "SplineMotion",
        summary: "A jerk-limited smooth curve of the flange through poses, with a soft stop on the path.",
        null: path_motion::NULL,
        null_rule: NullRule::Known,
        formula: "natural spline of degree 5 (de Boor, A Practical Guide to Splines, XIII) over chord length, followed by arc length; orientation in modified Rodrigues parameters",
        inputs: &path_motion::INPUTS,
        outputs: &path_motion::OUTPUTS,
        parameters: &[
            Parameter::arm(),
            Parameter::new(
                "through",
                ParameterKind::Poses(Dim::Var(0)),
                "poses of the flange in the arm's base through which the curve passes, up to 128; the last one is the end",
            ),
            path_motion::FLANGE[0],
            path_motion::FLANGE[1],
            path_motion::FLANGE[2],
            path_motion::FLANGE[3],
            path_motion::FLANGE[4],
            path_motion::FLANGE[5],
            path_motion::SCALE,
            path_motion::TIME_OPTIMAL,
            path_motion::STOPS,
            path_motion::ARM_ANGLE,
            path_motion::ELBOW,
        ],
        role: Role::Motion,
        ..Spec::PLAIN
    },
    &[Kernel::each::<SplineMotion>()],
)
.prepared_by::<SplineMotion>();

motion_operands! {
    SplineMotion { through: Slot<Pose> } and flange limits, count
}

impl Prepare for SplineMotion {
    fn prepare(self, preparation: &mut Preparation<'_>) -> Result<(), PrepareFault> {
        let mut poses = [Pose::NULL; LEGS_MAX];
        for (pose, row) in poses.iter_mut().zip(0..self.count) {
            *pose = preparation.get(self.through + 7 * row);
        }
        let Some(through) = poses.get(..self.count as usize) else {
            return Err(super::motion_sequence::too_many(self.motion, self.count));
        };
        self.build(preparation, None, PathSegment::Spline { through })
    }
}
