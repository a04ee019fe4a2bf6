//! `MotionSequence`: point-to-point motions, lines, arcs and splines in sequence, with optional blending and one path
//! clock.
//!
//! A leg without `blend:` ends at rest. With it, the path is left this distance before its end and joined at the same
//! distance after it, by a curve that is smooth to the second derivative. Blends from and to a `ptp` are computed in
//! joint space.

use super::path_motion::{self, motion_operands};
use crate::frame::{Preparation, PrepareFault};
use crate::path::leg_row::{self, LegRow};
use crate::path::{LEGS_MAX, Leg, MotionFault, PathRequest, PathSegment};
use crate::pose::Pose;
use crate::primitive::{
    Bool, CatalogueEntry, Clock, Dim, Kernel, NullRule, Parameter, ParameterKind, Prepare, Real,
    Role, Slot, Spec,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "MotionSequence",
        summary: "Motions in sequence (ptp, lin, circ, spline) with optional blending and a soft stop on the path.",
        null: path_motion::NULL,
        null_rule: NullRule::Known,
        formula: "blends: polynomials of degree 5 in the path parameter, C2 at both ends",
        inputs: path_motion::INPUTS,
        outputs: path_motion::OUTPUTS,
        parameters: &[
            Parameter::arm(),
            Parameter::new(
                "path",
                ParameterKind::Path(Dim::Var(0)),
                "legs in order, up to 128 including all points of splines: `- {ptp: {joints: [...]}}`, `- {ptp: {pose: {xyz: ..., rpy: ...}}}`, `- {lin: {xyz: ..., rpy: ...}, blend: 20 mm, velocity: 0.2 m/s}`, `- {circ: {via: {xyz: ...}, to: {...}}}`, `- {spline: [{...}, {...}]}`",
            ),
            path_motion::SCALE,
            path_motion::TIME_OPTIMAL,
        ],
        role: Role::Motion,
        ..Spec::PLAIN
    },
    &[Kernel::each::<MotionSequence>()],
)
.prepared_by::<MotionSequence>();

/// The fault for a path with too many legs.
pub(super) fn too_many(motion: Clock, count: u32) -> PrepareFault {
    PrepareFault::Motion {
        motion: motion.0,
        leg: 0,
        fault: MotionFault::Legs { count },
    }
}

motion_operands! {
    MotionSequence { path: Slot<LegRow>, scale: Slot<Real>, time_optimal: Slot<Bool> }, count
}

impl Prepare for MotionSequence {
    fn prepare(self, preparation: &mut Preparation<'_>) -> Result<(), PrepareFault> {
        let scale = preparation.get(self.scale);
        let count = self.count;
        if count as usize > LEGS_MAX {
            return Err(too_many(self.motion, count));
        }
        let row = |number: u32| preparation.get(self.path + leg_row::WIDTH as u32 * number);
        let mut poses = [Pose::NULL; LEGS_MAX];
        for (pose, number) in poses.iter_mut().zip(0..count) {
            *pose = leg_row::pose(&row(number));
        }
        let nothing = Leg::new(PathSegment::Spline { through: &[] });
        let mut legs = [nothing; LEGS_MAX];
        let (mut used, mut first) = (0usize, 0usize);
        for (number, behind) in (0..count).zip(1usize..) {
            let through = poses.get(first..behind).unwrap_or(&[]);
            let row = row(number);
            if let (Some(leg), Some(place)) = (leg_row::leg(&row, through), legs.get_mut(used)) {
                *place = Leg {
                    scale: leg.scale * scale,
                    ..leg
                };
                used += 1;
                first = behind;
            } else if row.first() != Some(&leg_row::THROUGH) {
                first = behind;
            }
        }
        let request = PathRequest {
            device: self.device.0,
            from: None,
            legs: legs.get(..used).unwrap_or(&[]),
            pace: path_motion::pace(preparation, self.time_optimal),
        };
        preparation.motions.path(self.motion.0, &request)
    }
}
