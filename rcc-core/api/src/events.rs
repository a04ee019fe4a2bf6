//! Events of the log as clients receive them: with the name of the net and a sentence. Pure; used by blocking threads of
//! the loader and by the command line.

use std::collections::{HashMap, VecDeque};

use rcc_protocol::events::{CommandNames, Event, EventKind};
use serde_json::Value;

use crate::bodies::{EventSourceView, EventView};

/// Maximum number of commands whose names the loader keeps; the oldest are forgotten first.
pub const NAMES_MAX: usize = 8192;

/// A command, as LOAD reported it to the log.
#[derive(Clone, Debug, Default)]
struct LoadedCommand {
    net: String,
    /// Names of its outcomes, in the order of the text.
    outcomes: Vec<String>,
}

/// Names of commands and of their outcomes, as LOAD reported them to the log.
#[derive(Clone, Debug)]
pub struct EventNames {
    most: usize,
    /// By the executor's incarnation and id.
    commands: HashMap<(String, u64), LoadedCommand>,
    oldest: VecDeque<(String, u64)>,
}

impl EventNames {
    /// Keeps the names of at most so many commands, the newest ones.
    #[must_use]
    pub fn keeping(most: usize) -> EventNames {
        EventNames {
            most,
            commands: HashMap::new(),
            oldest: VecDeque::new(),
        }
    }

    /// Returns all commands: incarnation of the executor, id, and name of the net.
    pub fn commands(&self) -> impl Iterator<Item = (&str, u64, &str)> {
        let commands = self.commands.iter();
        commands.map(|((executor, id), command)| (executor.as_str(), *id, command.net.as_str()))
    }

    /// Learns the names of a command, if the event reports them.
    pub fn learn(&mut self, event: &Event) {
        let (command, executor, net, outcomes) = match &event.what {
            EventKind::Loaded {
                command,
                executor,
                net,
                outcomes,
                ..
            } => (command, executor, net, outcomes.clone()),
            EventKind::Rejected {
                command,
                executor,
                net,
                ..
            } => (command, executor, net, Vec::new()),
            _ => return,
        };
        if net.is_empty() {
            return;
        }
        let key = (executor.clone(), *command);
        let net = net.clone();
        let loaded = LoadedCommand { net, outcomes };
        if self.commands.insert(key.clone(), loaded).is_none() {
            self.oldest.push_back(key);
        }
        if self.oldest.len() > self.most
            && let Some(key) = self.oldest.pop_front()
        {
            self.commands.remove(&key);
        }
    }

    fn command(&self, executor: &str, id: u64) -> Option<&LoadedCommand> {
        self.commands.get(&(executor.to_owned(), id))
    }

    /// Returns the title of a command: `line#3`, or `#3` if its name is not known.
    #[must_use]
    pub fn title(&self, executor: &str, id: u64) -> String {
        let net = self
            .command(executor, id)
            .map_or("", |command| &command.net);
        format!("{net}#{id}")
    }

    /// Returns an event as clients receive it.
    #[must_use]
    pub fn view(&self, event: &Event) -> EventView {
        let mut what = serde_json::to_value(&event.what).unwrap_or_default();
        let id = event.what.command();
        EventView {
            time: event.time.clone(),
            monotonic_ns: event.monotonic_ns,
            cycle: event.cycle,
            source: EventSourceView {
                role: event.source.role.as_str().to_owned(),
                label: event.source.label.clone(),
                pid: event.source.pid,
                incarnation: event.source.incarnation.clone(),
            },
            severity: text_of(serde_json::to_value(event.severity).unwrap_or_default()),
            kind: event.what.name().to_owned(),
            fields: what["fields"].take(),
            words: event.sentence_with(self),
            net: id.map(|id| self.title(event.executor(), id)),
            outcome: match event.what {
                EventKind::Command {
                    command,
                    outcome: Some(number),
                    ..
                } => self.outcome(event.executor(), command, number),
                _ => None,
            },
        }
    }
}

impl CommandNames for EventNames {
    fn net(&self, executor: &str, id: u64) -> String {
        self.title(executor, id)
    }

    fn outcome(&self, executor: &str, id: u64, number: u32) -> Option<String> {
        let outcomes = &self.command(executor, id)?.outcomes;
        outcomes.get(number.checked_sub(1)? as usize).cloned()
    }
}

fn text_of(value: Value) -> String {
    match value {
        Value::String(text) => text,
        other => other.to_string(),
    }
}

/// Returns the event of a view; `None` if it is of a kind that this build does not know.
#[must_use]
pub fn event(view: &EventView) -> Option<Event> {
    serde_json::from_value(serde_json::to_value(view).ok()?).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcc_protocol::events::{EventOrigin, EventSource};

    fn loaded(command: u64) -> Event {
        let source = EventSource::this(EventOrigin::Loader, "loader");
        let executor = "00".to_owned();
        let what = EventKind::Loaded {
            command,
            executor,
            net: "line".into(),
            primitives: 9,
            uses: vec!["lwr".into()],
            outcomes: Vec::new(),
        };
        Event::now(source, Some(7), what)
    }

    #[test]
    fn a_view_is_the_line_of_the_log_with_words_and_net() {
        let mut names = EventNames::keeping(NAMES_MAX);
        names.learn(&loaded(3));
        let view = names.view(&loaded(3));
        assert_eq!(view.net.as_deref(), Some("line#3"));
        let mut line = serde_json::to_value(loaded(3)).expect("a line");
        let shown = serde_json::to_value(&view).expect("a view");
        for key in ["time", "monotonic_ns"] {
            line[key] = shown[key].clone();
        }
        line["words"] = view.words.clone().into();
        line["net"] = "line#3".into();
        assert_eq!(shown, line);
        let again = event(&view).expect("a known kind");
        assert_eq!(names.view(&again), view);
        let unknown = EventView {
            kind: "of-tomorrow".into(),
            ..view
        };
        assert_eq!(event(&unknown), None);
    }

    #[test]
    fn names_are_kept_up_to_a_bound() {
        let mut names = EventNames::keeping(NAMES_MAX);
        (0..NAMES_MAX as u64 + 1).for_each(|id| names.learn(&loaded(id)));
        assert_eq!(names.title("00", 0), "#0");
        assert_eq!(names.title("00", 1), "line#1");
        assert_eq!(names.commands.len(), NAMES_MAX);
    }
}
