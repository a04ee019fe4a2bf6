//! Rules about links: every input is connected, and every output is read or discarded. Runs on the loader's threads.

use std::collections::BTreeSet;

use rcc_config::diagnostic::Diagnostic;
use rcc_core::primitive::Role;

use crate::codes;
use crate::infer::Typed;
use crate::resolve::{InputSource, OutputId};

/// Requires that inputs without a default are connected.
pub fn inputs_are_connected(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    for item in &net.graph.items {
        for (input_source, port) in item.inputs.iter().zip(item.spec().inputs) {
            if !matches!(input_source, InputSource::Missing) {
                continue;
            }
            let message = format!("the input `{}.{}` is not connected", item.id(), port.name);
            let span = item.primitive.type_name.span;
            let diagnostic = Diagnostic::error(codes::NOT_CONNECTED, span, message);
            let doc = port.doc;
            diagnostics.push(diagnostic.help(format!(
                "add `{}: PRIMITIVE.PORT`, or a constant, to its inputs: {doc}",
                port.name
            )));
        }
    }
}

/// A set of outputs of a net.
#[derive(Clone)]
pub(super) struct OutputSet {
    /// Place of the first output of an item, by item; then the number of all places.
    first: Vec<usize>,
    /// Whether an output is in the set, by its place.
    has: Vec<bool>,
}

impl OutputSet {
    fn of(net: Typed<'_>, outputs: impl IntoIterator<Item = OutputId>) -> OutputSet {
        let (mut first, mut count) = (vec![0], 0);
        for item in &net.graph.items {
            count += item.spec().outputs.len();
            first.push(count);
        }
        let has = vec![false; count];
        let mut set = OutputSet { first, has };
        set.extend(outputs);
        set
    }

    fn extend(&mut self, outputs: impl IntoIterator<Item = OutputId>) {
        for output in outputs {
            let first = self.first.get(output.item).copied();
            if let Some(has) = first.and_then(|first| self.has.get_mut(first + output.port)) {
                *has = true;
            }
        }
    }

    /// Returns, by output of an item, whether it is in the set.
    pub(super) fn item(&self, number: usize) -> &[bool] {
        match self.first.get(number..) {
            Some([first, end, ..]) => self.has.get(*first..*end).unwrap_or(&[]),
            _ => &[],
        }
    }

    fn contains(&self, output: OutputId) -> bool {
        self.item(output.item).get(output.port) == Some(&true)
    }
}

/// Returns all outputs that an input or a condition reads.
fn linked(net: Typed<'_>) -> OutputSet {
    let links = net.graph.items.iter().flat_map(|item| item.links());
    let links = links.map(|(_, link)| link);
    let regions = net.graph.regions.iter();
    let conditions = regions.filter_map(|region| match &region.condition {
        InputSource::Link(link) => Some(link),
        _ => None,
    });
    OutputSet::of(net, links.chain(conditions).map(|link| link.from))
}

/// Returns all outputs that an input, a condition or something refused reads.
fn read(net: Typed<'_>) -> OutputSet {
    let mut read = linked(net);
    read.extend(net.graph.counted_as_read.iter().copied());
    read
}

/// Returns all outputs that are read or listed in `discard`.
pub(super) fn read_or_discarded(net: Typed<'_>) -> OutputSet {
    with_discarded(net, read(net))
}

fn with_discarded(net: Typed<'_>, mut used: OutputSet) -> OutputSet {
    used.extend(net.graph.discarded.iter().map(|(output, _)| *output));
    used
}

/// Requires that one output of each primitive is read, or that all are listed in `discard`: a primitive of which nothing
/// is read does nothing. Outputs that its spec marks as diagnostic need not be listed.
pub fn outputs_are_read_or_discarded(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    // An input that is not connected or a missing Termination, which are reported, may be where an output should be read.
    let mut inputs = net.graph.items.iter().flat_map(|item| &item.inputs);
    let mut terminations = net.graph.items_of(|spec| spec.role == Role::Termination);
    if inputs.any(|source| matches!(source, InputSource::Missing)) || terminations.next().is_none()
    {
        return;
    }
    let read = read(net);
    let used = with_discarded(net, read.clone());
    for (number, item) in net.graph.items.iter().enumerate() {
        if read.item(number).contains(&true) {
            continue;
        }
        let outputs = item.spec().outputs.iter().zip(used.item(number));
        let unread = outputs.filter(|(port, is_used)| !port.diagnostic && !**is_used);
        let unread: Vec<String> = unread
            .map(|(port, _)| format!("{}.{}", item.id(), port.name))
            .collect();
        let list = unread.join(", ");
        let message = match unread.len() {
            0 => continue,
            1 => format!("the output `{list}` is neither read nor discarded"),
            _ => format!("the outputs {list} are neither read nor discarded"),
        };
        let diagnostic = Diagnostic::error(codes::NOT_READ, item.primitive.id.span, message);
        diagnostics.push(diagnostic.help(format!(
            "connect them, or discard them: `discard: [{list}]`"
        )));
    }
}

/// Requires that a discarded output is not read, and is listed once.
pub fn discards_are_unread_and_unique(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    if net.graph.discarded.is_empty() {
        return;
    }
    // A refused link may mean any output of its primitive, and is reported itself.
    let read = linked(net);
    let mut seen = BTreeSet::new();
    for (output, span) in &net.graph.discarded {
        let name = net.graph.output_name(*output);
        if !seen.insert(*output) {
            let message = format!("`{name}` is discarded twice");
            diagnostics.push(Diagnostic::error(codes::BAD_DISCARD, *span, message));
        } else if read.contains(*output) {
            let message = format!("`{name}` is discarded and read");
            let diagnostic = Diagnostic::error(codes::DISCARDED_BUT_READ, *span, message);
            diagnostics.push(diagnostic.help("remove it from `discard`"));
        }
    }
}
