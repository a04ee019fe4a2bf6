//! Rules of links: nothing is forgotten, neither at an input nor at an output.
//! The loader's threads.

use std::collections::BTreeSet;

use rcc_config::diagnostic::Diagnostic;

use super::Typed;
use crate::fault;
use crate::resolve::{Feed, Output};

/// Inputs without a default are fed.
pub fn inputs_are_connected(net: Typed<'_>, faults: &mut Vec<Diagnostic>) {
    for item in &net.graph.items {
        for (feed, port) in item.inputs.iter().zip(item.spec().inputs) {
            if !matches!(feed, Feed::Missing) {
                continue;
            }
            let message = format!("the input `{}.{}` is not connected", item.id(), port.name);
            let span = item.primitive.type_name.span;
            let fault = Diagnostic::error(fault::NOT_CONNECTED, span, message);
            let doc = port.doc;
            faults.push(fault.help(format!(
                "add `{}: PRIMITIVE.PORT`, or a constant, to its inputs: {doc}",
                port.name
            )));
        }
    }
}

/// All outputs that something reads.
fn read(net: Typed<'_>) -> BTreeSet<Output> {
    let wires = net.graph.items.iter().flat_map(|item| item.wires());
    let wires = wires.map(|(_, wire)| wire);
    let regions = net.graph.regions.iter();
    let conditions = regions.filter_map(|region| match &region.condition {
        Feed::Wire(wire) => Some(wire),
        _ => None,
    });
    let read = wires.chain(conditions).map(|wire| wire.from);
    read.chain(net.graph.read_in_vain.iter().copied()).collect()
}

/// All outputs that something reads, or that are discarded on purpose.
pub(super) fn read_or_discarded(net: Typed<'_>) -> BTreeSet<Output> {
    let discarded = net.graph.discarded.iter().map(|(output, _)| *output);
    read(net).into_iter().chain(discarded).collect()
}

/// An output that nobody reads is named in `discard`, unless it is diagnostic.
pub fn outputs_are_read_or_discarded(net: Typed<'_>, faults: &mut Vec<Diagnostic>) {
    let used = read_or_discarded(net);
    for (number, item) in net.graph.items.iter().enumerate() {
        let forgotten: Vec<String> = item
            .spec()
            .outputs
            .iter()
            .enumerate()
            .filter(|(port, spec)| {
                let output = Output {
                    item: number,
                    port: *port,
                };
                !spec.diagnostic && !used.contains(&output)
            })
            .map(|(_, spec)| format!("{}.{}", item.id(), spec.name))
            .collect();
        let list = forgotten.join(", ");
        let message = match forgotten.len() {
            0 => continue,
            1 => format!("the output `{list}` is neither read nor discarded"),
            _ => format!("the outputs {list} are neither read nor discarded"),
        };
        let fault = Diagnostic::error(fault::NOT_READ, item.primitive.id.span, message);
        faults.push(fault.help(format!(
            "connect them, or say that nobody needs them: `discard: [{list}]`"
        )));
    }
}

/// What is discarded is not read, and is named once.
pub fn discards_are_sensible(net: Typed<'_>, faults: &mut Vec<Diagnostic>) {
    let read = read(net);
    let mut seen = BTreeSet::new();
    for (output, span) in &net.graph.discarded {
        let name = net.graph.output_name(*output);
        if !seen.insert(*output) {
            let message = format!("`{name}` is discarded twice");
            faults.push(Diagnostic::error(fault::BAD_DISCARD, *span, message));
        } else if read.contains(output) {
            let message = format!("`{name}` is discarded and read");
            let fault = Diagnostic::error(fault::DISCARDED_BUT_READ, *span, message);
            faults.push(fault.help("take it out of `discard`"));
        }
    }
}
