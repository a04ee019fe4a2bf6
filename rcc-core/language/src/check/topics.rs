//! Rules about topics that can be checked within one net. What other nets publish is checked when the net starts. Runs
//! on the loader's threads.

use std::collections::BTreeMap;

use rcc_config::diagnostic::Diagnostic;
use rcc_core::primitive::{ParameterKind, Role};
use rcc_core::types::Type;
use rcc_core::unit::Unit;

use super::has_parameter;
use crate::codes;
use crate::infer::Typed;
use crate::resolve::ResolvedPrimitive;

fn items(net: Typed<'_>, role: Role) -> impl Iterator<Item = (&ResolvedPrimitive<'_>, &str)> {
    let items = net.graph.items_of(move |spec| spec.role == role);
    items.filter_map(|(_, item)| Some((item, item.topic()?)))
}

/// Requires that a topic is published once.
pub fn topics_are_published_once(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    let mut publishers: BTreeMap<&str, &ResolvedPrimitive<'_>> = BTreeMap::new();
    for (item, topic) in items(net, Role::Publish) {
        if let Some(first) = publishers.get(topic) {
            let message = format!(
                "`{}` publishes `{topic}`, which `{}` already publishes",
                item.id(),
                first.id()
            );
            let diagnostic =
                Diagnostic::error(codes::CLAIMED_TWICE, item.primitive.id.span, message);
            let help = "give one of them another topic; an instance of a fragment gets its topic as a parameter";
            diagnostics.push(diagnostic.help(help));
            continue;
        }
        publishers.insert(topic, item);
    }
}

/// Requires that all uses of a topic agree in type and unit.
pub fn topics_are_of_one_type(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    let mut kinds: BTreeMap<&str, (&ResolvedPrimitive<'_>, TopicSignature)> = BTreeMap::new();
    for (number, item) in net
        .graph
        .items_of(|spec| has_parameter(spec, ParameterKind::Topic))
    {
        let (Some(port), Some(topic)) = (item.spec().outputs.first(), item.topic()) else {
            continue;
        };
        let slot = net.inferred.port_type(net.graph, number, port.ty);
        let unit = net.inferred.port_unit(net.graph, number, port.unit);
        let kind = (slot, unit);
        let (first, other) = *kinds.entry(topic).or_insert((item, kind));
        if kind != other && first.spec().role == item.spec().role {
            let message = format!(
                "`{}` uses {} for topic `{topic}`, but `{}` uses {}",
                item.id(),
                describe_signature(kind),
                first.id(),
                describe_signature(other)
            );
            let diagnostic =
                Diagnostic::error(codes::TYPE_MISMATCH, item.primitive.id.span, message);
            diagnostics
                .push(diagnostic.help("one net publishes a topic, with one type and one unit"));
        }
    }
}

/// Type and unit of a topic.
type TopicSignature = (Option<Type>, Option<Unit>);

fn describe_signature((ty, unit): TopicSignature) -> String {
    let ty = ty.map_or("something".to_owned(), |ty| ty.to_string());
    match unit.filter(|unit| *unit != Unit::ONE) {
        Some(unit) => format!("{ty} in {unit}"),
        None => ty,
    }
}

/// Requires that a net does not subscribe to its own topics: within a net there are links.
pub fn no_net_subscribes_to_itself(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    let mut publishers = BTreeMap::new();
    for (item, topic) in items(net, Role::Publish) {
        publishers.entry(topic).or_insert(item);
    }
    for (item, topic) in items(net, Role::Input) {
        if let Some(own) = publishers.get(topic) {
            let message = format!(
                "`{}` subscribes to `{topic}`, which `{}` of the same net publishes",
                item.id(),
                own.id()
            );
            let span = item.topic_literal().map(|(_, span)| span);
            let span = span.unwrap_or(item.primitive.id.span);
            let diagnostic = Diagnostic::error(codes::OWN_TOPIC, span, message);
            let help = format!(
                "within a net, use a link: `{{from: {}.out, delayed: true, initial: …}}`",
                own.id()
            );
            diagnostics.push(diagnostic.help(help));
        }
    }
}
