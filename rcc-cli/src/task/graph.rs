//! A task as a diagram: its nets are boxes, and its rules are links from what their conditions look at to the nets that
//! they stop, cancel and start. It is drawn by the same code as the primitives of a net. Pure.

use std::borrow::Cow;

use rcc_api::bodies::{CommandList, CommandRef};
use rcc_core::types::Store;
use rcc_language::condition::{self, ConditionTerm};
use rcc_language::structure::{
    LinkInfo, NetStructure, PortInfo, PrimitiveInfo, PrimitiveRole, SourceInfo,
};

use super::TaskFile;

/// Returns the structure of a task; `names` are the names of its nets in the order of the file.
#[must_use]
pub fn structure(task: &TaskFile, names: &[String]) -> NetStructure {
    let mut parts: Vec<PrimitiveInfo> = names.iter().map(|name| part(task, name)).collect();
    for rule in &task.rules {
        let terms = condition::parse(&rule.when).unwrap_or_default();
        let looked_at: Vec<LinkInfo> = terms
            .iter()
            .filter_map(|term| link(&mut parts, names, term))
            .collect();
        let title = rule.name.as_deref().unwrap_or(&rule.when);
        for (what, list) in [
            ("start", &rule.start),
            ("stop", &rule.stop),
            ("cancel", &rule.cancel),
        ] {
            for target in places(names, list) {
                let sources = looked_at.iter().map(|link| {
                    // A link back to an earlier net is drawn like a delayed one.
                    let delayed = link.primitive >= target;
                    SourceInfo::Link(LinkInfo {
                        delayed,
                        ..link.clone()
                    })
                });
                let mut sources: Vec<SourceInfo> = sources.collect();
                if sources.is_empty() {
                    sources.push(SourceInfo::Constant(rule.when.clone()));
                }
                let input = port(format!("{what}: {title}"), &rule.when, sources);
                if let Some(part) = parts.get_mut(target) {
                    part.inputs.push(input);
                }
            }
        }
    }
    NetStructure {
        net: task.name.clone(),
        description: task.description.clone(),
        order: (0..parts.len()).collect(),
        primitives: parts,
    }
}

fn part(task: &TaskFile, name: &str) -> PrimitiveInfo {
    let first = task.start.iter().any(|start| start == name);
    PrimitiveInfo {
        id: name.to_owned(),
        type_name: if first { "starts first" } else { "net" },
        role: match first {
            true => PrimitiveRole::Input,
            false => PrimitiveRole::Plain,
        },
        device: None,
        parameters: Vec::new(),
        inputs: Vec::new(),
        outputs: Vec::new(),
        active: Vec::new(),
        null: None,
        null_words: "",
    }
}

fn port(name: String, type_name: &str, sources: Vec<SourceInfo>) -> PortInfo {
    PortInfo {
        name: Cow::Owned(name),
        type_name: type_name.to_owned(),
        unit: None,
        store: Store::Bool,
        slot: 0,
        width: 1,
        sources,
        null: None,
    }
}

fn places(names: &[String], list: &CommandList) -> Vec<usize> {
    let names = list.commands().iter().filter_map(|command| match command {
        CommandRef::Name(name) => names.iter().position(|known| known == name),
        CommandRef::Id(_) => None,
    });
    names.collect()
}

/// The link from what a term looks at; adds the output if it is new.
fn link(parts: &mut [PrimitiveInfo], names: &[String], term: &ConditionTerm) -> Option<LinkInfo> {
    let command = term.command()?;
    let primitive = names.iter().position(|known| known == command)?;
    let shown = match term {
        ConditionTerm::Outcome { outcome, .. } => outcome.clone(),
        ConditionTerm::Reason { reason, .. } => reason.name().to_owned(),
        ConditionTerm::State { state, .. } => state.name().to_owned(),
        ConditionTerm::Value {
            primitive, port, ..
        }
        | ConditionTerm::Compare {
            primitive, port, ..
        } => format!("{primitive}.{port}"),
        _ => return None,
    };
    let outputs = &mut parts.get_mut(primitive)?.outputs;
    let known = outputs.iter().position(|output| output.name == shown);
    let output = known.unwrap_or_else(|| {
        outputs.push(port(shown, "", Vec::new()));
        outputs.len() - 1
    });
    Some(LinkInfo {
        primitive,
        output,
        part: None,
        delayed: false,
        initial: None,
    })
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    #[test]
    fn rules_are_links_between_nets() {
        let text = "\
task: pick
nets: {down: a.yaml, up: b.yaml}
start: down
rules:
  - {name: lift, when: down.outcome == touched and not up.t.out, start: up}
  - {when: up.reason == finished, start: down}
  - {when: 'true', cancel: up}
";
        let task = TaskFile::of("t.yaml", text, Path::new("")).expect("valid");
        let names = ["down".to_owned(), "up".to_owned()];
        let drawn = structure(&task, &names);
        let [down, up] = &drawn.primitives[..] else {
            panic!("{drawn:?}")
        };
        assert_eq!(
            (down.outputs[0].name.as_ref(), up.outputs.len()),
            ("touched", 2)
        );
        assert_eq!(up.inputs[0].name, "start: lift");
        assert_eq!(up.inputs[0].sources.len(), 2);
        assert_eq!(up.inputs[1].name, "cancel: true");
        let SourceInfo::Link(back) = &down.inputs[0].sources[0] else {
            panic!("{down:?}")
        };
        assert!(back.delayed);
        let svg =
            rcc_graph::scene::scene(&drawn, None).map(|scene| rcc_graph::svg::svg(&drawn, &scene));
        assert!(svg.expect("few boxes").contains("touched"));
    }
}
