//! `MotionSequence`: point-to-point motions, lines, arcs and splines in sequence, with optional blending and one path
//! clock.
//!
//! A leg without `blend:` ends at rest. With it, the path is left this distance before its end and joined at the same
//! distance after it, by a curve that is smooth to the second derivative. Blends from and to a `ptp` are computed in
//! joint space.
//!
//! A leg with `wait` does not begin before its condition is true. A leg with `until` ends when its condition is true: the
//! arm comes to rest on the path, and the next leg begins there.

use super::path_motion::{self, ports_of};
use crate::frame::{Frame, Preparation, PrepareFault};
use crate::path::leg_row::{self, LegRow};
use crate::path::{LEGS_MAX, Leg, LegSignals, MotionFault, MotionState, PathRequest, PathSegment};
use crate::pose::Pose;
use crate::primitive::{
    Bool, CatalogueEntry, DefaultValue, Device, Dim, ElementType, Int, Kernel, MotionIndex,
    NullRule, Parameter, ParameterKind, Port, PortType, Prepare, Real, Role, Slot, Spec, Step,
    UnitRule, operands,
};
use crate::types::{NULL_BOOL, Type};

/// `stop`, `pause`, `speed`, `conditions`.
const INPUTS: &[Port] = &{
    let [stop, pause, speed] = path_motion::INPUTS;
    [
        stop,
        pause,
        speed,
        Port::new(
            "conditions",
            PortType::Array(ElementType::Are(Type::Bool), Dim::Var(1)),
            UnitRule::Typed,
            "made from `wait` and `until` of the legs, in their order: give them there",
        )
        .default(DefaultValue::Null),
    ]
};

/// The outputs of every motion, then `waiting`, `unknown`, `until_met`.
const OUTPUTS: &[Port] = &{
    let [
        joints,
        pose,
        done,
        progress,
        distance,
        speed,
        acceleration,
        leg,
    ] = path_motion::OUTPUTS;
    [joints, pose, done, progress, distance, speed, acceleration, leg,
    Port::bool("waiting", "at rest: the next leg waits for its `wait`").diagnostic(),
    Port::bool(
        "unknown",
        "the condition that the next leg waits for, or that ends the current one, is null: it counts as not true",
    )
    .diagnostic(),
    Port::bool(
        "until_met",
        "the last leg with `until` that is over was ended by it; false before one is over",
    )
    .diagnostic(),
]
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "MotionSequence",
        summary: "Motions in sequence (ptp, lin, circ, spline) with optional blending, conditions between them, and a soft stop on the path.",
        null: "a null `stop` counts as true, because an unknown condition must stop the motion; a null `pause` or `speed` is a pause; a null `wait` or `until` is not true: the leg does not begin, or goes on to its end, and `unknown` is true",
        null_rule: NullRule::Known,
        formula: "blends: polynomials of degree 5 in the path parameter, C2 at both ends",
        inputs: INPUTS,
        outputs: OUTPUTS,
        parameters: &[
            Parameter::arm(),
            Parameter::new(
                "path",
                ParameterKind::Path(Dim::Var(0)),
                "legs in order, up to 128 including all points of splines: `- {ptp: {joints: [...]}}`, `- {ptp: {pose: {xyz: ..., rpy: ...}}}`, `- {lin: {xyz: ..., rpy: ...}, blend: 20 mm, velocity: 0.2 m/s}`, `- {circ: {via: {xyz: ...}, to: {...}}}`, `- {spline: [{...}, {...}]}`; a leg may have `wait: CONDITION` (it does not begin before) and `until: CONDITION` (it ends then)",
            ),
            path_motion::SCALE,
            path_motion::TIME_OPTIMAL,
            path_motion::STOPS,
        ],
        role: Role::Motion,
        ..Spec::PLAIN
    },
    &[Kernel::each::<MotionSequence>()],
)
.prepared_by::<MotionSequence>();

/// The fault for a path with too many legs.
pub(super) fn too_many(motion: MotionIndex, count: u32) -> PrepareFault {
    PrepareFault::Motion {
        motion: motion.0,
        leg: 0,
        fault: MotionFault::Legs { count },
    }
}

operands! {
    struct MotionSequence {
        stop: Slot<Bool>, pause: Slot<Bool>, speed: Slot<Real>, conditions: Slot<Bool>,
        joints: Slot<Real>, flange_pose: Slot<Pose>, done: Slot<Bool>, progress: Slot<Real>,
        distance: Slot<Real>, flange_speed: Slot<Real>, flange_acceleration: Slot<Real>, leg: Slot<Int>,
        waiting: Slot<Bool>, unknown: Slot<Bool>, until_met: Slot<Bool>,
        device: Device, path: Slot<LegRow>, scale: Slot<Real>, time_optimal: Slot<Bool>, stops: Slot<Int>,
        motion: MotionIndex, width: u32, count: u32, condition_count: u32,
    }
}

impl MotionSequence {
    /// Returns the value of a condition; null if the plan has no such condition.
    fn condition_value(self, frame: &Frame<'_>, index: Option<u32>) -> u8 {
        let index = index.filter(|index| *index < self.condition_count);
        let value = index.and_then(|index| frame.get(self.conditions + index));
        value.unwrap_or(NULL_BOOL)
    }
}

impl Step for MotionSequence {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let conditions = frame.motions.leg_conditions(self.motion.0 as usize);
        let wait = self.condition_value(frame, conditions.wait);
        let until = self.condition_value(frame, conditions.until);
        let signals = LegSignals {
            begin: conditions.wait.is_none() || wait == 1,
            end: until == 1,
        };
        let state = ports_of!(self).step_leg(frame, self.motion, signals)?;
        let due = |index: Option<u32>, value: u8| index.is_some() && value == NULL_BOOL;
        let unknown = match signals.begin {
            true => due(conditions.until, until),
            false => due(conditions.wait, wait),
        };
        let flag = |of: fn(&MotionState) -> bool| {
            state
                .as_ref()
                .map_or(NULL_BOOL, |state| u8::from(of(state)))
        };
        frame.put(self.waiting, flag(|state| state.waiting))?;
        frame.put(self.unknown, u8::from(unknown))?;
        frame.put(self.until_met, flag(|state| state.until_met))
    }
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
            pace: path_motion::pace(preparation, self.time_optimal, self.stops),
        };
        preparation.motions.path(self.motion.0, &request)
    }
}
