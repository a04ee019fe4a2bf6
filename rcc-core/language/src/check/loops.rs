//! Rules of loops: values propagate through the whole net within one cycle, so every loop contains a delayed link, that
//! link has a first value, and the loop can lose null again.
//!
//! The rule for null, exactly: take a loop (primitives that depend on each other, delayed links included) in which every
//! value is null while everything that comes from outside of it is known. Primitives become known by their null rules
//! (`rcc_core::primitive::NullRule`): one that propagates null only if all its inputs are known; `OrElse` if one input
//! is; `Select` if its condition and one of its values are; `IsNull` and motions always. When nothing changes any more,
//! a loop of primitives that are still null is refused: null, once in, would stay for ever. The constant null never
//! becomes known. The loader's threads.

pub(crate) mod components;

use rcc_config::diagnostic::Diagnostic;
use rcc_core::primitive::{Literal as Default, NullRule};

use super::Typed;
use crate::fault;
use crate::resolve::{Feed, Graph, Item, Leaf, Wire};
use crate::syntax::literal::Shape;
use components::{Components, circle};

/// Most links of a loop that are named.
const NAMED_MAX: usize = 12;

/// By item: the items that it reads from.
fn sources(graph: &Graph<'_>, keep: impl Fn(usize, &Wire<'_>) -> bool) -> Vec<Vec<usize>> {
    let of = |(number, item): (usize, &Item<'_>)| {
        let wires = graph.links(item).filter(|(_, wire)| keep(number, wire));
        wires.map(|(_, wire)| wire.from.item).collect()
    };
    graph.items.iter().enumerate().map(of).collect()
}

/// Names a circle in the direction of its values, and the link that closes it.
fn describe<'g>(graph: &'g Graph<'_>, circle: &[usize]) -> Option<(String, &'g Wire<'g>)> {
    let mut parts = Vec::new();
    let mut closing = None;
    for (place, number) in circle.iter().enumerate() {
        let next = circle.get(place + 1).or(circle.first())?;
        let item = graph.items.get(*next)?;
        let mut links = graph.links(item);
        let (input, wire) = links.find(|(_, wire)| wire.from.item == *number)?;
        let delayed = if wire.delayed { " (delayed)" } else { "" };
        parts.push(format!(
            "`{}` → `{}.{input}`{delayed}",
            graph.output_name(wire.from),
            item.id()
        ));
        closing = Some(wire);
    }
    if parts.len() > NAMED_MAX {
        let count = parts.len() - NAMED_MAX;
        parts.truncate(NAMED_MAX);
        parts.push(format!("and {count} more links back to the beginning"));
    }
    Some((parts.join(", "), closing?))
}

/// Every loop contains a delayed link.
pub fn loops_have_a_delay(net: Typed<'_>, faults: &mut Vec<Diagnostic>) {
    let sources = sources(net.graph, |_, wire| !wire.delayed);
    for component in Components::of(&sources).loops(&sources) {
        let Some((path, wire)) = describe(net.graph, &circle(&sources, &component)) else {
            continue;
        };
        let message = format!("these primitives wait for each other: {path}");
        let from = net.graph.output_name(wire.from);
        let fault = Diagnostic::error(fault::LOOP_WITHOUT_DELAY, wire.span, message);
        faults.push(fault.label("closes the loop").help(format!(
            "let one of these links carry the value of the cycle before: `{{from: {from}, delayed: true, initial: …}}`"
        )));
    }
}

/// A delayed link within a loop has a first value.
pub fn delayed_loops_have_a_first_value(net: Typed<'_>, faults: &mut Vec<Diagnostic>) {
    let sources = sources(net.graph, |_, _| true);
    let components = Components::of(&sources);
    for (number, item) in net.graph.items.iter().enumerate() {
        for (input, wire) in net.graph.links(item) {
            let closes = components.same(number, wire.from.item);
            if !wire.delayed || wire.initial.is_some() || !closes {
                continue;
            }
            let from = net.graph.output_name(wire.from);
            let message = format!(
                "the delayed link `{from}` → `{}.{input}` closes a loop and has no first value",
                item.id()
            );
            let fault = Diagnostic::error(fault::LOOP_WITHOUT_INITIAL, wire.span, message);
            faults.push(fault.help(format!("say what it carries in the first cycle: `{{from: {from}, delayed: true, initial: …}}`")));
        }
    }
}

/// No loop keeps null for ever.
pub fn loops_can_lose_null(net: Typed<'_>, faults: &mut Vec<Diagnostic>) {
    let all = sources(net.graph, |_, _| true);
    let components = Components::of(&all);
    let in_loop = components.in_loops(&all);
    let mut known: Vec<bool> = in_loop.iter().map(|in_loop| !in_loop).collect();
    settle(net.graph, &components, &all, &mut known);
    let stuck = |number: usize| known.get(number) == Some(&false);
    let null = sources(net.graph, |number, wire| {
        stuck(number) && stuck(wire.from.item) && components.same(number, wire.from.item)
    });
    for component in Components::of(&null).loops(&null) {
        let Some((path, wire)) = describe(net.graph, &circle(&null, &component)) else {
            continue;
        };
        // Without a delayed link this is another fault, which is reported.
        let delayed = circle(&null, &component);
        if !has_delay(net.graph, &delayed) {
            continue;
        }
        let message = format!("null, once in this loop, would stay for ever: {path}");
        let fault = Diagnostic::error(fault::NULL_FOR_EVER, wire.span, message);
        faults.push(
            fault.help("lead the loop through OrElse: `{type: OrElse, inputs: {in: …, other: 0}}`"),
        );
    }
}

fn has_delay(graph: &Graph<'_>, circle: &[usize]) -> bool {
    let mut links = circle.iter().enumerate().flat_map(|(place, number)| {
        let next = circle.get(place + 1).or(circle.first());
        let item = next.and_then(|next| graph.items.get(*next));
        let wires = item.into_iter().flat_map(|item| graph.links(item));
        wires.filter(move |(_, wire)| wire.from.item == *number)
    });
    links.any(|(_, wire)| wire.delayed)
}

/// Lets items become known until nothing changes; linear in the number of links.
fn settle(graph: &Graph<'_>, components: &Components, sources: &[Vec<usize>], known: &mut [bool]) {
    let mut readers = vec![Vec::new(); graph.items.len()];
    for (number, sources) in sources.iter().enumerate() {
        for source in sources {
            if let Some(readers) = readers.get_mut(*source) {
                readers.push(number);
            }
        }
    }
    let mut queue: Vec<usize> = (0..graph.items.len()).collect();
    while let Some(number) = queue.pop() {
        let Some(item) = graph.items.get(number) else {
            continue;
        };
        if known.get(number) == Some(&false)
            && becomes_known(graph, item, number, components, known)
        {
            if let Some(known) = known.get_mut(number) {
                *known = true;
            }
            queue.extend(readers.get(number).into_iter().flatten());
        }
    }
}

fn becomes_known(
    graph: &Graph<'_>,
    item: &Item<'_>,
    number: usize,
    components: &Components,
    known: &[bool],
) -> bool {
    let wire_known = |wire: &Wire<'_>| {
        let source = wire.from.item;
        // What comes from another loop counts as known: its own fault is reported there.
        !components.same(number, source) || known.get(source) == Some(&true)
    };
    let input = |feed: &Feed<'_>| match feed {
        Feed::Wire(wire) => wire_known(wire),
        Feed::List(list) => list.leaves.iter().all(|leaf| match leaf {
            Leaf::Wire(wire) => wire_known(wire),
            Leaf::Literal(literal, _) => literal.shape != Shape::Null,
        }),
        Feed::Literal(literal) => literal.shape != Shape::Null,
        Feed::Default(value) => *value != Default::Null,
        Feed::Missing | Feed::Refused => true,
    };
    // What is evaluated under a condition is null until that is known.
    if !graph
        .conditions(item)
        .all(|region| input(&region.condition))
    {
        return false;
    }
    let mut inputs = item.inputs.iter().map(input);
    match item.spec().null_rule {
        NullRule::Known => true,
        NullRule::Remembers => item.begins_known() || inputs.all(|known| known),
        NullRule::Propagates => inputs.all(|known| known),
        NullRule::AnyKnown => inputs.any(|known| known),
        NullRule::FirstAndAnyKnown => inputs.next() == Some(true) && inputs.any(|known| known),
    }
}
