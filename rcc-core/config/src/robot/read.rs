//! Reads the file of a robot. Run at start-up by programs that read the cell's file.

use rcc_core::counted::Counted;
use rcc_core::impedance::ImpedanceLimits;
use rcc_core::kinematics::{AXES_MAX, Arm, JointAxis, OrthoParallelArm, SerialArm, SrsArm};
use rcc_core::unit::Unit;

use super::{JointConfig, RobotConfig, dynamics};
use crate::base;
use crate::codes;
use crate::diagnostic::Span;
use crate::file_kind::FileKind;
use crate::reader::{ConfigReader, Fields, JOINT_NAME, QuantityRange, error};
use crate::yaml::{Entry, Node, Value};

const KEYS: [&str; 5] = ["robot", "kinematics", "joints", "impedance", "dynamics"];
/// Keys of all types of kinematics; the keys of each type follow below.
const KINEMATICS_KEYS: [&str; 13] = [
    "type",
    "shoulder_height",
    "shoulder_offset",
    "lateral_offset",
    "upper_arm",
    "elbow_offset",
    "forearm",
    "wrist_to_flange",
    "signs",
    "zeros",
    "axes",
    "flange",
    "redundant_joint",
];
const SERIAL_KEYS: [&str; 4] = ["type", "axes", "flange", "redundant_joint"];
const LINEAR_KEYS: [&str; 3] = ["type", "axes", "flange"];
const AXIS_KEYS: [&str; 2] = ["point", "direction"];
const ORTHO_PARALLEL_KEYS: [&str; 10] = [
    "type",
    "shoulder_height",
    "shoulder_offset",
    "lateral_offset",
    "upper_arm",
    "elbow_offset",
    "forearm",
    "wrist_to_flange",
    "signs",
    "zeros",
];
const SRS_KEYS: [&str; 6] = [
    "type",
    "shoulder_height",
    "upper_arm",
    "forearm",
    "wrist_to_flange",
    "signs",
];
const IMPEDANCE_KEYS: [&str; 8] = [
    "translation",
    "rotation",
    "joint",
    "damping",
    "rate",
    "force",
    "torque",
    "joint_torque",
];
/// Default rate of change, as a fraction of the maximum stiffness per second: the full range in half a second.
const IMPEDANCE_RATE: f64 = 2.0;
const JOINT_KEYS: [&str; 4] = ["position", "velocity", "acceleration", "jerk"];

/// The keys of each mapping, for the test of the schema.
#[cfg(test)]
pub(crate) mod keys {
    pub const ROBOT: [&str; 5] = super::KEYS;
    pub const JOINT: [&str; 4] = super::JOINT_KEYS;
    pub const IMPEDANCE: [&str; 8] = super::IMPEDANCE_KEYS;
    pub const LINK: [&str; 4] = super::dynamics::KEYS;
}

const AT_LEAST_0: QuantityRange = QuantityRange {
    unit: Unit::METRE,
    least: 0.0,
    most: f64::MAX,
};
const ANY_LENGTH: QuantityRange = QuantityRange::any(Unit::METRE);
const ONE_TURN: QuantityRange = QuantityRange {
    unit: Unit::RADIAN,
    least: -core::f64::consts::TAU,
    most: core::f64::consts::TAU,
};

/// A type of kinematics.
#[derive(Clone, Copy)]
enum KinematicsType {
    Srs,
    OrthoParallel,
    Serial,
    Linear,
}

const KINEMATICS_TYPES: [(&str, KinematicsType); 4] = [
    ("srs", KinematicsType::Srs),
    ("ortho-parallel", KinematicsType::OrthoParallel),
    ("serial", KinematicsType::Serial),
    ("linear", KinematicsType::Linear),
];

/// Reads the tree of a robot's file; `source` is the path of the file as written in the cell's file.
pub(crate) fn robot(reader: &mut ConfigReader, root: &Node, source: &str) -> Option<RobotConfig> {
    reader.expect_kind(root, FileKind::Robot)?;
    let fields = reader.fields(root, root.span, "a robot", &KEYS)?;
    let name = reader.require(&fields, "robot");
    let name = name.and_then(|node| reader.text(node, "a robot's name"));
    let arm = reader.require(&fields, "kinematics");
    let arm = arm.and_then(|node| kinematics(reader, node, fields.place_of("kinematics")));
    let joints = reader.require(&fields, "joints");
    let place = fields.place_of("joints");
    let joints = joints.and_then(|node| self::joints(reader, node, place, arm.as_ref()));
    let place = fields.place_of("impedance");
    let is_linear = arm.as_ref().is_some_and(Arm::is_linear);
    for key in ["impedance", "dynamics"].into_iter().filter(|_| is_linear) {
        if let Some(entry) = fields.entry(key) {
            let message = format!("`{key}` has no meaning for linear axes");
            reader.report(error(codes::KEY_OF_OTHER_KIND, entry.key.span, message));
            return None;
        }
    }
    let impedance = match fields.get("impedance") {
        Some(node) => Some(self::impedance(reader, node, place)?),
        None => None,
    };
    let joints = joints?;
    let dynamics = match fields.get("dynamics") {
        Some(node) => dynamics::read(reader, node, fields.place_of("dynamics"), &joints)?,
        None => Vec::new(),
    };
    Some(RobotConfig {
        name: name?.to_owned(),
        arm: arm?,
        joints,
        impedance,
        dynamics,
        source: source.to_owned(),
    })
}

fn kinematics(reader: &mut ConfigReader, node: &Node, place: Span) -> Option<Arm> {
    // The type determines the keys.
    let named = node.get("type").and_then(Node::text);
    let kind = KINEMATICS_TYPES
        .iter()
        .find(|(name, _)| named == Some(name));
    let keys: &[&str] = match kind {
        Some((_, KinematicsType::Srs)) => &SRS_KEYS,
        Some((_, KinematicsType::OrthoParallel)) => &ORTHO_PARALLEL_KEYS,
        Some((_, KinematicsType::Serial)) => &SERIAL_KEYS,
        Some((_, KinematicsType::Linear)) => &LINEAR_KEYS,
        None => &KINEMATICS_KEYS,
    };
    let fields = reader.fields(node, place, "the kinematics", keys)?;
    let kind = reader.require(&fields, "type")?;
    match reader.keyword(kind, "type of kinematics", &KINEMATICS_TYPES)? {
        KinematicsType::Srs => srs(reader, &fields).map(Arm::Srs),
        KinematicsType::OrthoParallel => ortho_parallel(reader, &fields).map(Arm::OrthoParallel),
        KinematicsType::Serial => serial(reader, &fields).map(Arm::Serial),
        KinematicsType::Linear => linear(reader, &fields).map(Arm::Serial),
    }
}

fn srs(reader: &mut ConfigReader, fields: &Fields<'_>) -> Option<SrsArm> {
    let mut length = |key, wanted| {
        let node = reader.require(fields, key)?;
        reader.quantity(node, key, wanted)
    };
    let shoulder_height = length("shoulder_height", AT_LEAST_0);
    let upper_arm = length("upper_arm", QuantityRange::positive(Unit::METRE));
    let forearm = length("forearm", QuantityRange::positive(Unit::METRE));
    let wrist_to_flange = length("wrist_to_flange", AT_LEAST_0);
    let signs = reader.require(fields, "signs");
    let signs = signs.and_then(|node| self::signs(reader, node));
    Some(SrsArm {
        shoulder_height: shoulder_height?,
        upper_arm: upper_arm?,
        forearm: forearm?,
        wrist_to_flange: wrist_to_flange?,
        signs: signs?,
    })
}

fn ortho_parallel(reader: &mut ConfigReader, fields: &Fields<'_>) -> Option<OrthoParallelArm> {
    let mut length = |key, wanted| {
        let node = reader.require(fields, key)?;
        reader.quantity(node, key, wanted)
    };
    let shoulder_height = length("shoulder_height", ANY_LENGTH);
    let shoulder_offset = length("shoulder_offset", ANY_LENGTH);
    let lateral_offset = length("lateral_offset", ANY_LENGTH);
    let upper_arm = length("upper_arm", QuantityRange::positive(Unit::METRE));
    let elbow_offset = length("elbow_offset", ANY_LENGTH);
    let forearm = length("forearm", QuantityRange::positive(Unit::METRE));
    let wrist_to_flange = length("wrist_to_flange", AT_LEAST_0);
    let signs = reader.require(fields, "signs");
    let signs = signs.and_then(|node| self::signs(reader, node));
    let zeros = reader.require(fields, "zeros");
    let zeros = zeros.and_then(|node| self::zeros(reader, node));
    Some(OrthoParallelArm {
        shoulder_height: shoulder_height?,
        shoulder_offset: shoulder_offset?,
        lateral_offset: lateral_offset?,
        upper_arm: upper_arm?,
        elbow_offset: elbow_offset?,
        forearm: forearm?,
        wrist_to_flange: wrist_to_flange?,
        signs: signs?,
        zeros: zeros?,
    })
}

fn serial(reader: &mut ConfigReader, fields: &Fields<'_>) -> Option<SerialArm> {
    let node = reader.require(fields, "axes");
    let place = node.map_or(fields.place_of("axes"), |node| node.span);
    let axes = node.and_then(|node| axes(reader, node, AXES_MAX));
    reader.require(fields, "flange");
    let flange = fields.entry("flange");
    let flange = flange.and_then(|entry| base::pose(reader, entry, "the flange"));
    let redundant = fields.get("redundant_joint");
    let (axes, flange) = (axes?, flange?);
    let redundant_joint = match (redundant, axes.len() == AXES_MAX) {
        (None, false) => 0,
        (Some(node), true) => {
            let number = reader.integer(node, "redundant_joint", 1, AXES_MAX as i64)?;
            usize::try_from(number).ok()? - 1
        }
        (None, true) => {
            let node = reader.require(fields, "redundant_joint");
            node.map(|_| 0)?
        }
        (Some(node), false) => {
            let message = format!(
                "redundant_joint is given, but only an arm of {AXES_MAX} axes has a redundant joint"
            );
            reader.report(error(codes::KEY_OF_OTHER_KIND, node.span, message));
            return None;
        }
    };
    let arm = SerialArm::new(&axes, flange, redundant_joint);
    if arm.is_none() {
        let message = "the axes do not make an arm: a number is too large";
        reader.report(error(codes::OUT_OF_RANGE, place, message));
    }
    arm
}

/// Reads linear axes: at most one fewer than revolute ones, since none of them can be redundant.
fn linear(reader: &mut ConfigReader, fields: &Fields<'_>) -> Option<SerialArm> {
    let node = reader.require(fields, "axes");
    let place = node.map_or(fields.place_of("axes"), |node| node.span);
    let axes = node.and_then(|node| axes(reader, node, AXES_MAX - 1));
    reader.require(fields, "flange");
    let flange = fields.entry("flange");
    let flange = flange.and_then(|entry| base::pose(reader, entry, "the flange"));
    let arm = SerialArm::of_linear_axes(&axes?, flange?);
    if arm.is_none() {
        let message = "the axes do not make a machine: a number is too large";
        reader.report(error(codes::OUT_OF_RANGE, place, message));
    }
    arm
}

fn axes(reader: &mut ConfigReader, node: &Node, most: usize) -> Option<Vec<JointAxis>> {
    let nodes = reader.list(node, "axes")?;
    if nodes.is_empty() || nodes.len() > most {
        let message = format!(
            "axes has {}, but an arm of this type has 1 to {most} axes",
            Counted::of(nodes.len(), "element")
        );
        reader.report(error(codes::WRONG_SHAPE, node.span, message));
        return None;
    }
    let read: Vec<_> = nodes.iter().map(|node| axis(reader, node)).collect();
    read.into_iter().collect()
}

fn axis(reader: &mut ConfigReader, node: &Node) -> Option<JointAxis> {
    let fields = reader.fields(node, node.span, "an axis", &AXIS_KEYS)?;
    let point = reader.require(&fields, "point");
    let point = point.and_then(|node| base::three(reader, node, "point", Unit::METRE));
    let node = reader.require(&fields, "direction")?;
    let direction = base::three(reader, node, "direction", Unit::ONE)?;
    if direction.iter().map(|x| x * x).sum::<f64>().sqrt() < 1e-3 {
        let message = "direction is 0: the axis has no direction";
        let help = "write the direction about which the joint turns, or along which it moves, such as [0, 0, 1]";
        reader.report(error(codes::OUT_OF_RANGE, node.span, message).help(help));
        return None;
    }
    Some(JointAxis {
        point: point?,
        direction,
    })
}

fn signs<const N: usize>(reader: &mut ConfigReader, node: &Node) -> Option<[f64; N]> {
    let nodes: &[Node; N] = reader.array(node, "signs")?;
    let mut signs = [0.0; N];
    for (place, node) in signs.iter_mut().zip(nodes) {
        *place = match node.value {
            Value::Int(1) => 1.0,
            Value::Int(-1) => -1.0,
            _ => {
                let message = "a sign is 1 or -1: the direction of the joint";
                reader.report(error(codes::OUT_OF_RANGE, node.span, message));
                1.0
            }
        };
    }
    Some(signs)
}

fn zeros<const N: usize>(reader: &mut ConfigReader, node: &Node) -> Option<[f64; N]> {
    let nodes: &[Node; N] = reader.array(node, "zeros")?;
    let mut zeros = [0.0; N];
    for (place, node) in zeros.iter_mut().zip(nodes) {
        *place = reader.quantity(node, "zeros", ONE_TURN)?;
    }
    Some(zeros)
}

fn impedance(reader: &mut ConfigReader, node: &Node, place: Span) -> Option<ImpedanceLimits> {
    let fields = reader.fields(node, place, "the impedance", &IMPEDANCE_KEYS)?;
    let mut range = |key, unit| {
        let node = reader.require(&fields, key)?;
        bounds_from_zero(reader, node, key, unit)
    };
    let per_radian = Unit::NEWTON_METRE.per(Unit::RADIAN);
    let translation = range("translation", Unit::NEWTON.per(Unit::METRE));
    let rotation = range("rotation", per_radian);
    let joint = range("joint", per_radian);
    let damping = range("damping", Unit::ONE);
    let mut most = |key, unit| {
        let node = reader.require(&fields, key)?;
        reader.quantity(node, key, QuantityRange::positive(unit))
    };
    let force = most("force", Unit::NEWTON);
    let torque = most("torque", Unit::NEWTON_METRE);
    let joint_torque = most("joint_torque", Unit::NEWTON_METRE);
    let rate = match fields.get("rate") {
        Some(node) => reader.quantity(node, "rate", QuantityRange::positive(Unit::HERTZ)),
        None => Some(IMPEDANCE_RATE),
    };
    Some(ImpedanceLimits {
        translation: translation?,
        rotation: rotation?,
        joint: joint?,
        damping: damping?,
        rate: rate?,
        force: force?,
        torque: torque?,
        joint_torque: joint_torque?,
    })
}

/// Reads two bounds of 0 or more. With a least stiffness of 0, a net may take the springs away; see docs/force.md. Equal
/// bounds are springs that only the robot's own application chooses; see docs/iiwa.md.
fn bounds_from_zero(
    reader: &mut ConfigReader,
    node: &Node,
    key: &str,
    unit: Unit,
) -> Option<[f64; 2]> {
    let [least, greatest] = reader.array(node, key)?;
    let not_negative = QuantityRange {
        least: 0.0,
        ..QuantityRange::any(unit)
    };
    let least = reader.quantity(least, key, not_negative)?;
    let greatest = reader.quantity(greatest, key, QuantityRange::any(unit))?;
    if least == greatest {
        return Some([least, greatest]);
    }
    reader.bounds(node, key, unit)
}

fn joints(
    reader: &mut ConfigReader,
    node: &Node,
    place: Span,
    arm: Option<&Arm>,
) -> Option<Vec<JointConfig>> {
    let entries = reader.entries(node, "the joints")?;
    if let Some(arm) = arm
        && entries.len() != arm.joints()
    {
        let kind = match arm {
            Arm::Srs(_) => "srs",
            Arm::OrthoParallel(_) => "ortho-parallel",
            Arm::Serial(arm) if arm.is_linear() => "linear",
            Arm::Serial(_) => "serial",
        };
        let message = format!(
            "{} listed, but kinematics of type {kind} has {}",
            format_args!(
                "{} {}",
                Counted::of(entries.len(), "joint"),
                if entries.len() == 1 { "is" } else { "are" }
            ),
            arm.joints()
        );
        let help = "list every joint once, from the base to the flange";
        reader.report(error(codes::JOINT_COUNT, place, message).help(help));
    }
    let linear = arm.is_some_and(Arm::is_linear);
    let joints = entries
        .iter()
        .filter_map(|entry| joint(reader, entry, linear));
    Some(joints.collect())
}

fn joint(
    reader: &mut ConfigReader,
    Entry { key, value }: &Entry,
    linear: bool,
) -> Option<JointConfig> {
    let name = reader.key_name(key, "a joint", JOINT_NAME);
    let fields = reader.fields(value, key.span, "a joint", &JOINT_KEYS)?;
    let range = reader.require(&fields, "position");
    let range = range.and_then(|node| reader.bounds(node, "position", Unit::of_joints(linear, 0)));
    let mut rate = |key, unit| {
        let node = reader.require(&fields, key)?;
        reader.quantity(node, key, QuantityRange::positive(unit))
    };
    let velocity = rate("velocity", Unit::of_joints(linear, 1));
    let acceleration = rate("acceleration", Unit::of_joints(linear, 2));
    let jerk = rate("jerk", Unit::of_joints(linear, 3));
    let [lower_rad, upper_rad] = range?;
    Some(JointConfig {
        name: name?,
        lower_rad,
        upper_rad,
        velocity_rad_s: velocity?,
        acceleration_rad_s2: acceleration?,
        jerk_rad_s3: jerk?,
    })
}
