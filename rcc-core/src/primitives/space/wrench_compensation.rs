//! `WrenchCompensation`: removes the weight of the tool and the sensor's offset from the reading of a wrist sensor.
//!
//! The ten numbers (mass, centre, offsets) are identified by `rcc-cli wrench identify` from readings in several orientations.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, DefaultValue, Example, Kernel, Parameter, ParameterKind, Port, PortType, Real,
    Rotation, Slot, Spatial, Spec, Step, UnitRule, Vector3, operands,
};
use crate::types::Type;
use crate::unit::Unit;
use crate::vector::{self, Vector};
use crate::{rotation, spatial};

/// Standard gravity (ISO 80000-3), m/s², along z of the base.
const GRAVITY: Vector = [0.0, 0.0, -9.806_65];

const KILOGRAM: UnitRule = UnitRule::Is(Unit::NEWTON.per(Unit::METRE_PER_SECOND2));
const ACCELERATION: UnitRule = UnitRule::Is(Unit::METRE_PER_SECOND2);

const fn vector(unit: Unit) -> ParameterKind {
    ParameterKind::Value(PortType::Is(Type::Vector3), UnitRule::Is(unit))
}

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "WrenchCompensation",
        summary: "The external wrench on a tool from the reading of a wrist sensor: without the tool's weight, its inertial force under linear acceleration, and the sensor's offset.",
        undefined: "overflow: an infinite input, a quaternion that cannot be normalized, a result out of range",
        formula: "f = f_read - f0 - m (g - a), t = t_read - t0 - c × m (g - a), with g and a rotated into the sensor's axes; angular acceleration is neglected (Siciliano et al., Robotics, 2009, section 9.3; Kubus, Kröger, Wahl, IROS 2008)",
        examples: &[
            Example::new(
                "a tool of 1 kg, 0.1 m in front of the sensor: hanging down, horizontal, and in free fall",
                "{mass: 1 kg, centre: [0, 0, 0.1], gravity: [0, 0, -10]}",
                "wrench | rotation | acceleration | out
                 [0, 0, 10, 0, 0, 0] | {rpy: [deg(180), 0, 0]} | [0, 0, 0] | [0, 0, 0, 0, 0, 0]
                 [10, 0, 0, 0, 1, 0] | {rpy: [0, deg(90), 0]} | [0, 0, 0] | [0, 0, 0, 0, 0, 0]
                 [10, 0, 5, 0, 1, 0.5] | {rpy: [0, deg(90), 0]} | [0, 0, 0] | [0, 0, 5, 0, 0, 0.5]
                 [0, 0, 0, 0, 0, 0] | {rpy: [0, deg(90), 0]} | [0, 0, -10] | [0, 0, 0, 0, 0, 0]
                 null | {rpy: [0, 0, 0]} | [0, 0, 0] | null
                 [0, 0, 0, 0, 0, 0] | null | [0, 0, 0] | null
                 [0, 0, 0, 0, 0, 0] | {rpy: [0, 0, 0]} | null | null",
            ),
            Example::new(
                "all ten parameters, without and with acceleration (rotation matrices in Python)",
                "{mass: 1.2 kg, centre: [0.01, -0.02, 0.08], force_offset: [1.5, -2.5, 3.0], torque_offset: [0.1, -0.05, 0.02]}",
                "wrench | rotation | acceleration | out
                 [10, -5, 2, 0.3, 0.1, -0.2] | {rpy: [0.3, -0.5, 1.2]} | [0, 0, 0] | [14.14187014978349, 0.5519477095870506, 8.866117254083715, -0.24147816184863838, 0.5026884394418419, -0.07664311990845973]
                 [10, -5, 2, 0.3, 0.1, -0.2] | {rpy: [0.3, -0.5, 1.2]} | [1.5, -2.0, 0.5] | [13.038864399407887, -1.501489486609508, 10.847726195301627, -0.11683536497727195, 0.3946318899996147, -0.11923760687793734]",
            ),
        ],
        inputs: &[
            Port::typed("wrench", Type::Wrench, "reading of the sensor: wrench that the tool's side exerts on it"),
            Port::typed("rotation", Type::Rotation, "orientation of the sensor in the base"),
            Port::new(
                "acceleration",
                PortType::Is(Type::Vector3),
                ACCELERATION,
                "acceleration of the tool's centre of mass, axes of the base; if omitted, none",
            )
            .default(DefaultValue::Real(0.0)),
        ],
        outputs: &[Port::typed(
            "out",
            Type::Wrench,
            "external wrench on the tool, axes and reference point of the sensor",
        )],
        parameters: &[
            Parameter::real("mass", KILOGRAM, "mass of everything mounted on the sensor").at_least(0.0),
            Parameter::new(
                "centre",
                vector(Unit::METRE),
                "its centre of mass, axes and origin of the sensor",
            ),
            Parameter::new("force_offset", vector(Unit::NEWTON), "force reading without load, axes of the sensor")
                .default(DefaultValue::Real(0.0)),
            Parameter::new("torque_offset", vector(Unit::NEWTON_METRE), "torque reading without load, axes of the sensor")
                .default(DefaultValue::Real(0.0)),
            Parameter::new(
                "gravity",
                vector(Unit::METRE_PER_SECOND2),
                "acceleration of gravity, axes of the base; if omitted, 9.80665 m/s² against z, for an upright base",
            )
            .default(DefaultValue::Null),
        ],
        ..Spec::PLAIN
    },
    &[Kernel::each::<WrenchCompensation>()],
);

operands! {
    struct WrenchCompensation {
        wrench: Slot<Spatial>, rotation: Slot<Rotation>, acceleration: Slot<Vector3>, out: Slot<Spatial>,
        mass: Slot<Real>, centre: Slot<Vector3>, force_offset: Slot<Vector3>, torque_offset: Slot<Vector3>,
        gravity: Slot<Vector3>,
    }
}

impl Step for WrenchCompensation {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let external = || {
            let (force, torque) = spatial::split(frame.composite(self.wrench)?);
            let axes = frame.rotation(self.rotation)?;
            let gravity = frame.composite(self.gravity).unwrap_or(GRAVITY);
            let fall = vector::subtract(gravity, frame.composite(self.acceleration)?);
            let fall = rotation::rotate(rotation::inverse(axes), fall);
            let weight = vector::scale(fall, frame.get(self.mass)?);
            let lever = vector::cross(frame.composite(self.centre)?, weight);
            let force = vector::subtract(
                vector::subtract(force, frame.composite(self.force_offset)?),
                weight,
            );
            let torque = vector::subtract(
                vector::subtract(torque, frame.composite(self.torque_offset)?),
                lever,
            );
            Some(spatial::join(force, torque))
        };
        let external = external();
        frame.put_composite(self.out, external)
    }
}
