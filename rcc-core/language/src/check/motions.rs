//! Rules of motions: nothing that is said about one is passed over because something else is said, too.
//! The loader's threads.

use rcc_config::diagnostic::Diagnostic;

use super::Typed;
use crate::fault;
use crate::resolve::Item;
use crate::syntax::literal::{Literal, Shape};

/// Parameters of which a motion takes one only, and why.
const EITHER: [(&str, &str, &str); 6] = [
    ("to", "pose", "each says where the motion ends"),
    ("to", "branch", "joints say the branch themselves"),
    ("to", "status", "joints say the branch themselves"),
    ("to", "turn", "joints say the turn themselves"),
    ("branch", "status", "each says the branch"),
    ("arm_angle", "elbow", "each says where the elbow turns to"),
];

/// What is given for a parameter, unless it is null.
fn given<'a>(item: &'a Item<'_>, name: &str) -> Option<&'a Literal> {
    let place = item
        .spec()
        .parameters
        .iter()
        .position(|known| known.name == name)?;
    let literal = item.parameters.get(place).copied().flatten()?;
    (literal.shape != Shape::Null).then_some(literal)
}

/// Of two parameters that exclude each other one is given at most.
pub fn parameters_do_not_contradict(net: Typed<'_>, faults: &mut Vec<Diagnostic>) {
    for item in &net.graph.items {
        let takes = |name: &str| item.spec().parameters.iter().any(|it| it.name == name);
        // `to` of other motions is a pose.
        let is_joints = takes("pose");
        for (first, second, why) in EITHER {
            if first == "to" && !is_joints {
                continue;
            }
            let (Some(_), Some(literal)) = (given(item, first), given(item, second)) else {
                continue;
            };
            let message = format!("`{}` has `{first}` and `{second}`: {why}", item.id());
            let fault = Diagnostic::error(fault::CONTRADICTION, literal.span, message);
            faults.push(fault.help(format!("take `{first}` or `{second}` out")));
        }
    }
}

/// A motion to joints or to a pose has one of them.
pub fn motions_have_an_end(net: Typed<'_>, faults: &mut Vec<Diagnostic>) {
    for item in &net.graph.items {
        if item.spec().name != "JointMotion"
            || ["to", "pose"]
                .iter()
                .any(|name| given(item, name).is_some())
        {
            continue;
        }
        let message = format!("`{}` needs the parameter `to` or `pose`", item.id());
        let span = item.primitive.type_name.span;
        let fault = Diagnostic::error(fault::MISSING_PARAMETER, span, message);
        faults.push(fault.help("add `to`, the joints at the end, or `pose`, the flange there"));
    }
}
