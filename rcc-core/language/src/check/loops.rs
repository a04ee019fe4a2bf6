//! Rules about loops. Values propagate through the whole net within one cycle, so every loop contains a delayed link,
//! that link has an initial value, and a null value cannot stay in the loop forever.
//!
//! The rule about null, precisely: take a loop (primitives that depend on each other, delayed links included), let
//! every value in it be null, and let every value from outside be known. Primitives become known by their null rules
//! (`rcc_core::primitive::NullRule`): one that propagates null becomes known only if all its inputs are known, `OrElse`
//! if one input is, `Select` if its condition and one of its values are, `IsNull` and motions always. If a loop of null
//! primitives remains at the fixpoint, the net is refused: once null, the loop would stay null. The constant null never
//! becomes known. Runs on the loader's threads.

use rcc_config::diagnostic::Diagnostic;
use rcc_core::primitive::{DefaultValue as Default, NullRule};

use crate::adjacency::Adjacency;
use crate::codes;
use crate::components::{Components, circle};
use crate::infer::Typed;
use crate::resolve::{InputSource, ListElement, NetGraph, ResolvedLink, ResolvedPrimitive};
use crate::syntax::literal::LiteralShape;

/// Most links of a loop that a message names.
const NAMED_MAX: usize = 12;

/// Returns, by item, the items that it reads from.
fn sources(graph: &NetGraph<'_>, keep: impl Fn(usize, &ResolvedLink<'_>) -> bool) -> Adjacency {
    let keep = &keep;
    let items = graph.items.iter().enumerate();
    let sources = items.map(|(number, item)| {
        let links = graph.dependencies(item);
        let links = links.filter(move |(_, link)| keep(number, link));
        links.map(|(_, link)| link.from.item)
    });
    sources.collect()
}

/// Describes a cycle in the direction of its values, and returns the link that closes it.
fn describe<'g>(
    graph: &'g NetGraph<'_>,
    circle: &[usize],
) -> Option<(String, &'g ResolvedLink<'g>)> {
    let mut parts = Vec::new();
    let mut closing = None;
    for (place, number) in circle.iter().enumerate() {
        let next = circle.get(place + 1).or(circle.first())?;
        let item = graph.items.get(*next)?;
        let mut links = graph.dependencies(item);
        let (input, link) = links.find(|(_, link)| link.from.item == *number)?;
        let delayed = if link.delayed { " (delayed)" } else { "" };
        parts.push(format!(
            "`{}` → `{}.{input}`{delayed}",
            graph.output_name(link.from),
            item.id()
        ));
        closing = Some(link);
    }
    if parts.len() > NAMED_MAX {
        let count = parts.len() - NAMED_MAX;
        parts.truncate(NAMED_MAX);
        parts.push(format!("and {count} more links back to the start"));
    }
    Some((parts.join(", "), closing?))
}

/// Requires that every loop contains a delayed link.
pub fn loops_have_a_delay(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    // Values that flow in the order of the text do not flow in a circle; most nets are written so.
    let mut items = net.graph.items.iter().enumerate();
    if items.all(|(number, item)| {
        let mut links = net.graph.dependencies(item);
        links.all(|(_, link)| link.delayed || link.from.item < number)
    }) {
        return;
    }
    let sources = sources(net.graph, |_, link| !link.delayed);
    for component in Components::of(&sources).loops(&sources) {
        let Some((path, link)) = describe(net.graph, &circle(&sources, &component)) else {
            continue;
        };
        let message = format!("loop without a delayed link: {path}");
        let from = net.graph.output_name(link.from);
        let diagnostic = Diagnostic::error(codes::LOOP_WITHOUT_DELAY, link.span, message);
        diagnostics.push(diagnostic.label("closes the loop").help(format!(
            "delay one of these links by a cycle: `{{from: {from}, delayed: true, initial: …}}`"
        )));
    }
}

/// Requires that a delayed link within a loop has an initial value.
pub fn delayed_loops_have_an_initial_value(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    if !has_link(net.graph, |link| link.delayed && link.initial.is_none()) {
        return;
    }
    let sources = sources(net.graph, |_, _| true);
    let components = Components::of(&sources);
    for (number, item) in net.graph.items.iter().enumerate() {
        for (input, link) in net.graph.dependencies(item) {
            let closes = components.same(number, link.from.item);
            if !link.delayed || link.initial.is_some() || !closes {
                continue;
            }
            let from = net.graph.output_name(link.from);
            let message = format!(
                "the delayed link `{from}` → `{}.{input}` closes a loop and has no initial value",
                item.id()
            );
            let diagnostic = Diagnostic::error(codes::LOOP_WITHOUT_INITIAL, link.span, message);
            diagnostics.push(diagnostic.help(format!(
                "give its value in the first cycle: `{{from: {from}, delayed: true, initial: …}}`"
            )));
        }
    }
}

/// Requires that a null value in a loop can be replaced by a known one.
pub fn loops_can_recover_from_null(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    // A loop without a delayed link is reported by another rule.
    if !has_link(net.graph, |link| link.delayed) {
        return;
    }
    let all = sources(net.graph, |_, _| true);
    let components = Components::of(&all);
    let is_in_loop = components.in_loops(&all);
    if !is_in_loop.contains(&true) {
        return;
    }
    let mut known: Vec<bool> = is_in_loop.iter().map(|is_in_loop| !is_in_loop).collect();
    settle(net.graph, &components, &all, &mut known);
    if !known.contains(&false) {
        return;
    }
    let stuck = |number: usize| known.get(number) == Some(&false);
    let null = sources(net.graph, |number, link| {
        stuck(number) && stuck(link.from.item) && components.same(number, link.from.item)
    });
    for component in Components::of(&null).loops(&null) {
        let Some((path, link)) = describe(net.graph, &circle(&null, &component)) else {
            continue;
        };
        let delayed = circle(&null, &component);
        if !has_delay(net.graph, &delayed) {
            continue;
        }
        let message = format!("this loop could never recover from null: {path}");
        let diagnostic = Diagnostic::error(codes::LOOP_STAYS_NULL, link.span, message);
        diagnostics.push(
            diagnostic.help(
                "insert an OrElse into the loop: `{type: OrElse, inputs: {in: …, other: 0}}`",
            ),
        );
    }
}

/// Returns true if `is_one` is true for a link or condition of the net.
fn has_link(graph: &NetGraph<'_>, is_one: impl Fn(&ResolvedLink<'_>) -> bool) -> bool {
    let mut links = graph.items.iter().flat_map(|item| graph.dependencies(item));
    links.any(|(_, link)| is_one(link))
}

fn has_delay(graph: &NetGraph<'_>, circle: &[usize]) -> bool {
    let mut links = circle.iter().enumerate().flat_map(|(place, number)| {
        let next = circle.get(place + 1).or(circle.first());
        let item = next.and_then(|next| graph.items.get(*next));
        let links = item.into_iter().flat_map(|item| graph.dependencies(item));
        links.filter(move |(_, link)| link.from.item == *number)
    });
    links.any(|(_, link)| link.delayed)
}

/// Marks items as known until a fixpoint is reached; linear in the number of links.
fn settle(graph: &NetGraph<'_>, components: &Components, sources: &Adjacency, known: &mut [bool]) {
    let readers = sources.reversed(sources.count());
    let is_open = |number: &usize| known.get(*number) == Some(&false);
    let mut queue: Vec<usize> = (0..graph.items.len()).filter(is_open).collect();
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
            queue.extend(readers.of(number));
        }
    }
}

fn becomes_known(
    graph: &NetGraph<'_>,
    item: &ResolvedPrimitive<'_>,
    number: usize,
    components: &Components,
    known: &[bool],
) -> bool {
    let link_known = |link: &ResolvedLink<'_>| {
        let source = link.from.item;
        // A value from another loop counts as known: that loop is reported itself.
        !components.same(number, source) || known.get(source) == Some(&true)
    };
    let element = |element: &ListElement<'_>| match element {
        ListElement::Link(link) => link_known(link),
        ListElement::Literal(literal, _) => literal.shape != LiteralShape::Null,
    };
    let input = |input_source: &InputSource<'_>| match input_source {
        InputSource::Link(link) => link_known(link),
        InputSource::List(list) => list.elements.iter().all(element),
        InputSource::Outcomes(outcomes) => outcomes.conditions.iter().all(element),
        InputSource::Literal(literal) => literal.shape != LiteralShape::Null,
        InputSource::Default(value) => *value != Default::Null,
        InputSource::Missing | InputSource::Refused => true,
    };
    // An item in a region is null as long as the condition is null.
    if !graph
        .regions_of(item)
        .all(|region| input(&region.condition))
    {
        return false;
    }
    let mut inputs = item.inputs.iter().map(input);
    match item.spec().null_rule {
        NullRule::Known => true,
        NullRule::Remembers => item.has_known_initial_value() || inputs.all(|known| known),
        NullRule::Propagates => inputs.all(|known| known),
        NullRule::AnyKnown => inputs.any(|known| known),
        NullRule::FirstAndAnyKnown => inputs.next() == Some(true) && inputs.any(|known| known),
    }
}
