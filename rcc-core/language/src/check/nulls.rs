//! Rules about values that are null in every cycle. Runs on the loader's threads.

use rcc_config::diagnostic::Diagnostic;
use rcc_core::primitive::Spec;

use crate::codes;
use crate::infer::Typed;
use crate::null_analysis::find_always_null;
use crate::resolve::InputSource;

/// Requires that a command can have a value: one that is null in every cycle commands nothing, and its net would run, or
/// wait for ever, without moving anything. Constants are checked by `commands_are_not_null`.
pub fn commands_can_become_known(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    let mut items = net.graph.items_of(Spec::commands_device).peekable();
    if items.peek().is_none() {
        return;
    }
    let nulls = find_always_null(net.graph);
    for (_, item) in items {
        for (number, port) in item.spec().inputs.iter().enumerate() {
            let Some(why) = nulls.why_input(net.graph, item, number) else {
                continue;
            };
            let span = match item.inputs.get(number) {
                Some(InputSource::Link(link)) => link.span,
                Some(InputSource::List(list)) => list.span,
                _ => item.primitive.id.span,
            };
            let (id, name) = (item.id(), port.name);
            let message = format!(
                "`{id}.{name}` is always null, so nothing would be commanded: {why} → {id}"
            );
            diagnostics.push(Diagnostic::error(codes::ALWAYS_NULL, span, message));
        }
    }
}
