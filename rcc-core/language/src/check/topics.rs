//! Rules of values from net to net: what can be seen in one net. What other nets publish is looked at when it starts.
//! The loader's threads.

use std::collections::BTreeMap;

use rcc_config::diagnostic::Diagnostic;
use rcc_core::plan::TOPICS_MAX;
use rcc_core::primitive::Role;

use super::Typed;
use crate::fault;
use crate::resolve::Item;

fn items(net: Typed<'_>, role: Role) -> impl Iterator<Item = (&Item<'_>, &str)> {
    let items = net.graph.items.iter();
    let items = items.filter(move |item| item.spec().role == role);
    items.filter_map(|item| Some((item, item.topic()?)))
}

/// A topic has one value.
pub fn topics_are_published_once(net: Typed<'_>, faults: &mut Vec<Diagnostic>) {
    let mut publishers: BTreeMap<&str, &Item<'_>> = BTreeMap::new();
    for (item, topic) in items(net, Role::Publish) {
        if let Some(first) = publishers.get(topic) {
            let message = format!(
                "`{}` publishes `{topic}`, and `{}` does so already",
                item.id(),
                first.id()
            );
            let fault = Diagnostic::error(fault::CLAIMED_TWICE, item.primitive.id.span, message);
            let help = "give one of them another topic; an instance of a fragment gets its topic as a parameter";
            faults.push(fault.help(help));
            continue;
        }
        publishers.insert(topic, item);
    }
    for (role, what) in [(Role::Publish, "publishes"), (Role::Input, "subscribes to")] {
        if let Some((item, _)) = items(net, role).nth(TOPICS_MAX) {
            let count = items(net, role).count();
            let message = format!("the net {what} {count} topics, {TOPICS_MAX} are possible");
            let fault = Diagnostic::error(fault::NET_TOO_LARGE, item.primitive.id.span, message);
            let help = "put values that belong together into one list: `in: [a.out, b.out]`";
            faults.push(fault.label("the first one too many").help(help));
        }
    }
}

/// Within a net there are links.
pub fn no_net_subscribes_to_itself(net: Typed<'_>, faults: &mut Vec<Diagnostic>) {
    for (item, topic) in items(net, Role::Input) {
        let own = items(net, Role::Publish).find(|(_, own)| *own == topic);
        if let Some((own, _)) = own {
            let message = format!(
                "`{}` subscribes to `{topic}`, which `{}` of the same net publishes",
                item.id(),
                own.id()
            );
            let span = item.topic_literal().map(|(_, span)| span);
            let span = span.unwrap_or(item.primitive.id.span);
            let fault = Diagnostic::error(fault::OWN_TOPIC, span, message);
            let help = format!(
                "within a net values go by links: `{{from: {}.out, delayed: true, initial: …}}`",
                own.id()
            );
            faults.push(fault.help(help));
        }
    }
}
