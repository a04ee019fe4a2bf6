//! The conditions of legs, [`Net`] → [`Net`]: `wait` and `until` in the legs of a path become the input `conditions` of
//! their `MotionSequence`, in the text's net and in all fragments. From there on they are links and formulas like those of
//! any other input. Runs on the loader's threads.

use rcc_config::diagnostic::Diagnostic;
use rcc_config::yaml::{Key, Node};

use crate::codes;
use crate::parse::literal::legs;
use crate::syntax::fragment::Fragment;
use crate::syntax::literal::{Literal, LiteralShape, Notation};
use crate::syntax::{List, Net, Primitive, PrimitiveKind, Source};

/// The type whose legs have conditions.
pub(crate) const SEQUENCE: &str = "MotionSequence";
/// Its input for them.
pub(crate) const CONDITIONS: &str = "conditions";

/// Connects the conditions of all legs.
pub fn connect(net: &mut Net, library: &mut [Fragment], diagnostics: &mut Vec<Diagnostic>) {
    let fragments = net.fragments.iter_mut().chain(library);
    let fragments = fragments.flat_map(|fragment| &mut fragment.primitives);
    for primitive in net.primitives.iter_mut().chain(fragments) {
        if primitive.kind == PrimitiveKind::Type && primitive.type_name.name == SEQUENCE {
            connect_one(primitive, diagnostics);
        }
    }
}

fn connect_one(primitive: &mut Primitive, diagnostics: &mut Vec<Diagnostic>) {
    let given = primitive
        .inputs
        .iter()
        .find(|(key, _)| key.name == CONDITIONS);
    if let Some((key, _)) = given {
        let message = format!(
            "`{CONDITIONS}` of `{}` is made from its legs",
            primitive.id.name
        );
        let diagnostic = Diagnostic::error(codes::CONTRADICTION, key.span, message);
        diagnostics.push(diagnostic.help("remove it, and give `wait` or `until` in the legs"));
        return;
    }
    let legs = primitive.parameters.iter().filter_map(|(_, literal)| {
        let nodes = legs_of(literal).filter(|nodes| legs::are_legs(nodes))?;
        Some((literal.span, legs::read_conditions(nodes, diagnostics)))
    });
    let Some((span, elements)) = legs.into_iter().find(|(_, all)| !all.is_empty()) else {
        return;
    };
    let key = Key {
        name: CONDITIONS.into(),
        span,
    };
    let list = Source::List(List { elements, span });
    primitive.inputs.push((key, list));
}

/// The legs as they are written.
fn legs_of(literal: &Literal) -> Option<&[Node]> {
    match (&literal.notation, &literal.shape) {
        (Notation::Rows(node), _) | (_, LiteralShape::Parameterised(node)) => node.list(),
        _ => None,
    }
}
