//! `topics`: lists the topics that connect nets, with their publishers and subscribers.

use rcc_api::bodies::{TopicEnd, TopicView};

use crate::context::Context;
use crate::failure::Failure;
use crate::table;

/// Arguments of `topics`.
#[derive(clap::Args, Debug)]
pub struct Arguments {}

/// Runs the verb.
///
/// # Errors
/// Fails if the loader cannot be reached.
pub fn run(context: &Context, _arguments: Arguments) -> Result<(), Failure> {
    let topics: Vec<TopicView> = context.client()?.get("/topics")?;
    context.print(&topics, |topics| list(topics));
    Ok(())
}

fn list(topics: &[TopicView]) -> String {
    if topics.is_empty() {
        return "no loaded net publishes or subscribes to a topic".to_owned();
    }
    let mut rows = table::table(&["TOPIC", "TYPE", "UNIT", "PUBLISHED BY", "SUBSCRIBED BY"]);
    for topic in topics {
        rows.add_row([
            topic.topic.clone(),
            topic.ty.clone(),
            topic.unit.clone().unwrap_or_default(),
            ends(&topic.publishers),
            ends(&topic.subscribers),
        ]);
    }
    table::text(&rows)
}

/// Formats publishers or subscribers as `guard#3 force (running)`, one per line.
fn ends(ends: &[TopicEnd]) -> String {
    if ends.is_empty() {
        return "nobody".to_owned();
    }
    let lines = ends
        .iter()
        .map(|end| format!("{}#{} {} ({})", end.net, end.id, end.primitive, end.state));
    lines.collect::<Vec<_>>().join("\n")
}
