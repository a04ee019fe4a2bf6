//! Rules about motions: parameters that contradict each other are refused, and none is silently ignored. Runs on the
//! loader's threads.

use rcc_config::diagnostic::Diagnostic;
use rcc_core::counted::Counted;
use rcc_core::frame::DeviceModel;
use rcc_core::path::leg_row;
use rcc_core::primitive::{ParameterKind, Port, Role, Spec};

use super::connections::read_or_discarded;
use super::constants::constant;
use crate::codes;
use crate::infer::Typed;
use crate::leg_conditions::CONDITIONS;
use crate::resolve::ResolvedPrimitive;
use crate::syntax::literal::{Literal, LiteralShape};

/// Pairs of parameters that exclude each other, and why.
const EXCLUSIVE: [(&str, &str, &str); 6] = [
    ("to", "pose", "each gives the goal of the motion"),
    ("to", "branch", "joint angles determine the branch"),
    ("to", "status", "joint angles determine the branch"),
    ("to", "turn", "joint angles determine the turn"),
    ("branch", "status", "each gives the branch"),
    (
        "arm_angle",
        "elbow",
        "each gives the direction of the elbow",
    ),
];

fn takes(spec: &Spec, parameter: &str) -> bool {
    spec.parameters.iter().any(|it| it.name == parameter)
}

fn has_path(spec: &Spec) -> bool {
    let mut kinds = spec.parameters.iter().map(|parameter| parameter.kind);
    kinds.any(|kind| matches!(kind, ParameterKind::Path(_)))
}

/// Returns the value given for a parameter, unless it is null.
fn given<'a>(item: &'a ResolvedPrimitive<'_>, name: &str) -> Option<&'a Literal> {
    let place = item
        .spec()
        .parameters
        .iter()
        .position(|known| known.name == name)?;
    let literal = item.parameters.get(place).copied().flatten()?;
    (literal.shape != LiteralShape::Null).then_some(literal)
}

/// Requires that at most one of two exclusive parameters is given.
pub fn parameters_do_not_contradict(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    let contradict = |spec: &'static Spec| {
        let mut pairs = EXCLUSIVE.iter();
        pairs.any(|(first, second, _)| takes(spec, first) && takes(spec, second))
    };
    for (_, item) in net.graph.items_of(contradict) {
        // `to` of other motions is a pose.
        let is_joints = takes(item.spec(), "pose");
        for (first, second, why) in EXCLUSIVE {
            if first == "to" && !is_joints {
                continue;
            }
            let (Some(_), Some(literal)) = (given(item, first), given(item, second)) else {
                continue;
            };
            let message = format!("`{}` has both `{first}` and `{second}`: {why}", item.id());
            let diagnostic = Diagnostic::error(codes::CONTRADICTION, literal.span, message);
            diagnostics.push(diagnostic.help(format!("remove `{first}` or `{second}`")));
        }
    }
}

/// Requires `time_optimal` where `stops` says what a time-optimal motion reserves.
pub fn reserves_are_of_time_optimal_motions(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    for (_, item) in net.graph.items_of(|spec| takes(spec, "stops")) {
        let optimal = given(item, "time_optimal").map(|literal| &literal.shape);
        let Some(stops) = given(item, "stops") else {
            continue;
        };
        if !matches!(
            optimal,
            Some(LiteralShape::Bool(true) | LiteralShape::Refused)
        ) {
            let message = format!("`{}` has `stops` but is not time-optimal", item.id());
            let diagnostic = Diagnostic::error(codes::CONTRADICTION, stops.span, message);
            diagnostics.push(diagnostic.help("add `time_optimal: true`, or remove `stops`"));
        }
    }
}

/// Requires that a `JointMotion` has a goal, `to` or `pose`.
pub fn joint_motions_have_a_goal(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    for (_, item) in net.graph.items_of(|spec| spec.name == "JointMotion") {
        let mut goals = ["to", "pose"].iter();
        if goals.any(|name| given(item, name).is_some()) {
            continue;
        }
        let message = format!("`{}` needs the parameter `to` or `pose`", item.id());
        let span = item.primitive.type_name.span;
        let diagnostic = Diagnostic::error(codes::MISSING_PARAMETER, span, message);
        diagnostics
            .push(diagnostic.help("add `to`, the joints at the end, or `pose`, the flange there"));
    }
}

/// Returns name and model of the arm of an item.
fn arm<'a>(net: Typed<'a>, item: &ResolvedPrimitive<'_>) -> Option<(&'a str, &'a DeviceModel)> {
    let device = net.graph.cell.devices.get(item.device?)?;
    Some((&device.name, &device.model))
}

/// Requires that KUKA's Turn sets bits only for joints that the arm has.
pub fn turns_have_a_bit_for_each_joint(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    let turns = |spec: &Spec| has_path(spec) || takes(spec, "turn");
    for (_, item) in net.graph.items_of(turns) {
        let Some((name, model)) = arm(net, item) else {
            continue;
        };
        let parameters = item.spec().parameters.iter().zip(&item.parameters);
        let paths =
            parameters.filter(|(parameter, _)| matches!(parameter.kind, ParameterKind::Path(_)));
        let rows = paths.filter_map(|(_, given)| match &given.as_ref()?.shape {
            LiteralShape::List(rows) => Some(rows.iter().filter_map(turn_of_leg)),
            _ => None,
        });
        let of_motion = given(item, "turn").and_then(|turn| Some((turn.number()?, turn)));
        for (turn, literal) in rows.flatten().chain(of_motion) {
            let most = f64::from((1_u32 << model.joints) - 1);
            if turn <= most {
                continue;
            }
            let message = format!(
                "`turn` of `{}` is {turn}: `{name}` has {}, so it is at most {most}",
                item.id(),
                Counted(u64::from(model.joints), "joint")
            );
            let diagnostic = Diagnostic::error(codes::OUT_OF_RANGE, literal.span, message);
            diagnostics.push(diagnostic.help("bit i is set if joint i + 1 is negative at the end"));
        }
    }
}

/// Returns the Turn of a leg, see [`record`].
fn turn_of_leg(row: &Literal) -> Option<(f64, &Literal)> {
    let LiteralShape::List(columns) = &row.shape else {
        return None;
    };
    let number = |column: usize| columns.get(column)?.number();
    (number(0)? == leg_row::PTP_POSE).then_some((number(leg_row::TURN)?, row))
}

/// Requires that each `wait` and `until` of a leg has its condition. Those in a path that is a parameter of a fragment
/// have none: conditions are links, which parameters cannot be.
pub fn conditions_of_legs_are_connected(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    for (_, item) in net.graph.items_of(has_path) {
        let is_connected = item
            .primitive
            .inputs
            .iter()
            .any(|(key, _)| key.name == CONDITIONS);
        let parameters = item.spec().parameters.iter().zip(&item.parameters);
        let paths =
            parameters.filter(|(parameter, _)| matches!(parameter.kind, ParameterKind::Path(_)));
        let rows = paths.filter_map(|(_, given)| match &given.as_ref()?.shape {
            LiteralShape::List(rows) => Some(rows),
            _ => None,
        });
        let has_condition = |row: &&Literal| match &row.shape {
            LiteralShape::List(columns) => {
                let mut conditions = columns.iter().skip(leg_row::WAIT);
                conditions.any(|column| column.number().is_some())
            }
            _ => false,
        };
        let Some(row) = rows.flatten().find(has_condition).filter(|_| !is_connected) else {
            continue;
        };
        let message = format!(
            "the legs of `{}` are a parameter of a fragment, so `wait` and `until` have no condition",
            item.id()
        );
        let diagnostic = Diagnostic::error(codes::CONTRADICTION, row.span, message);
        diagnostics.push(diagnostic.help(
            "write these legs in the fragment, and link the condition to an input of the fragment",
        ));
    }
}

/// Requires that a constant goal lies within the range of every joint: the net would wait for an unreachable goal
/// forever.
pub fn goals_are_within_range(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    for (_, item) in net.graph.items_of(|spec| spec.name == "JointGoal") {
        let (Some((name, model)), Some(goal)) = (arm(net, item), item.inputs.first()) else {
            continue;
        };
        // A goal with a null element stops the motion.
        let Some(goal) = constant(net, goal).filter(|goal| !has_null(goal)) else {
            continue;
        };
        let ranges = model.limits.lower.iter().zip(&model.limits.upper);
        for (joint, (value, (lower, upper))) in (1..).zip(goal.numbers().into_iter().zip(ranges)) {
            if (*lower..=*upper).contains(&value) {
                continue;
            }
            let (factor, unit, help) = match model.is_linear() {
                true => (
                    1.0,
                    " m",
                    "bare lengths are in m: write `300 mm` for millimetres",
                ),
                false => (
                    1_f64.to_degrees(),
                    "°",
                    "bare angles are in rad: write `deg(30)` for degrees",
                ),
            };
            let [value, lower, upper] = [value, *lower, *upper].map(|value| value * factor);
            let message = format!(
                "`{}.goal` is out of range: J{joint} of `{name}` moves from {lower:.3}{unit} to {upper:.3}{unit}, found {value:.3}{unit}",
                item.id()
            );
            let diagnostic = Diagnostic::error(codes::OUT_OF_RANGE, goal.span, message);
            diagnostics.push(diagnostic.help(help));
        }
    }
}

/// Requires that the joints or the pose of a motion are read: otherwise the net runs through the motion and no arm
/// moves.
pub fn motion_outputs_are_read(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    let motions = net.graph.items_of(|spec| spec.role == Role::Motion);
    let mut motions = motions.peekable();
    if motions.peek().is_none() {
        return;
    }
    let used = read_or_discarded(net);
    for (number, item) in motions {
        let mut outputs = item.spec().outputs.iter().zip(used.item(number));
        if outputs.any(|(port, is_used)| *is_used && matches!(port.name, "joints" | "pose")) {
            continue;
        }
        let id = item.id();
        let message =
            format!("neither `{id}.joints` nor `{id}.pose` is read: the motion moves no arm");
        let diagnostic = Diagnostic::error(codes::NOT_READ, item.primitive.id.span, message);
        diagnostics.push(diagnostic.help(format!(
            "add `{{type: JointPositionCommand, parameters: {{device: …}}, inputs: {{position: {id}.joints}}}}`, or discard it: `discard: [{id}.joints]`"
        )));
    }
}

/// Requires that no command is the constant null: the device would never be commanded. Values that are null in every
/// cycle for another reason are refused by `nulls::commands_can_become_known`.
pub fn commands_are_not_null(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    for (_, item) in net.graph.items_of(Spec::commands_device) {
        for (input_source, port) in item.inputs.iter().zip(item.spec().inputs) {
            let Some(literal) = constant(net, input_source).filter(|literal| has_null(literal))
            else {
                continue;
            };
            let (id, name) = (item.id(), port.name);
            let message = format!("`{id}.{name}` is always null: nothing would be commanded");
            let diagnostic = Diagnostic::error(codes::OUT_OF_RANGE, literal.span, message);
            diagnostics
                .push(diagnostic.help(format!("give a value other than null: {}", port.doc)));
        }
    }
}

fn has_null(literal: &Literal) -> bool {
    match &literal.shape {
        LiteralShape::Null => true,
        LiteralShape::List(elements) => elements.iter().any(has_null),
        _ => false,
    }
}

/// Requires that a constant axis, of a rotation or of a force, has a length other than 0.
pub fn axes_have_a_direction(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    let is_axis = |port: &Port| port.name == "axis";
    let has_axis = |spec: &Spec| takes(spec, "axis") || spec.inputs.iter().any(is_axis);
    for (_, item) in net.graph.items_of(has_axis) {
        let input = item
            .spec()
            .inputs
            .iter()
            .position(|port| port.name == "axis");
        let input = input.and_then(|place| constant(net, item.inputs.get(place)?));
        let Some(axis) = given(item, "axis").or(input) else {
            continue;
        };
        let numbers = axis.numbers();
        if numbers.len() != 3 || numbers.iter().any(|number| *number != 0.0) {
            continue;
        }
        let message = format!("`{}.axis` has no direction: its length is 0", item.id());
        let diagnostic = Diagnostic::error(codes::OUT_OF_RANGE, axis.span, message);
        diagnostics
            .push(diagnostic.help("give an axis with a length other than 0, such as [0, 0, -1]"));
    }
}
