//! Legs of a path in their notation, `- {lin: {xyz: …, rpy: …}, blend: 20 mm}`, converted to rows of numbers, see
//! `rcc_core::path::leg_row`. Runs on the loader's threads.

use rcc_config::diagnostic::Diagnostic;
use rcc_config::yaml::{Node, Value};
use rcc_core::message::JOINTS_MAX;
use rcc_core::path::leg_row::{self, LegRow, WIDTH};
use rcc_core::unit::Unit;

use super::super::shape::{report_unknown_keys, shape};
use super::super::source::read_source;
use super::read_quantity;
use crate::codes;
use crate::syntax::Source;
use crate::syntax::literal::{Literal, LiteralShape};

/// Kinds of legs; each leg has exactly one of these keys.
const KINDS: [&str; 4] = ["ptp", "lin", "circ", "spline"];

/// Blending and limits of the flange: key, column and unit.
const LIMITS: [(&str, usize, Unit); 7] = [
    ("blend", 14, Unit::METRE),
    ("velocity", 15, Unit::METRE_PER_SECOND),
    ("acceleration", 16, Unit::METRE_PER_SECOND2),
    ("jerk", 17, Unit::METRE_PER_SECOND3),
    ("angular_velocity", 18, Unit::RADIAN_PER_SECOND),
    ("angular_acceleration", 19, Unit::RADIAN_PER_SECOND2),
    ("angular_jerk", 20, Unit::RADIAN_PER_SECOND3),
];

const SCALE: usize = 21;

/// Keys of a leg with a flange goal, the kind included.
const FLANGE_KEYS: &[&str] = &[
    "lin",
    "circ",
    "spline",
    "blend",
    "velocity",
    "acceleration",
    "jerk",
    "angular_velocity",
    "angular_acceleration",
    "angular_jerk",
    "scale",
    "relative",
    "arm_angle",
    "elbow",
    "wait",
    "until",
];
const JOINT_KEYS: &[&str] = &["ptp", "blend", "scale", "relative", "wait", "until"];

/// Conditions of a leg, in the order of their columns.
const CONDITIONS: [&str; 2] = ["wait", "until"];

/// Returns true for a list of legs: its first element has a key of a kind.
pub fn are_legs(nodes: &[Node]) -> bool {
    let first = nodes.first();
    first.is_some_and(|node| KINDS.iter().any(|kind| node.get(kind).is_some()))
}

/// Reads legs as rows; `None` if one is refused, with its diagnostic.
pub(super) fn read(nodes: &[Node], diagnostics: &mut Vec<Diagnostic>) -> Option<Vec<Literal>> {
    let before = diagnostics.len();
    let mut rows = Vec::new();
    let mut conditions = 0;
    for node in nodes {
        let columns = CONDITIONS.map(|key| {
            node.get(key).map_or(f64::NAN, |_| {
                conditions += 1;
                f64::from(conditions - 1)
            })
        });
        leg(node, columns, &mut rows, diagnostics);
    }
    conditions_fit(nodes, diagnostics);
    let blend = nodes.last().and_then(|node| node.get("blend"));
    // An invalid value is already reported.
    let is_zone = |node: &&Node| {
        let read = read_quantity(node, &mut Vec::new());
        read.is_some_and(|blend| blend.value > 0.0)
    };
    if let Some(blend) = blend.filter(is_zone) {
        let message = "the last leg has a `blend`, but no leg follows to blend into";
        let diagnostic = Diagnostic::error(codes::CONTRADICTION, blend.span, message);
        diagnostics.push(diagnostic.help("remove `blend`: the path ends at rest"));
    }
    (diagnostics.len() == before).then_some(rows)
}

/// Returns a row as a constant; elements that are not given are null.
fn row_literal(row: &LegRow, node: &Node) -> Literal {
    let number = |value: &f64| {
        let shape = if value.is_nan() {
            LiteralShape::Null
        } else {
            LiteralShape::Real(*value, None)
        };
        Literal::new(shape, node.span)
    };
    Literal::new(
        LiteralShape::List(row.iter().map(number).collect()),
        node.span,
    )
}

/// Reads the conditions of legs in the order of their numbers: for each leg `wait`, then `until`.
pub fn read_conditions(nodes: &[Node], diagnostics: &mut Vec<Diagnostic>) -> Vec<Source> {
    let of_leg = |node| CONDITIONS.map(move |key| Some((key, Node::get(node, key)?)));
    let all = nodes.iter().flat_map(of_leg).flatten();
    let read = |(key, node): (&str, &Node)| {
        let source = read_source(node, diagnostics);
        if !matches!(
            source,
            Source::Link(_) | Source::Formula(_) | Source::Refused
        ) {
            let wanted = "an output such as `part.out`, or a formula such as `\"= ft.fz > 12 N\"`";
            diagnostics.push(shape(node, &format!("`{key}`"), wanted));
            return Source::Refused;
        }
        source
    };
    all.map(read).collect()
}

/// Requires that the motion rests where a leg waits or is ended, and that the leg after one with `until` can begin
/// anywhere on it.
fn conditions_fit(nodes: &[Node], diagnostics: &mut Vec<Diagnostic>) {
    let mut report = |node: &Node, message: &str, help: &str| {
        let diagnostic = Diagnostic::error(codes::CONTRADICTION, node.span, message);
        diagnostics.push(diagnostic.help(help));
    };
    let before = std::iter::once(None).chain(nodes.iter().map(Some));
    for (leg, before) in nodes.iter().zip(before) {
        let blends_into = before.and_then(|before| before.get("blend"));
        if let (Some(_), Some(wait)) = (blends_into, leg.get("wait")) {
            let message = "a leg with `wait` begins at rest, but the leg before it has a `blend`";
            report(wait, message, "remove `blend` from the leg before");
        }
        if let (Some(_), Some(blend)) = (leg.get("until"), leg.get("blend")) {
            let message = "a leg with `until` ends at rest, but it has a `blend`";
            report(blend, message, "remove `blend`");
        }
        let ended = before.and_then(|before| before.get("until"));
        let Some(ended) = ended else {
            continue;
        };
        let words =
            "the leg before it has `until`, so its beginning is not known before the motion";
        if let Some(blend) = leg.get("blend") {
            report(
                blend,
                "a leg after one with `until` ends at rest",
                "remove `blend`",
            );
        }
        if let Some(relative) = leg.get("relative") {
            let help = "give its goal in the arm's base, without `relative`";
            report(
                relative,
                &format!("`relative` has no meaning: {words}"),
                help,
            );
        }
        for kind in ["circ", "spline"] {
            if let Some(shape) = leg.get(kind) {
                let help = "use a `ptp` or a `lin`";
                report(shape, &format!("no `{kind}` is possible: {words}"), help);
            }
        }
        let from_joints = before.is_some_and(|before| before.get("ptp").is_some());
        if let (Some(_), true) = (leg.get("lin"), from_joints) {
            let message = "after a `ptp` with `until` no `lin` is possible: where it begins, and with which joints, is not known";
            report(ended, message, "use a `ptp` after it, or a `lin` before it");
        }
    }
}

fn leg(
    node: &Node,
    conditions: [f64; 2],
    rows: &mut Vec<Literal>,
    diagnostics: &mut Vec<Diagnostic>,
) {
    let mut kinds = KINDS
        .iter()
        .filter_map(|kind| Some((*kind, node.get(kind)?)));
    let (Some((kind, what)), None) = (kinds.next(), kinds.next()) else {
        diagnostics.push(
            shape(
                node,
                "a leg",
                "a mapping with one of `ptp`, `lin`, `circ`, `spline`",
            )
            .help("write `- {lin: {xyz: [...], rpy: [...]}, blend: 20 mm}`"),
        );
        return;
    };
    let keys = if kind == "ptp" {
        JOINT_KEYS
    } else {
        FLANGE_KEYS
    };
    report_unknown_keys(node, keys, &format!("a `{kind}`"), diagnostics);
    let mut row = [f64::NAN; WIDTH];
    row[leg_row::WAIT..].copy_from_slice(&conditions);
    for (key, column, unit) in LIMITS {
        if let Some(node) = node.get(key) {
            let above = key != "blend";
            row[column] = quantity(node, key, unit, above, diagnostics);
        }
    }
    if let Some(node) = node.get("scale") {
        row[SCALE] = quantity(node, "scale", Unit::ONE, true, diagnostics);
        if row[SCALE] > 1.0 {
            diagnostics.push(out_of_range(node, "`scale` must be at most 1"));
        }
    }
    if let Some(node) = node.get("relative") {
        row[23] = word(node, "relative", &["", "tool", "base"], diagnostics);
    }
    if let Some(node) = node.get("arm_angle") {
        row[24] = number(node, "`arm_angle`", Unit::RADIAN, diagnostics);
    }
    if let Some(node) = node.get("elbow") {
        row[25] = word(node, "elbow", leg_row::ELBOWS, diagnostics);
    }
    either(node, ["arm_angle", "elbow"], diagnostics);
    match kind {
        "ptp" => {
            ptp(what, &mut row, diagnostics);
            if let (Some(_), Some(relative)) = (what.get("joints"), node.get("relative")) {
                let message = "`relative` applies to poses only: joint angles are absolute";
                let diagnostic = Diagnostic::error(codes::CONTRADICTION, relative.span, message);
                diagnostics.push(diagnostic.help("remove `relative`, or give a pose"));
            }
        }
        "lin" => {
            row[0] = leg_row::LIN;
            pose(what, &mut row, diagnostics);
        }
        "circ" => circ(what, &mut row, diagnostics),
        _ => return spline(what, &row, rows, diagnostics),
    }
    rows.push(row_literal(&row, node));
}

fn ptp(node: &Node, row: &mut LegRow, diagnostics: &mut Vec<Diagnostic>) {
    let Some(joints) = node.get("joints") else {
        row[0] = leg_row::PTP_POSE;
        // The pose as in `JointMotion`, or its elements beside the configuration.
        let goal = node.get("pose");
        let keys: &[&str] = match goal {
            Some(_) => &["pose", "branch", "status", "turn"],
            None => &["xyz", "rpy", "quat", "branch", "status", "turn"],
        };
        report_unknown_keys(node, keys, "a `ptp`", diagnostics);
        either(node, ["branch", "status"], diagnostics);
        for (key, column, most) in [
            ("branch", 22, 7),
            ("status", 9, 31),
            ("turn", leg_row::TURN, 255),
        ] {
            if let Some(node) = node.get(key) {
                row[column] = whole(node, key, most, diagnostics);
            }
        }
        return match goal {
            Some(goal) => pose(goal, row, diagnostics),
            None => pose(&only(node, &["xyz", "rpy", "quat"]), row, diagnostics),
        };
    };
    row[0] = leg_row::PTP_JOINTS;
    report_unknown_keys(node, &["joints"], "a `ptp` to joints", diagnostics);
    let Some(joints) = joints.list().filter(|all| all.len() <= JOINTS_MAX) else {
        diagnostics.push(shape(joints, "`joints`", "a list of angles, A1 first"));
        return;
    };
    for (place, node) in row[1..].iter_mut().zip(joints) {
        *place = number(node, "a joint", Unit::RADIAN, diagnostics);
    }
}

fn circ(node: &Node, row: &mut LegRow, diagnostics: &mut Vec<Diagnostic>) {
    row[0] = leg_row::CIRC;
    report_unknown_keys(
        node,
        &["via", "to", "angle", "orientation"],
        "a `circ`",
        diagnostics,
    );
    let (Some(via), Some(to)) = (node.get("via"), node.get("to")) else {
        diagnostics.push(
            shape(node, "a `circ`", "`via` and `to`")
                .help("write `circ: {via: {xyz: [...]}, to: {xyz: [...], rpy: [...]}}`"),
        );
        return;
    };
    pose(to, row, diagnostics);
    if via.list().is_none() {
        report_unknown_keys(via, &["xyz"], "a `via`", diagnostics);
    }
    let point = via.get("xyz").unwrap_or(via);
    match point.list().filter(|all| all.len() == 3) {
        Some(point) => {
            for (place, node) in row[9..].iter_mut().zip(point) {
                *place = number(node, "`via`", Unit::METRE, diagnostics);
            }
        }
        None => diagnostics.push(shape(via, "`via`", "a point, `{xyz: [x, y, z]}`")),
    }
    if let Some(node) = node.get("angle") {
        row[13] = number(node, "`angle`", Unit::RADIAN, diagnostics);
    }
    if let Some(node) = node.get("orientation") {
        row[12] = word(node, "orientation", leg_row::ORIENTATIONS, diagnostics);
    }
}

/// Adds a row for each point.
fn spline(node: &Node, row: &LegRow, rows: &mut Vec<Literal>, diagnostics: &mut Vec<Diagnostic>) {
    let points = node.get("through").unwrap_or(node);
    if points.list().is_none() {
        report_unknown_keys(node, &["through"], "a `spline`", diagnostics);
    }
    let Some(points) = points.list().filter(|points| !points.is_empty()) else {
        diagnostics.push(shape(node, "a `spline`", "a list of poses"));
        return;
    };
    for (number, point) in (1..).zip(points) {
        let mut row = *row;
        row[0] = if number == points.len() {
            leg_row::SPLINE
        } else {
            leg_row::THROUGH
        };
        pose(point, &mut row, diagnostics);
        rows.push(row_literal(&row, point));
    }
}

/// Returns a mapping reduced to the given keys.
fn only(node: &Node, keys: &[&str]) -> Node {
    let mut node = node.clone();
    if let Value::Map(entries) = &mut node.value {
        entries.retain(|entry| keys.contains(&entry.key.name.as_str()));
    }
    node
}

fn pose(node: &Node, row: &mut LegRow, diagnostics: &mut Vec<Diagnostic>) {
    let before = diagnostics.len();
    match super::read(node, diagnostics).shape {
        LiteralShape::Pose(elements) => {
            for (place, element) in row[1..].iter_mut().zip(elements) {
                *place = element;
            }
        }
        _ if diagnostics.len() > before => {}
        _ => diagnostics.push(
            shape(node, "a goal", "a pose")
                .help("write `{xyz: [x, y, z], rpy: [roll, pitch, yaw]}`"),
        ),
    }
}

/// Reads a number, bare or in the given unit.
fn number(node: &Node, what: &str, unit: Unit, diagnostics: &mut Vec<Diagnostic>) -> f64 {
    let Some(quantity) = read_quantity(node, diagnostics) else {
        return f64::NAN;
    };
    if let Some(have) = quantity.unit.filter(|have| *have != unit) {
        let message = format!("unit mismatch: {what} expects {unit}, found {have}");
        diagnostics.push(Diagnostic::error(codes::UNIT_MISMATCH, node.span, message));
    }
    quantity.value
}

/// Reports if both of two exclusive keys are given.
fn either(node: &Node, keys: [&str; 2], diagnostics: &mut Vec<Diagnostic>) {
    let [first, second] = keys;
    if let (Some(_), Some(other)) = (node.get(first), node.get(second)) {
        let message = format!("`{first}` and `{second}` exclude each other");
        let diagnostic = Diagnostic::error(codes::CONTRADICTION, other.span, message);
        diagnostics.push(diagnostic.help(format!("remove `{first}` or `{second}`")));
    }
}

/// Reads a number greater than 0, or at least 0 unless `above`.
fn quantity(
    node: &Node,
    key: &str,
    unit: Unit,
    above: bool,
    diagnostics: &mut Vec<Diagnostic>,
) -> f64 {
    let value = number(node, &format!("`{key}`"), unit, diagnostics);
    if value < 0.0 || (above && value == 0.0) {
        let wanted = if above { "greater than 0" } else { "0 or more" };
        diagnostics.push(out_of_range(node, &format!("`{key}` must be {wanted}")));
    }
    value
}

fn out_of_range(node: &Node, message: &str) -> Diagnostic {
    Diagnostic::error(codes::OUT_OF_RANGE, node.span, message.to_owned())
}

fn whole(node: &Node, key: &str, most: i64, diagnostics: &mut Vec<Diagnostic>) -> f64 {
    match node.value {
        Value::Int(value) if (0..=most).contains(&value) => value as f64,
        _ => {
            diagnostics.push(shape(
                node,
                &format!("`{key}`"),
                &format!("a whole number from 0 to {most}"),
            ));
            f64::NAN
        }
    }
}

/// Reads one of `words` and returns its index; an empty word is a placeholder.
fn word(node: &Node, key: &str, words: &[&str], diagnostics: &mut Vec<Diagnostic>) -> f64 {
    let given = node.text().unwrap_or("");
    let found = (0u8..)
        .zip(words)
        .find(|(_, word)| !word.is_empty() && **word == given);
    if let Some((number, _)) = found {
        return f64::from(number);
    }
    let words: Vec<&str> = words
        .iter()
        .copied()
        .filter(|word| !word.is_empty())
        .collect();
    diagnostics.push(shape(
        node,
        &format!("`{key}`"),
        &format!("one of {}", words.join(", ")),
    ));
    f64::NAN
}

#[cfg(test)]
mod tests;
