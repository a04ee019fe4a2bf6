//! Rules of fragments that need the flat net: what they say of their inputs holds in each instance.
//! The loader's threads.

use rcc_config::diagnostic::Diagnostic;

use super::Typed;
use crate::fault;

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
