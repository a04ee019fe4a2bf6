//! `PathCorrection`: sensor-based correction of a path: a bounded, jerk-limited offset that is added to a pose.
//!
//! The offset follows the requested correction as a goal that may change in any cycle; the path itself continues
//! unchanged. A seam tracker or a conveyor can thus move the frame that a motion is relative to, and the limits of the
//! tool are the sums of both limits.

use super::pose_goal::{SIX, limits, step_six};
use crate::axis::{AXIS_WORDS, AxisFollower, AxisSlot, axes, rest_at, share_of};
use crate::frame::{Frame, Preparation, PrepareFault};
use crate::pose::Pose;
use crate::primitive::{
    Bool, CatalogueEntry, DefaultValue, Example, Kernel, NullRule, Parameter, ParameterKind, Port,
    PortType, Prepare, Real, Slot, Spec, StateSpec, Step, UnitRule, Vector3, operands,
};
use crate::rotation::{exp, product, rotate};
use crate::types::{NULL_BOOL, Type};
use crate::unit::Unit;
use crate::vector::add;

/// An optional positive number with a unit.
const fn angular(name: &'static str, unit: Unit, value: f64, doc: &'static str) -> Parameter {
    Parameter::real(name, UnitRule::Is(unit), doc)
        .default(DefaultValue::Real(value))
        .above(0.0)
}

const fn vector(name: &'static str, unit: Unit, doc: &'static str) -> Port {
    Port::new(name, PortType::Is(Type::Vector3), UnitRule::Is(unit), doc)
}

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "PathCorrection",
        summary: "Adds a sensor's correction to the pose of a path, bounded and within limits of velocity, acceleration and jerk.",
        null: "a null pose gives null; while `pose` or `correction` is null the offset comes to rest and stays, and so does the rotation while `rotation` is null; a null `stop` counts as true, a null `speed` as 0",
        null_rule: NullRule::FirstAndAnyKnown,
        undefined: "overflow: an infinite pose",
        formula: "in_path: p + R·offset, R·exp(turn); otherwise p + offset, exp(turn)·R; each element of both follows its request as ScalarGoal, after the request has been limited to ± its bound",
        examples: &[
            Example::new(
                "a lateral offset of 12 mm in the path's axes, which are rotated by 90° about z; limited by jerk only: four phases of a second",
                "{max: 1, velocity: 1, acceleration: 1, jerk: 0.006}",
                "pose | correction | pose_out | offset | limited
                 {xyz: [1, 0, 0], rpy: [0, 0, deg(90)]} | [0.012, 0, 0] | {xyz: [1, 0.001, 0], rpy: [0, 0, deg(90)]} | [0.001, 0, 0] | false
                 {xyz: [2, 0, 0], rpy: [0, 0, deg(90)]} | [0.012, 0, 0] | {xyz: [2, 0.006, 0], rpy: [0, 0, deg(90)]} | [0.006, 0, 0] | false
                 {xyz: [3, 0, 0], rpy: [0, 0, deg(90)]} | [0.012, 0, 0] | {xyz: [3, 0.011, 0], rpy: [0, 0, deg(90)]} | [0.011, 0, 0] | false
                 {xyz: [4, 0, 0], rpy: [0, 0, deg(90)]} | [0.012, 0, 0] | {xyz: [4, 0.012, 0], rpy: [0, 0, deg(90)]} | [0.012, 0, 0] | false",
            )
            .every_ms(1000),
            Example::new(
                "a request beyond the bound is limited and reported; without a correction the offset stays",
                "{max: 0.012, velocity: 1, acceleration: 1, jerk: 0.006, in_path: false}",
                "pose | correction | pose_out | limited
                 {xyz: [1, 0, 0], rpy: [0, 0, 1]} | [0.5, 0, 0] | {xyz: [1.001, 0, 0], rpy: [0, 0, 1]} | true
                 {xyz: [1, 0, 0], rpy: [0, 0, 1]} | [0.5, 0, 0] | {xyz: [1.006, 0, 0], rpy: [0, 0, 1]} | true
                 {xyz: [1, 0, 0], rpy: [0, 0, 1]} | [0.5, 0, 0] | {xyz: [1.011, 0, 0], rpy: [0, 0, 1]} | true
                 {xyz: [1, 0, 0], rpy: [0, 0, 1]} | [0.5, 0, 0] | {xyz: [1.012, 0, 0], rpy: [0, 0, 1]} | true
                 {xyz: [1, 0, 0], rpy: [0, 0, 1]} | null | {xyz: [1.012, 0, 0], rpy: [0, 0, 1]} | false
                 null | [0, 0, 0] | null | false",
            )
            .every_ms(1000),
        ],
        inputs: &[
            Port::typed("pose", Type::Pose, "pose of the path, in any frame"),
            vector("correction", Unit::METRE, "requested offset"),
            vector(
                "rotation",
                Unit::RADIAN,
                "requested rotation: a rotation vector",
            )
            .default(DefaultValue::Null),
            Port::real(
                "speed",
                UnitRule::ONE,
                "fraction of the velocity limits to use; computed values above 1 count as 1, values below 0.0001 as 0 (a stop)",
            )
            .default(DefaultValue::Real(1.0)).within(0.0, 1.0),
            Port::bool("stop", "while true, the offset comes to rest and stays")
                .default(DefaultValue::Bool(false)),
        ],
        outputs: &[
            Port::typed("pose_out", Type::Pose, "the corrected pose, in the frame of `pose`"),
            vector("offset", Unit::METRE, "current offset").diagnostic(),
            vector("turn", Unit::RADIAN, "current rotation: a rotation vector").diagnostic(),
            Port::bool("limited", "the request is beyond a bound"),
            Port::bool("settled", "offset and rotation are at rest at the request, or at its bound")
                .diagnostic(),
        ],
        parameters: &[
            Parameter::real(
                "max",
                UnitRule::Is(Unit::METRE),
                "bound of each element of the offset",
            )
            .at_least(0.0),
            Parameter::real(
                "velocity",
                UnitRule::Is(Unit::METRE_PER_SECOND),
                "largest speed of each element of the offset",
            )
            .above(0.0),
            Parameter::real(
                "acceleration",
                UnitRule::Is(Unit::METRE_PER_SECOND2),
                "largest acceleration of each element of the offset",
            )
            .above(0.0),
            Parameter::real(
                "jerk",
                UnitRule::Is(Unit::METRE_PER_SECOND3),
                "largest jerk of each element of the offset",
            )
            .above(0.0),
            Parameter::real(
                "max_rotation",
                UnitRule::RADIAN,
                "bound of each element of the rotation",
            )
            .default(DefaultValue::Real(0.0))
            .at_least(0.0)
            .at_most(1.0),
            angular(
                "angular_velocity",
                Unit::RADIAN_PER_SECOND,
                1.0,
                "largest rate of each element of the rotation",
            ),
            angular(
                "angular_acceleration",
                Unit::RADIAN_PER_SECOND2,
                4.0,
                "largest second derivative of each element of the rotation",
            ),
            angular(
                "angular_jerk",
                Unit::RADIAN_PER_SECOND3,
                40.0,
                "largest third derivative of each element of the rotation",
            ),
            Parameter::new(
                "in_path",
                ParameterKind::Value(PortType::Is(Type::Bool), UnitRule::Typed),
                "true: corrections are in axes of the path's pose (its tool); false: in axes of the frame in which `pose` is given",
            )
            .default(DefaultValue::Bool(true)),
        ],
        state: StateSpec {
            reals: (6 * AXIS_WORDS) as u32,
            ..StateSpec::NONE
        },
        ..Spec::PLAIN
    },
    &[Kernel::each::<PathCorrection>()],
)
.prepared_by::<PathCorrection>();

operands! {
    struct PathCorrection {
        pose: Slot<Pose>, correction: Slot<Vector3>, rotation: Slot<Vector3>, speed: Slot<Real>, stop: Slot<Bool>,
        pose_out: Slot<Pose>, offset: Slot<Vector3>, turn: Slot<Vector3>, limited: Slot<Bool>, settled: Slot<Bool>,
        max: Slot<Real>, velocity: Slot<Real>, acceleration: Slot<Real>, jerk: Slot<Real>,
        max_rotation: Slot<Real>, angular_velocity: Slot<Real>, angular_acceleration: Slot<Real>,
        angular_jerk: Slot<Real>, in_path: Slot<Bool>, state: AxisSlot,
    }
}

impl Prepare for PathCorrection {
    fn prepare(self, preparation: &mut Preparation<'_>) -> Result<(), PrepareFault> {
        for slot in axes(self.state, SIX) {
            preparation.put(slot, rest_at(0.0));
        }
        Ok(())
    }
}

/// Limits a request to ± the bound; returns the result and whether it was limited.
fn bounded(request: [f64; 3], bound: f64) -> ([f64; 3], bool) {
    let cut = request.map(|element| {
        if element > bound {
            bound
        } else if element < -bound {
            -bound
        } else {
            element
        }
    });
    (cut, cut != request)
}

impl Step for PathCorrection {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let path = frame.known_pose(self.pose);
        let in_path = frame.get(self.in_path)? == 1;
        let share = share_of(frame, self.speed, self.stop)?;
        let request = |slot: Slot<Vector3>, most: f64| {
            let request = path.and(frame.composite(slot));
            request.map(|request| bounded(request, most))
        };
        let shift = request(self.correction, frame.get(self.max)?);
        let turn = request(self.rotation, frame.get(self.max_rotation)?);
        let beyond = [shift, turn]
            .into_iter()
            .flatten()
            .any(|(_, beyond)| beyond);
        let goal =
            |request: Option<([f64; 3], bool)>| request.map_or([f64::NAN; 3], |(goal, _)| goal);
        let ([x, y, z], [rx, ry, rz]) = (goal(shift), goal(turn));
        let line = limits(frame, [self.velocity, self.acceleration, self.jerk], share)?;
        let angular = [
            self.angular_velocity,
            self.angular_acceleration,
            self.angular_jerk,
        ];
        let angular = limits(frame, angular, share)?;
        let goal = Some([x, y, z, rx, ry, rz]);
        let axes = step_six(
            frame,
            self.state,
            goal,
            [&line, &line, &line, &angular, &angular, &angular],
        );
        let now = axes.map(|axes| {
            let [x, y, z, rx, ry, rz] = axes.map(|axis| axis.state().position);
            ([x, y, z], [rx, ry, rz])
        });
        let corrected = path.zip(now).map(|(path, (offset, turn))| {
            let (at, turned) = (path.orientation, exp(turn));
            let (shift, orientation) = if in_path {
                (rotate(at, offset), product(at, turned))
            } else {
                (offset, product(turned, at))
            };
            Pose {
                position: add(path.position, shift),
                orientation,
            }
        });
        frame.put_pose(self.pose_out, corrected)?;
        frame.put_composite(self.offset, now.map(|(offset, _)| offset))?;
        frame.put_composite(self.turn, now.map(|(_, turn)| turn))?;
        frame.put(self.limited, u8::from(beyond))?;
        let rests = axes.map(|axes| {
            let [x, y, z, turns @ ..] = &axes;
            let shifted = shift.is_some() && [x, y, z].into_iter().all(AxisFollower::arrived);
            let turned = turns.iter().all(|axis| {
                if turn.is_some() {
                    axis.arrived()
                } else {
                    axis.state().rests()
                }
            });
            u8::from(shifted && turned)
        });
        frame.put(self.settled, rests.unwrap_or(NULL_BOOL))
    }
}

#[cfg(test)]
mod tests {
    use rcc_testing::{Random, Rng};

    use crate::pose::Pose;
    use crate::testing::PrimitiveHarness;

    fn bench(most: f64) -> PrimitiveHarness {
        let mut bench = PrimitiveHarness::new("PathCorrection");
        let values = [
            ("speed", 1.0),
            ("max", most),
            ("velocity", 0.05),
            ("acceleration", 0.5),
            ("jerk", 10.0),
            ("max_rotation", 0.1),
            ("angular_velocity", 0.5),
            ("angular_acceleration", 4.0),
            ("angular_jerk", 40.0),
        ];
        for (name, value) in values {
            bench.set_real(name, value);
        }
        bench
            .set_bool("stop", Some(false))
            .set_bool("in_path", Some(true))
            .set_reals(
                "pose",
                &Pose::from_xyz_rpy([0.4, 0.1, 0.5], [3.0, 0.2, 0.1]).to_slots(),
            )
            .set_reals("correction", &[0.0; 3])
            .set_reals("rotation", &[f64::NAN; 3]);
        bench.prepare().unwrap();
        bench
    }

    #[test]
    fn the_offset_keeps_its_bound_and_its_velocity_for_any_request() {
        let (mut bench, mut random, mut last) = (bench(0.02), Rng::with_seed(3), [0.0; 3]);
        for cycle in 0..20_000 {
            if cycle % 37 == 0 {
                let mut wish = [0.0; 3];
                for element in &mut wish {
                    *element = random.uniform(-0.05, 0.05);
                }
                bench.set_reals("correction", &wish);
                let beyond = wish.iter().any(|element| element.abs() > 0.02);
                assert_eq!(bench.step().bool("limited"), Some(beyond));
            } else {
                bench.step();
            }
            for (last, now) in last.iter_mut().zip(bench.reals("offset", 3)) {
                assert!(now.abs() <= 0.02 + 1e-12, "{now}");
                assert!((now - *last).abs() <= 0.05e-3 * (1.0 + 1e-9));
                *last = *now;
            }
        }
    }

    #[test]
    fn after_loss_of_the_sensor_the_offset_comes_to_rest_and_stays() {
        let mut bench = bench(0.02);
        bench.set_reals("correction", &[0.01, 0.0, 0.0]);
        (0..100).for_each(|_| _ = bench.step());
        bench.set_reals("correction", &[f64::NAN; 3]);
        (0..1000).for_each(|_| _ = bench.step());
        let resting = bench.real("offset");
        assert!(resting > 0.0 && resting < 0.01);
        assert_eq!(bench.step().real("offset"), resting);
        assert_eq!(bench.bool("settled"), Some(false));
        bench.set_reals("correction", &[0.01, 0.0, 0.0]);
        (0..2000).for_each(|_| _ = bench.step());
        assert_eq!(
            (bench.real("offset"), bench.bool("settled")),
            (0.01, Some(true))
        );
    }

    #[test]
    fn a_rotation_is_added_in_the_axes_of_the_path() {
        let mut bench = bench(0.02);
        bench.set_reals("rotation", &[0.0, 0.0, 0.05]);
        (0..3000).for_each(|_| _ = bench.step());
        let path = Pose::from_xyz_rpy([0.4, 0.1, 0.5], [3.0, 0.2, 0.1]);
        let turned = path.compose(&Pose::from_xyz_rpy([0.0; 3], [0.0, 0.0, 0.05]));
        let got = Pose::from_slots(bench.reals("pose_out", 7).try_into().unwrap());
        assert!(got.angle_to(&turned) < 1e-7 && got.distance_to(&turned) < 1e-12);
    }
}
