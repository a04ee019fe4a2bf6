//! `ForceControl`: controls the force along one axis while a path continues along the others, by admittance control.
//!
//! The pose of the path is offset along the axis with a velocity proportional to the force error. That velocity is
//! followed within acceleration and jerk limits, in closed form, and never such that the stopping distance would end
//! beyond `travel`: if contact is lost, the tool does not keep searching.

use crate::frame::Frame;
use crate::pose::Pose;
use crate::primitive::{
    Bool, CatalogueEntry, DefaultValue, Example, Kernel, NullRule, Parameter, ParameterKind, Port,
    PortType, Real, Slot, Spatial, Spec, StateSpec, Step, UnitRule, Vector3, operands, within,
};
use crate::types::{NULL_REAL, Type};
use crate::unit::Unit;
use crate::{rotation, spatial, vector};

const FORCE: UnitRule = UnitRule::Is(Unit::NEWTON);
const METRE: UnitRule = UnitRule::Is(Unit::METRE);
const VELOCITY: UnitRule = UnitRule::Is(Unit::METRE_PER_SECOND);
const ACCELERATION: UnitRule = UnitRule::Is(Unit::METRE_PER_SECOND2);
const JERK: UnitRule = UnitRule::Is(Unit::METRE_PER_SECOND3);
const GAIN: UnitRule = UnitRule::Is(Unit::METRE_PER_SECOND.per(Unit::NEWTON));

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "ForceControl",
        summary: "Applies a force along one axis while a path continues along the others: offsets the path's pose along the axis, within limits of speed, acceleration, jerk and travel.",
        null: "a null `force` or `wrench`, and an `active` that is not true, bring the offset to rest within its limits; a null `pose` gives a null `pose`",
        null_rule: NullRule::Propagates,
        undefined: "a zero axis; a pose with a rotation that cannot be normalized; overflow",
        formula: "v -> gain (force - pressed), pressed = -wrench · axis, |v| <= velocity; admittance without mass: \
                  Siciliano and Villani, Robot Force Control, 1999, section 3.3; selection of axes: Raibert and Craig, \
                  1981. v is followed with |a| <= acceleration and |da/dt| <= jerk by the filter of OnlineTrajectory",
        examples: &[
            Example::new(
                "no contact: the offset grows with gain · force, as soon as the limits allow",
                "{axis: [0, 0, -1], gain: 0.1, velocity: 2, acceleration: 1, jerk: 1, travel: 100}",
                "pose | force | wrench | pose_out | offset | velocity | limited
                 {xyz: [1, 0, 5], rpy: [0, 0, 0]} | 10 | [0, 0, 0, 0, 0, 0] | {xyz: [1, 0, 4.833333333333333], rpy: [0, 0, 0]} | 0.16666666666666666 | 0.5 | false
                 {xyz: [1, 1, 5], rpy: [0, 0, 0]} | 10 | [0, 0, 0, 0, 0, 0] | {xyz: [1, 1, 4], rpy: [0, 0, 0]} | 1 | 1 | false
                 {xyz: [1, 2, 5], rpy: [0, 0, 0]} | 10 | [0, 0, 10, 0, 0, 0] | {xyz: [1, 2, 3.1666666666666665], rpy: [0, 0, 0]} | 1.8333333333333333 | 0.5 | false
                 {xyz: [1, 3, 5], rpy: [0, 0, 0]} | 10 | [0, 0, 10, 0, 0, 0] | {xyz: [1, 3, 3], rpy: [0, 0, 0]} | 2 | 0 | false
                 {xyz: [1, 4, 5], rpy: [0, 0, 0]} | 10 | null | {xyz: [1, 4, 3], rpy: [0, 0, 0]} | 2 | 0 | false
                 null | 10 | null | null | 2 | 0 | false",
            )
            .every_ms(1000),
        ],
        inputs: &[
            Port::typed("pose", Type::Pose, "pose of the path, in the base"),
            Port::real("force", FORCE, "force to apply, along the axis"),
            Port::typed(
                "wrench",
                Type::Wrench,
                "external wrench on the tool, in axes of the frame of `axis`",
            ),
            Port::bool("active", "while not true, the offset comes to rest and stays")
                .default(DefaultValue::Bool(true)),
        ],
        outputs: &[
            Port::typed("pose_out", Type::Pose, "the path's pose, offset along the axis by `offset`"),
            Port::real("offset", METRE, "offset along the axis").diagnostic(),
            Port::real("velocity", VELOCITY, "velocity of the offset").diagnostic(),
            Port::real("acceleration", ACCELERATION, "acceleration of the offset").diagnostic(),
            Port::real("missing", FORCE, "force error: `force` minus the applied force").diagnostic(),
            Port::bool("limited", "held at `travel`, or stopping there, until the force leads back").diagnostic(),
            Port::bool("resting", "the offset is at rest").diagnostic(),
        ],
        parameters: &[
            Parameter::new(
                "axis",
                ParameterKind::Value(PortType::Is(Type::Vector3), UnitRule::ONE),
                "direction in which the tool presses, any length except 0",
            ),
            Parameter::bool("in_tool", "the axis is given in axes of `pose` and rotates with it; otherwise in axes of the base")
                .default(DefaultValue::Bool(false)),
            Parameter::real("gain", GAIN, "speed per newton of force error; choose less than 1 / (contact stiffness · delay)")
                .above(0.0),
            Parameter::real("velocity", VELOCITY, "largest speed along the axis").above(0.0),
            Parameter::real("acceleration", ACCELERATION, "largest acceleration along the axis").above(0.0),
            Parameter::real("jerk", JERK, "largest jerk along the axis").above(0.0),
            Parameter::real("travel", METRE, "largest offset from the path, in both directions").above(0.0),
        ],
        // offset, velocity, acceleration; 1 = held by `travel` above, -1 below
        state: StateSpec {
            reals: 4,
            ..StateSpec::NONE
        },
        ..Spec::PLAIN
    },
    &[Kernel::each::<ForceControl>()],
);

/// Limits of the offset along the axis.
#[derive(Clone, Copy, Debug)]
struct OffsetLimits {
    velocity: f64,
    acceleration: f64,
    jerk: f64,
    travel: f64,
}

/// The state of the offset along the axis.
#[derive(Clone, Copy, PartialEq, Debug)]
struct OffsetState {
    s: f64,
    v: f64,
    a: f64,
    /// Held by `travel`: 1 above, -1 below, 0 not held.
    held: f64,
}

operands! {
    struct ForceControl {
        pose: Slot<Pose>, force: Slot<Real>, wrench: Slot<Spatial>, active: Slot<Bool>,
        pose_out: Slot<Pose>, offset: Slot<Real>, offset_velocity: Slot<Real>, offset_acceleration: Slot<Real>,
        missing: Slot<Real>, limited: Slot<Bool>, resting: Slot<Bool>,
        axis: Slot<Vector3>, in_tool: Slot<Bool>, gain: Slot<Real>,
        velocity: Slot<Real>, acceleration: Slot<Real>, jerk: Slot<Real>, travel: Slot<Real>,
        state: Slot<[Real; 4]>,
    }
}

impl Step for ForceControl {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let limits = OffsetLimits {
            velocity: frame.get(self.velocity)?,
            acceleration: frame.get(self.acceleration)?,
            jerk: frame.get(self.jerk)?,
            travel: frame.get(self.travel)?,
        };
        let axis = frame.composite(self.axis).and_then(vector::normalized);
        let pushed = frame.composite(self.wrench).map(spatial::split);
        let pressed = pushed
            .zip(axis)
            .map(|((pushed, _), axis)| -vector::dot(pushed, axis));
        let wanted = frame.get(self.force)? - pressed.unwrap_or(NULL_REAL);
        let acts = (frame.get(self.active)? == 1) & wanted.is_finite();
        let goal = if acts {
            frame.get(self.gain)? * wanted
        } else {
            0.0
        };
        let before = match frame.get(self.state)? {
            [s, v, a, held] if s.is_finite() => OffsetState { s, v, a, held },
            _ => OffsetState {
                s: 0.0,
                v: 0.0,
                a: 0.0,
                held: 0.0,
            },
        };
        let goal = within(goal, -limits.velocity, limits.velocity);
        let next = follow(before, goal, &limits, frame.dt_s);
        frame.put(self.state, [next.s, next.v, next.a, next.held])?;
        frame.put(self.offset, next.s)?;
        frame.put(self.offset_velocity, next.v)?;
        frame.put(self.offset_acceleration, next.a)?;
        let missing = if wanted.is_finite() {
            wanted
        } else {
            NULL_REAL
        };
        frame.put(self.missing, missing)?;
        frame.put(self.limited, u8::from(next.held != 0.0))?;
        frame.put(self.resting, u8::from((next.v == 0.0) & (next.a == 0.0)))?;
        let in_tool = frame.get(self.in_tool)? == 1;
        let moved = frame
            .known_pose(self.pose)
            .zip(axis)
            .map(|(mut pose, axis)| {
                let axis = if in_tool {
                    rotation::rotate(pose.orientation, axis)
                } else {
                    axis
                };
                pose.position = vector::add(pose.position, vector::scale(axis, next.s));
                pose
            });
        frame.put_pose(self.pose_out, moved)
    }
}

/// Advances one period towards the velocity `goal`, or to rest if that velocity would lead beyond `travel`.
fn follow(before: OffsetState, goal: f64, limits: &OffsetLimits, dt_s: f64) -> OffsetState {
    // While held, it comes to rest until the goal leads away from the bound.
    let held = if before.held * goal >= 0.0 {
        before.held
    } else {
        0.0
    };
    let next = step_velocity(before, if held == 0.0 { goal } else { 0.0 }, limits, dt_s);
    let margin = MARGIN_CYCLES * dt_s;
    let [low, high] = stop_range(&next, limits, margin);
    let beyond = if high > limits.travel {
        1.0
    } else if low < -limits.travel {
        -1.0
    } else {
        0.0
    };
    if (held != 0.0) | (beyond * goal <= 0.0) {
        return OffsetState { held, ..next };
    }
    OffsetState {
        held: beyond,
        ..step_velocity(before, 0.0, limits, dt_s)
    }
}

/// In whole periods the stopping distance exceeds that in continuous time by less than this many cycles at the current
/// speed.
const MARGIN_CYCLES: f64 = 3.0;

/// Advances one period with the velocity approaching `goal` as fast as acceleration and jerk allow, without overshoot.
fn step_velocity(before: OffsetState, goal: f64, limits: &OffsetLimits, dt_s: f64) -> OffsetState {
    let OffsetState { s, v, a, .. } = before;
    let change = limits.jerk * dt_s;
    let wanted = braking_rate(goal - v, a, limits.jerk, dt_s);
    let wanted = within(wanted, -limits.acceleration, limits.acceleration);
    let next = within(wanted, a - change, a + change);
    let speed = v + (a + next) / 2.0 * dt_s;
    // Removes the rounding residue of a velocity that has been reached.
    let arrived = (next.abs() <= 1e-9 * change) & ((speed - goal).abs() <= 1e-9 * change * dt_s);
    OffsetState {
        s: s + (v + (2.0 * a + next) / 6.0 * dt_s) * dt_s,
        v: if arrived { goal } else { speed },
        a: if arrived { 0.0 } else { next },
        held: 0.0,
    }
}

/// Returns the rate after one more period from which braking with `most` ends exactly at zero, see `OnlineTrajectory`.
fn braking_rate(left: f64, rate: f64, most: f64, dt_s: f64) -> f64 {
    let unit = most * dt_s;
    let z = (left / dt_s - rate / 2.0) / unit;
    let size = z.abs();
    let cycles = libm::floor((1.0 + libm::sqrt(1.0 + 8.0 * size)) / 2.0);
    let value = unit * (size / cycles + (cycles - 1.0) / 2.0);
    if z < 0.0 { -value } else { value }
}

/// Returns the lowest and highest position on the fastest stop from here, with `margin_s` times the speed added.
fn stop_range(from: &OffsetState, limits: &OffsetLimits, margin_s: f64) -> [f64; 2] {
    let OffsetState { s, v, a, .. } = *from;
    let (jerk, most) = (limits.jerk, limits.acceleration);
    // The velocity after the acceleration is reduced at once: if it still has the same direction, it must be braked.
    let after = v + a * a.abs() / (2.0 * jerk);
    let sign = if after < 0.0 { -1.0 } else { 1.0 };
    let end = s + sign * stop_distance(sign * v, sign * a, jerk, most);
    // An acceleration against the velocity may reverse it: until then the distance is shorter than without the
    // acceleration.
    let turn = s + stop_distance(v.abs(), 0.0, jerk, most) * if v < 0.0 { -1.0 } else { 1.0 };
    let turns = v * after < 0.0;
    let turn = if turns { turn } else { end };
    let margin = margin_s * (v.abs() + a.abs() * margin_s);
    [s.min(end).min(turn) - margin, s.max(end).max(turn) + margin]
}

/// Returns the stopping distance with jerk and acceleration at their limits, for a velocity and acceleration that do
/// not reverse: v + a |a| / 2 jerk is not negative.
fn stop_distance(v: f64, a: f64, jerk: f64, most: f64) -> f64 {
    let peak = libm::sqrt((jerk * v + a * a / 2.0).max(0.0)).min(most);
    let first = (a + peak) / jerk;
    let held = ((v + (a * a / 2.0 - peak * peak) / jerk) / peak).max(0.0);
    let held = if peak > 0.0 { held } else { 0.0 };
    let last = peak / jerk;
    // The velocities between the three phases follow from the end, where the velocity is 0.
    let slow = peak * peak / (2.0 * jerk);
    let quick = slow + peak * held;
    let way_first = v * first + a * first * first / 2.0 - jerk * first * first * first / 6.0;
    let way_last = slow * last - peak * last * last / 2.0 + jerk * last * last * last / 6.0;
    way_first + (quick + slow) / 2.0 * held + way_last
}

#[cfg(test)]
mod tests;
