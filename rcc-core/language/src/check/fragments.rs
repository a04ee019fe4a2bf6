//! Rules of fragments that need the flat net: what they say of their inputs holds in each instance, and conditions can
//! make null what they leave out.
//! The loader's threads.

use rcc_config::diagnostic::Diagnostic;
use rcc_core::types::Type;

use super::Typed;
use crate::fault;
use crate::resolve::{Feed, Wire};
use crate::syntax::literal::Shape;

/// An input of a fragment has the type and unit that its places have.
pub fn inputs_are_as_fragments_say(net: Typed<'_>, faults: &mut Vec<Diagnostic>) {
    for pin in &net.graph.pins {
        let Some(item) = net.graph.items.get(pin.item) else {
            continue;
        };
        let Some(port) = item.spec().inputs.get(pin.input) else {
            continue;
        };
        let (id, name, input) = (item.id(), port.name, &pin.said.name);
        let ty = net.inferred.port_type(net.graph, pin.item, port.ty);
        if let (Some(have), Some((want, span))) = (ty, pin.said.ty)
            && have != want
        {
            let message = format!(
                "type mismatch: `{input}` is said to be a {want}, and feeds `{id}.{name}`, which is a {have}"
            );
            faults.push(Diagnostic::error(fault::TYPE_MISMATCH, span, message));
            continue;
        }
        let unit = net.inferred.port_unit(net.graph, pin.item, port.unit);
        if let (Some(have), Some((want, span))) = (unit, pin.said.unit)
            && have != want
        {
            let message = format!(
                "unit mismatch: `{input}` is said to be in {want}, and feeds `{id}.{name}`, which is in {have}"
            );
            faults.push(Diagnostic::error(fault::UNIT_MISMATCH, span, message));
        }
    }
}

/// The condition of a region is a truth value.
pub fn conditions_are_truth_values(net: Typed<'_>, faults: &mut Vec<Diagnostic>) {
    for region in &net.graph.regions {
        let (span, have) = match &region.condition {
            Feed::Wire(wire) => {
                let ty = net.inferred.wire_type(net.graph, wire);
                let output = net.inferred.output_type(net.graph, wire.from);
                let name = net.graph.output_name(wire.from);
                match (ty, output) {
                    (Some(Type::Bool), _) | (None, None) => continue,
                    (Some(ty), _) => (wire.span, format!("`{name}` is a {ty}")),
                    (None, Some(ty)) => (
                        wire.span,
                        format!("`{name}` is a {ty} without this element"),
                    ),
                }
            }
            Feed::Literal(literal) => match literal.shape {
                Shape::Bool(_) | Shape::Null | Shape::Refused => continue,
                _ => (literal.span, format!("this is {literal}")),
            },
            Feed::List(_) => (region.id.span, "this is a list".to_owned()),
            _ => continue,
        };
        let message = format!(
            "type mismatch: `active` of `{}` is a Bool, {have}",
            region.id.name
        );
        let fault = Diagnostic::error(fault::TYPE_MISMATCH, span, message);
        faults.push(fault.help("compare it: `{type: Greater, inputs: {a: …, b: …}}`"));
    }
}

/// What is read outside of a region is evaluated in it: a constant would be there all the time.
pub fn what_leaves_a_region_can_become_null(net: Typed<'_>, faults: &mut Vec<Diagnostic>) {
    let graph = net.graph;
    let mut judge = |reader: Option<usize>, wire: &Wire<'_>| {
        let Some(source) = graph.items.get(wire.from.item) else {
            return;
        };
        let Some(region) = source.region.filter(|_| source.entry.kernels.is_empty()) else {
            return;
        };
        if graph.is_within(reader, region) {
            return;
        }
        let name = graph.output_name(wire.from);
        let around = graph
            .regions
            .get(region)
            .map_or("", |region| &region.id.name);
        let message = format!(
            "`{name}` is never evaluated, and would not become null while `{around}` is not active"
        );
        let fault = Diagnostic::error(fault::NEVER_NULL, wire.span, message);
        faults.push(
            fault.help(
                "read it only where it stands, or take it out of what is under the condition",
            ),
        );
    };
    for item in &graph.items {
        for (_, wire) in item.wires() {
            judge(item.region, wire);
        }
    }
    for region in &graph.regions {
        if let Feed::Wire(wire) = &region.condition {
            judge(region.parent, wire);
        }
    }
}
