//! Poses and rotations: `{xyz: …, rpy: …}`, `{quat: …}`. Runs on the loader's threads.

use rcc_config::diagnostic::Diagnostic;
use rcc_config::yaml::Node;
use rcc_core::pose::Pose;
use rcc_core::unit::Unit;

use super::super::shape::report_unknown_keys;
use super::read_quantity;
use crate::codes;
use crate::syntax::literal::LiteralShape;

/// A quaternion whose length deviates from 1 by more is refused as a mistake.
const LENGTH_TOLERANCE: f64 = 1e-3;
/// A quaternion whose length deviates from 1 by no more is kept to the bit; normalising it would not improve it.
const LENGTH_NOISE: f64 = 4.0 * f64::EPSILON;

/// Keys of poses and rotations.
pub const POSE_KEYS: &[&str] = &["xyz", "rpy", "quat"];

pub fn read_pose(node: &Node, diagnostics: &mut Vec<Diagnostic>) -> Option<LiteralShape> {
    let before = diagnostics.len();
    report_unknown_keys(node, POSE_KEYS, "a pose", diagnostics);
    if diagnostics.len() > before {
        return None;
    }
    let rotation = match (node.get("rpy"), node.get("quat")) {
        (Some(rpy), None) => {
            let angles = read_numbers::<3>(rpy, "`rpy`", Unit::RADIAN, diagnostics);
            angles.map(|rpy| Pose::from_xyz_rpy([0.0; 3], rpy).orientation)
        }
        (None, Some(quat)) => read_quaternion(quat, diagnostics),
        (given, _) => {
            let message = match given {
                Some(_) => "the rotation is given twice",
                None => "the rotation is missing",
            };
            let diagnostic = Diagnostic::error(codes::WRONG_SHAPE, node.span, message);
            diagnostics.push(
                diagnostic.help("give either `rpy: [roll, pitch, yaw]` or `quat: [x, y, z, w]`"),
            );
            None
        }
    };
    let Some(xyz) = node.get("xyz") else {
        return rotation.map(LiteralShape::Rotation);
    };
    let position = read_numbers::<3>(xyz, "`xyz`", Unit::METRE, diagnostics);
    let ([x, y, z], [qx, qy, qz, qw]) = (position?, rotation?);
    Some(LiteralShape::Pose([x, y, z, qx, qy, qz, qw]))
}

fn read_quaternion(node: &Node, diagnostics: &mut Vec<Diagnostic>) -> Option<[f64; 4]> {
    let elements = read_numbers::<4>(node, "`quat`", Unit::ONE, diagnostics)?;
    let length = elements.iter().map(|x| x * x).sum::<f64>().sqrt();
    if (length - 1.0).abs() <= LENGTH_NOISE {
        return Some(elements);
    }
    if (length - 1.0).abs() <= LENGTH_TOLERANCE {
        return Some(elements.map(|x| x / length));
    }
    let message = format!("the quaternion has length {length:.4}, not 1");
    let diagnostic = Diagnostic::error(codes::NOT_NORMALISED, node.span, message);
    diagnostics.push(diagnostic.help("the order is x, y, z, w; or use `rpy: [roll, pitch, yaw]`"));
    None
}

/// Reads `N` numbers, bare or in `unit`.
fn read_numbers<const N: usize>(
    node: &Node,
    what: &str,
    unit: Unit,
    diagnostics: &mut Vec<Diagnostic>,
) -> Option<[f64; N]> {
    let Some(nodes) = node.list().filter(|nodes| nodes.len() == N) else {
        let message = format!("{what} must be a list of {N} numbers");
        diagnostics.push(Diagnostic::error(codes::WRONG_SHAPE, node.span, message));
        return None;
    };
    let mut values = [0.0; N];
    let mut good = true;
    for (place, node) in values.iter_mut().zip(nodes) {
        let Some(quantity) = read_quantity(node, diagnostics) else {
            good = false;
            continue;
        };
        if let Some(have) = quantity.unit.filter(|have| *have != unit) {
            let message = format!("unit mismatch: {what} expects {unit}, found {have}");
            diagnostics.push(Diagnostic::error(codes::UNIT_MISMATCH, node.span, message));
            good = false;
        }
        *place = quantity.value;
    }
    good.then_some(values)
}
