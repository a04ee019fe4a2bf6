//! Reads the file of a robot.
//! Run at start-up by whoever reads the cell's file.

use rcc_core::kinematics::SrsArm;
use rcc_core::message::JOINTS_MAX;
use rcc_core::unit::Unit;

use super::{JointConfig, RobotConfig};
use crate::codes;
use crate::diagnostic::Span;
use crate::reader::{JOINT_NAME, Reader, Wanted, error};
use crate::yaml::{Entry, Node, Value};

const KEYS: [&str; 3] = ["robot", "kinematics", "joints"];
const KINEMATICS_KEYS: [&str; 6] = [
    "type",
    "shoulder_height",
    "upper_arm",
    "forearm",
    "wrist_to_flange",
    "signs",
];
const JOINT_KEYS: [&str; 4] = ["position", "velocity", "acceleration", "jerk"];

/// Joints of the S-R-S arm.
const SRS_JOINTS: usize = 7;

/// Reads the tree of a robot's file; `source` is the file's name as the cell's file gives it.
pub(crate) fn robot(reader: &mut Reader, root: &Node, source: &str) -> Option<RobotConfig> {
    let fields = reader.fields(root, root.span, "a robot", &KEYS)?;
    let name = reader.need(&fields, "robot");
    let name = name.and_then(|node| reader.text(node, "a robot's name"));
    let arm = reader.need(&fields, "kinematics");
    let arm = arm.and_then(|node| kinematics(reader, node, fields.place_of("kinematics")));
    let joints = reader.need(&fields, "joints");
    let joints = joints.and_then(|node| self::joints(reader, node, fields.place_of("joints")));
    Some(RobotConfig {
        name: name?.to_owned(),
        arm: arm?,
        joints: joints?,
        source: source.to_owned(),
    })
}

fn kinematics(reader: &mut Reader, node: &Node, place: Span) -> Option<SrsArm> {
    let fields = reader.fields(node, place, "the kinematics", &KINEMATICS_KEYS)?;
    let kind = reader.need(&fields, "type");
    let kind = kind.and_then(|node| reader.word(node, "type of kinematics", &[("srs", ())]));
    let mut length = |key, wanted| {
        let node = reader.need(&fields, key)?;
        reader.quantity(node, key, wanted)
    };
    let at_least_0 = Wanted {
        unit: Unit::METRE,
        least: 0.0,
        most: f64::MAX,
    };
    let shoulder_height = length("shoulder_height", at_least_0);
    let upper_arm = length("upper_arm", Wanted::positive(Unit::METRE));
    let forearm = length("forearm", Wanted::positive(Unit::METRE));
    let wrist_to_flange = length("wrist_to_flange", at_least_0);
    let signs = reader.need(&fields, "signs");
    let signs = signs.and_then(|node| self::signs(reader, node));
    kind?;
    Some(SrsArm {
        shoulder_height: shoulder_height?,
        upper_arm: upper_arm?,
        forearm: forearm?,
        wrist_to_flange: wrist_to_flange?,
        signs: signs?,
    })
}

fn signs(reader: &mut Reader, node: &Node) -> Option<[f64; SRS_JOINTS]> {
    let nodes: &[Node; SRS_JOINTS] = reader.array(node, "signs")?;
    let mut signs = [0.0; SRS_JOINTS];
    for (place, node) in signs.iter_mut().zip(nodes) {
        *place = match node.value {
            Value::Int(1) => 1.0,
            Value::Int(-1) => -1.0,
            _ => {
                let message = "a sign is 1 or -1: the direction of the joint";
                reader.keep(error(codes::OUT_OF_RANGE, node.span, message));
                1.0
            }
        };
    }
    Some(signs)
}

fn joints(reader: &mut Reader, node: &Node, place: Span) -> Option<Vec<JointConfig>> {
    const { assert!(SRS_JOINTS <= JOINTS_MAX) };
    let entries = reader.entries(node, "the joints")?;
    if entries.len() != SRS_JOINTS {
        let message = format!(
            "there are {} joints, but kinematics of type srs has {SRS_JOINTS}",
            entries.len()
        );
        let help = "list every joint once, from the base to the flange";
        reader.keep(error(codes::JOINT_COUNT, place, message).help(help));
    }
    let joints = entries.iter().filter_map(|entry| joint(reader, entry));
    Some(joints.collect())
}

fn joint(reader: &mut Reader, Entry { key, value }: &Entry) -> Option<JointConfig> {
    let name = reader.key_name(key, "a joint", JOINT_NAME);
    let fields = reader.fields(value, key.span, "a joint", &JOINT_KEYS)?;
    let range = reader.need(&fields, "position");
    let range = range.and_then(|node| reader.bounds(node, "position", Unit::RADIAN));
    let mut rate = |key, unit| {
        let node = reader.need(&fields, key)?;
        reader.quantity(node, key, Wanted::positive(unit))
    };
    let velocity = rate("velocity", Unit::RADIAN_PER_SECOND);
    let acceleration = rate("acceleration", Unit::RADIAN_PER_SECOND2);
    let jerk = rate("jerk", Unit::RADIAN_PER_SECOND3);
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
