//! Analysis of a task before it runs: how each net is started, when each rule can fire, and which rules compete for a
//! net. Pure.

use rcc_api::bodies::{CommandList, CommandRef, RuleBody};
use rcc_language::condition::{self, ConditionTerm};
use serde::Serialize;

use super::TaskFile;

/// Result of the analysis for one rule.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RuleExplanation {
    /// Its name.
    pub rule: String,
    /// Its condition.
    pub when: String,
    /// When it can fire.
    pub fires: String,
    /// Consequences: the commands that it stops, cancels and starts.
    pub then: String,
    /// Notes: why it can never fire, or with which rules it competes.
    pub notes: Vec<String>,
}

/// Result of the analysis of a task.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TaskExplanation {
    /// Its name.
    pub task: String,
    /// Its description.
    pub description: String,
    /// The nets, with what starts each.
    pub nets: Vec<(String, String)>,
    /// The rules, in the order in which they fire if several are due in one cycle.
    pub rules: Vec<RuleExplanation>,
}

/// Returns the name of a rule, or its condition.
pub(super) fn title(rule: &RuleBody) -> &str {
    rule.name.as_deref().unwrap_or(&rule.when)
}

fn named(list: &CommandList) -> impl Iterator<Item = &str> {
    list.commands().iter().filter_map(|command| match command {
        CommandRef::Name(name) => Some(name.as_str()),
        CommandRef::Id(_) => None,
    })
}

/// Explains a task whose nets have these names.
#[must_use]
pub fn explain(task: &TaskFile, names: &[String]) -> TaskExplanation {
    let starters = |net: &str| {
        let first = task.start.iter().any(|start| start == net);
        let first = first.then(|| "the task".to_owned());
        let rules = task.rules.iter();
        let rules = rules.filter(|rule| named(&rule.start).any(|start| start == net));
        let rules = rules.map(|rule| format!("`{}`", title(rule)));
        first.into_iter().chain(rules).collect::<Vec<_>>()
    };
    let nets = names.iter().map(|net| {
        let by = starters(net);
        let by = match by.is_empty() {
            true => "nothing: it is never started".to_owned(),
            false => format!("started by {}", by.join(", ")),
        };
        (net.clone(), by)
    });
    let rules = task.rules.iter().map(|rule| {
        let terms = condition::parse(&rule.when).unwrap_or_default();
        let mut notes = Vec::new();
        for net in terms.iter().filter_map(ConditionTerm::command) {
            if names.iter().any(|name| name == net) && starters(net).is_empty() {
                notes.push(format!("can never fire: {net} is never started"));
            }
        }
        notes.extend(rivals(task, rule));
        RuleExplanation {
            rule: title(rule).to_owned(),
            when: rule.when.clone(),
            fires: fires(&terms),
            then: then(rule),
            notes,
        }
    });
    TaskExplanation {
        task: task.name.clone(),
        description: task.description.clone(),
        nets: nets.collect(),
        rules: rules.collect(),
    }
}

/// Rules before this one that start a net which it starts too: whichever fires first starts it.
fn rivals(task: &TaskFile, rule: &RuleBody) -> Vec<String> {
    let others = task
        .rules
        .iter()
        .take_while(|other| !std::ptr::eq(*other, rule));
    let rivals = others.filter(|other| {
        named(&other.start).any(|start| named(&rule.start).any(|own| own == start))
    });
    rivals
        .map(|other| {
            format!(
                "starts what `{}` starts: the one that fires first wins, in one cycle `{}`",
                title(other),
                title(other)
            )
        })
        .collect()
}

/// When the condition can become true.
fn fires(terms: &[ConditionTerm]) -> String {
    let mut parts: Vec<String> = Vec::new();
    for term in terms {
        let part = match term {
            ConditionTerm::True => "when it is installed".to_owned(),
            ConditionTerm::Outcome { command, .. } | ConditionTerm::Reason { command, .. } => {
                format!("in the cycle after {command} ends")
            }
            ConditionTerm::State { command, .. } => format!("when {command} changes its state"),
            ConditionTerm::Value {
                command,
                primitive,
                port,
            }
            | ConditionTerm::Compare {
                command,
                primitive,
                port,
                ..
            } => format!("in the cycle after {command} computes {primitive}.{port}"),
            ConditionTerm::Topic { topic } => format!("in the cycle after {topic} is published"),
            ConditionTerm::Not | ConditionTerm::And | ConditionTerm::Or => continue,
        };
        if !parts.contains(&part) {
            parts.push(part);
        }
    }
    parts.join("; ")
}

fn then(rule: &RuleBody) -> String {
    let lists = [
        ("stop", &rule.stop),
        ("cancel", &rule.cancel),
        ("start", &rule.start),
    ];
    let parts = lists.into_iter().filter_map(|(what, list)| {
        let names: Vec<&str> = named(list).collect();
        (!names.is_empty()).then(|| format!("{what} {}", names.join(", ")))
    });
    let record = rule.record.map(|record| match record.times {
        1 => "record an incident".to_owned(),
        times => format!("record up to {times} incidents"),
    });
    let parts = parts.chain(record);
    parts.collect::<Vec<_>>().join("; ")
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    #[test]
    fn what_can_never_fire_and_what_competes_is_said() {
        let text = "\
task: pick
nets: {down: a.yaml, up: b.yaml, lost: c.yaml}
start: down
rules:
  - {name: lift, when: down.outcome == touched, start: up}
  - {name: again, when: down.t.out or lost.reason == fault, stop: down, start: up}
";
        let task = TaskFile::of("t.yaml", text, Path::new("")).expect("valid");
        let names = ["down", "up", "lost"].map(str::to_owned);
        let said = explain(&task, &names);
        assert_eq!(said.nets[0].1, "started by the task");
        assert_eq!(said.nets[1].1, "started by `lift`, `again`");
        assert!(said.nets[2].1.contains("never started"));
        assert_eq!(said.rules[0].fires, "in the cycle after down ends");
        assert_eq!(said.rules[1].then, "stop down; start up");
        assert!(said.rules[1].notes[0].contains("lost is never started"));
        assert!(said.rules[1].notes[1].contains("`lift`"));
    }
}
