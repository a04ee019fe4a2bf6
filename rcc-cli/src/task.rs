//! Task files: nets, the rules between them, and what starts first, in one text. Read by the main thread.

pub mod analysis;
pub mod compiled;
pub mod graph;

use std::path::Path;

use rcc_api::bodies::{CommandRef, RuleBody};
use rcc_api::codes;
use rcc_api::compile::{self, findings};
use rcc_config::diagnostic::{Diagnostic, Faults, Span, closest};
use rcc_config::yaml::{self, Node};
use rcc_language::condition;

use crate::failure::Failure;
use crate::follow;

/// Keys of a task file.
const KEYS: [&str; 5] = ["task", "description", "nets", "start", "rules"];

/// A net of a task.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TaskNet {
    /// Name in the task; empty: the net's own.
    pub name: String,
    /// Its file, relative to the working folder.
    pub file: String,
}

/// A task: nets, the commands that start first, and the rules between the nets.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TaskFile {
    /// Its name; empty if the file has rules only.
    pub name: String,
    /// Description for people.
    pub description: String,
    /// Its nets.
    pub nets: Vec<TaskNet>,
    /// Nets that start when the task does.
    pub start: Vec<String>,
    /// Its rules.
    pub rules: Vec<RuleBody>,
}

impl TaskFile {
    /// Reads a file; `-` is the standard input.
    ///
    /// # Errors
    /// Fails if it cannot be read, or with all of its faults.
    pub fn read(path: &str) -> Result<TaskFile, Failure> {
        let (name, text) = follow::read_text(path)?;
        let folder = match path {
            "-" => Path::new(""),
            path => Path::new(path).parent().unwrap_or(Path::new("")),
        };
        TaskFile::of(&name, &text, folder)
    }

    /// Returns true if the file is a task and not a net; the standard input is a net.
    ///
    /// # Errors
    /// Fails if the file cannot be read.
    pub fn is_one(path: &str) -> Result<bool, Failure> {
        if path == "-" {
            return Ok(false);
        }
        let (_, text) = follow::read_text(path)?;
        let (node, _) = yaml::read(&text);
        let has = |key: &str| node.as_ref().is_some_and(|node| node.get(key).is_some());
        Ok((has("task") || has("rules")) && !has("net"))
    }

    /// Reads a text; paths in it are relative to `folder`.
    ///
    /// # Errors
    /// Fails with all of its faults.
    pub fn of(name: &str, text: &str, folder: &Path) -> Result<TaskFile, Failure> {
        let mut faults = Vec::new();
        let node = match yaml::parse(text) {
            Ok(node) => Some(node),
            Err(found) => {
                faults = found;
                None
            }
        };
        let task = node.map(|node| task_of(&node, folder, &mut faults));
        match task {
            Some(task) if faults.is_empty() => Ok(task),
            _ => {
                let faults = Faults::new(name, text, faults);
                let what = format!("{name} is invalid");
                let source = (name.to_owned(), text.to_owned());
                Err(Failure::invalid(&what, findings(&faults), source))
            }
        }
    }

    /// Returns the names of its nets in the task, in the order of the file: the given ones, else those of the files.
    ///
    /// # Errors
    /// Fails if a net cannot be read.
    pub fn net_names(&self) -> Result<Vec<String>, Failure> {
        let names = self.nets.iter().map(|net| match net.name.as_str() {
            "" => Ok(compile::name_of(&follow::read_net(&net.file)?.1)),
            name => Ok(name.to_owned()),
        });
        names.collect()
    }

    /// Returns the same task with the names of its nets replaced by those of commands, `net#id`.
    #[must_use]
    pub fn with_commands(&self, command_of: &dyn Fn(&str) -> Option<String>) -> TaskFile {
        let renamed = |name: &str| command_of(name).unwrap_or_else(|| name.to_owned());
        let list = |commands: &rcc_api::bodies::CommandList| {
            let commands = commands.commands().iter().map(|command| match command {
                CommandRef::Name(name) => CommandRef::Name(renamed(name)),
                CommandRef::Id(id) => CommandRef::Id(*id),
            });
            rcc_api::bodies::CommandList::Several(commands.collect())
        };
        let rules = self.rules.iter().map(|rule| RuleBody {
            name: Some(rule.name.clone().unwrap_or_else(|| rule.when.clone())),
            when: condition::with_commands(&rule.when, &renamed),
            stop: list(&rule.stop),
            cancel: list(&rule.cancel),
            start: list(&rule.start),
            ..rule.clone()
        });
        TaskFile {
            start: self.start.iter().map(|name| renamed(name)).collect(),
            rules: rules.collect(),
            ..self.clone()
        }
    }
}

fn task_of(node: &Node, folder: &Path, faults: &mut Vec<Diagnostic>) -> TaskFile {
    let mut task = TaskFile::default();
    if node.map().is_none() {
        faults.push(fault(
            node.span,
            "a task is a mapping",
            "write `rules:` with a list of rules",
        ));
        return task;
    }
    for key in node.unknown_keys(&KEYS) {
        let help = match closest(&key.name, KEYS) {
            Some(near) => format!("did you mean `{near}`?"),
            None => format!("known keys: {}", KEYS.join(", ")),
        };
        faults.push(fault(key.span, format!("unknown key `{}`", key.name), help));
    }
    let mut text = |key: &str| text_of(node, key, faults);
    (task.name, task.description) = (text("task"), text("description"));
    task.nets = nets_of(node, folder, faults);
    task.start = texts_of(node, "start", faults);
    let rules = match node.get("rules").map(|rules| (rules, rules.list())) {
        None => &[][..],
        Some((_, Some(rules))) => rules,
        Some((rules, None)) => {
            faults.push(fault(
                rules.span,
                "`rules` is a list",
                "write each rule as `- when: …`",
            ));
            &[]
        }
    };
    task.rules = rules
        .iter()
        .filter_map(|rule| rule_of(rule, faults))
        .collect();
    if task.rules.is_empty() && task.start.is_empty() && faults.is_empty() {
        let message = "the file has neither rules nor nets to start";
        faults.push(fault(
            node.span,
            message,
            "write `rules:` with a list of rules",
        ));
    }
    task
}

/// A list of files, or a mapping from names to files.
fn nets_of(node: &Node, folder: &Path, faults: &mut Vec<Diagnostic>) -> Vec<TaskNet> {
    let net = |name: &str, file: &str| TaskNet {
        name: name.to_owned(),
        file: folder.join(file).to_string_lossy().into_owned(),
    };
    let Some(entries) = node.get("nets").and_then(Node::map) else {
        let files = texts_of(node, "nets", faults);
        return files.iter().map(|file| net("", file)).collect();
    };
    let mut nets = Vec::new();
    for entry in entries {
        match entry.value.text() {
            Some(file) => nets.push(net(&entry.key.name, file)),
            None => {
                let message = format!("`{}` is {}, not a file", entry.key.name, entry.value.kind());
                faults.push(fault(entry.value.span, message, "write `name: file.yaml`"));
            }
        }
    }
    nets
}

fn rule_of(node: &Node, faults: &mut Vec<Diagnostic>) -> Option<RuleBody> {
    let rule: RuleBody = match serde_json::from_value(node.to_json()) {
        Ok(rule) => rule,
        Err(error) => {
            let help = "a rule has `name`, `when`, `stop`, `cancel`, `start`, `record`, `lease` and `on_client_loss: cancel` or `go on`";
            faults.push(fault(node.span, format!("invalid rule: {error}"), help));
            return None;
        }
    };
    if let Err(wrong) = condition::parse(&rule.when) {
        let span = node.get("when").map_or(node.span, |when| when.span);
        let found = Diagnostic::error(codes::BAD_CONDITION.code, span, wrong.to_string());
        faults.push(found.help(wrong.help));
        return None;
    }
    Some(rule)
}

fn fault(span: Span, message: impl Into<String>, help: impl Into<String>) -> Diagnostic {
    Diagnostic::error(codes::BAD_REQUEST.code, span, message).help(help)
}

fn text_of(node: &Node, key: &str, faults: &mut Vec<Diagnostic>) -> String {
    let Some(value) = node.get(key) else {
        return String::new();
    };
    match value.text() {
        Some(text) => text.to_owned(),
        None => {
            let message = format!("`{key}` is {}, not text", value.kind());
            faults.push(fault(value.span, message, format!("write `{key}: …`")));
            String::new()
        }
    }
}

/// A text or a list of texts.
fn texts_of(node: &Node, key: &str, faults: &mut Vec<Diagnostic>) -> Vec<String> {
    let Some(value) = node.get(key) else {
        return Vec::new();
    };
    let nodes = value.list().unwrap_or(std::slice::from_ref(value));
    let mut texts = Vec::new();
    for node in nodes {
        match node.text() {
            Some(text) => texts.push(text.to_owned()),
            None => {
                let message = format!("`{key}` contains {}", node.kind());
                faults.push(fault(node.span, message, "write names, in a list"));
            }
        }
    }
    texts
}

#[cfg(test)]
mod tests {
    use super::*;

    const TASK: &str = "\
task: pick
nets: [approach.yaml, sub/lift.yaml]
start: approach
rules:
  - name: lift it
    when: approach.outcome == touched and not lift.reach.out
    start: lift
  - {when: lift.reason == fault, stop: [approach, 3], on_client_loss: go on}
";

    fn faults(text: &str) -> Vec<(String, String)> {
        let failure = TaskFile::of("t.yaml", text, Path::new("")).expect_err("invalid");
        let found = failure.body.diagnostics.iter();
        found
            .map(|found| {
                (
                    found.message.clone(),
                    found.help.clone().unwrap_or_default(),
                )
            })
            .collect()
    }

    #[test]
    fn a_task_is_read_and_its_nets_become_commands() {
        let task = TaskFile::of("t.yaml", TASK, Path::new("cell")).expect("valid");
        let files: Vec<&str> = task.nets.iter().map(|net| net.file.as_str()).collect();
        assert_eq!(files, ["cell/approach.yaml", "cell/sub/lift.yaml"]);
        assert_eq!((task.name.as_str(), task.rules.len()), ("pick", 2));
        let commands = |name: &str| (name == "approach").then(|| "go#7".to_owned());
        let task = task.with_commands(&commands);
        assert_eq!(task.start, ["go#7"]);
        assert_eq!(
            task.rules[0].when,
            "go#7.outcome == touched and not lift.reach.out"
        );
        let stop = task.rules[1].stop.commands();
        assert_eq!(
            stop,
            [CommandRef::Name("go#7".to_owned()), CommandRef::Id(3)]
        );
        let twice = "nets: {a: x.yaml, b: x.yaml}\nstart: a";
        let twice = TaskFile::of("t.yaml", twice, Path::new("")).expect("valid");
        assert_eq!(
            (twice.nets[1].name.as_str(), twice.nets[1].file.as_str()),
            ("b", "x.yaml")
        );
    }

    #[test]
    fn every_fault_of_a_task_has_its_remedy() {
        for (text, message, help) in [
            ("rule: []", "unknown key `rule`", "rules"),
            ("rules: 3", "`rules` is a list", "- when"),
            ("rules: [{when: a.outcome = b}]", "unexpected `=`", "`==`"),
            (
                "rules: [{start: b}]",
                "missing field `when`",
                "on_client_loss",
            ),
            (
                "rules: [{when: 'true', strt: b}]",
                "unknown field `strt`",
                "start",
            ),
            ("task: 3\nrules: []", "`task` is a number", "task"),
            ("nets: [a.yaml]", "neither rules", "rules"),
        ] {
            let found = faults(text);
            let is = found
                .iter()
                .any(|(said, remedy)| said.contains(message) && remedy.contains(help));
            assert!(is, "{text}: {found:?}");
        }
    }
}
