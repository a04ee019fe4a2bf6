//! `events`: shows the cell's event log: process deaths, lost devices, ended nets and their causes. Reads files of the
//! state folder, so it works while every process of the cell is dead, after its end and after a restart of the machine.

use std::collections::HashMap;
use std::time::Duration;

use rcc_api::codes;
use rcc_ipc::events::EventReader;
use rcc_protocol::events::{
    CommandNames, Event, EventKind, EventOrigin, EventSeverity, wall_time_before,
};

use crate::context::{Context, OutputFormat};
use crate::evidence::Evidence;
use crate::failure::Failure;
use crate::interrupt::Interrupts;
use crate::output::{print_line, print_note, print_record};
use crate::table::grouped;

/// Interval between two polls of a followed log.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

/// Arguments of `events`.
#[derive(clap::Args, Debug, Default)]
pub struct Arguments {
    /// Keep printing new events until Ctrl-C or the end of the cell
    #[arg(long, short)]
    follow: bool,
    /// Also the events of earlier runs of the cell
    #[arg(long)]
    all: bool,
    /// Only events younger than this time (500ms, 10s, 10min) or from this executor cycle on
    #[arg(long, value_name = "TIME|CYCLE")]
    since: Option<String>,
    /// Only events of this net: name, name#id or id
    #[arg(long, value_name = "NET")]
    net: Option<String>,
    /// Only events of this device, its driver, or this process
    #[arg(long, value_name = "NAME")]
    device: Option<String>,
}

/// Runs the verb.
///
/// # Errors
/// Fails if nothing is kept of such a cell, if its log cannot be read, or if Ctrl-C ended the verb.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let evidence = Evidence::find(context)?;
    if arguments.follow && evidence.cell.is_none() {
        return Err(Failure::new(
            codes::NO_LOADER,
            format!("cell `{}` is not up: no events come", context.cell_name()),
            "leave out --follow to see the events that are kept of it, or start it with `rcc-cli up FILE`",
        ));
    }
    evidence.note(context, "its events are");
    let interrupts = Interrupts::listen()?;
    let mut view = EventView::new(context.format, &arguments)?;
    let mut reader = EventReader::open(&evidence.state);
    let path = evidence.state.events_file();
    let unreadable = |error| Failure::unreadable(&path.display().to_string(), &error);
    let mut batch = reader.poll().map_err(unreadable)?;
    // Sorts the events of several processes by time.
    batch.sort_by(|a, b| a.time.cmp(&b.time));
    view.prepare(&batch);
    if !arguments.all && view.since == Since::Always {
        let earlier = newest_run(&batch);
        if earlier > 0 {
            print_note(&format!(
                "{} events of earlier runs are not shown (--all)",
                grouped(earlier as u64)
            ));
        }
        batch.drain(..earlier);
    }
    let mut over = false;
    loop {
        batch.iter().for_each(|event| view.show(event));
        over |= batch.iter().any(is_end);
        if !arguments.follow || over {
            break;
        }
        if interrupts.asked() {
            return Err(Failure::interrupted());
        }
        // Without a cell nobody writes any more; what came last is read once more.
        let gone = evidence.cell.as_ref();
        over = gone.is_none_or(|cell| !cell.runtime_dir().is_dir());
        std::thread::sleep(POLL_INTERVAL);
        batch = reader.poll().map_err(unreadable)?;
    }
    if arguments.follow {
        print_note(&format!(
            "the cell has ended; its events stay in {}",
            evidence.state.path().display()
        ));
    }
    if reader.unreadable() > 0 {
        print_note(&format!(
            "skipped {} truncated or invalid lines of the log",
            reader.unreadable()
        ));
    }
    Ok(())
}

fn is_end(event: &Event) -> bool {
    matches!(event.what, EventKind::CellEnded { .. })
}

/// Returns the index of the first event of the newest run under `rcc-cli up`, together with runs before it that did not
/// end in order: they may be the reason for looking. Services write no such event; then all events are of one run.
fn newest_run(events: &[Event]) -> usize {
    let start = |event: &Event| match &event.what {
        EventKind::CellStarted { previous, .. } => previous.is_none(),
        _ => false,
    };
    events.iter().rposition(start).unwrap_or(0)
}

/// Start of the shown events.
#[derive(Debug, PartialEq)]
enum Since {
    Always,
    Time(String),
    Cycle(u64),
}

/// Filter and format of the shown events.
struct EventView {
    format: OutputFormat,
    since: Since,
    net: Option<String>,
    device: Option<String>,
    /// Names of commands, by the executor's incarnation and id.
    names: HashMap<(String, u64), String>,
    /// Names of the outcomes of commands, by the executor's incarnation and id.
    outcomes: HashMap<(String, u64), Vec<String>>,
    header_printed: bool,
}

impl EventView {
    fn new(format: OutputFormat, arguments: &Arguments) -> Result<EventView, Failure> {
        Ok(EventView {
            format,
            since: since(arguments.since.as_deref())?,
            net: arguments.net.clone(),
            device: arguments.device.clone(),
            names: HashMap::new(),
            outcomes: HashMap::new(),
            header_printed: false,
        })
    }

    /// Prepares the filter: learns names that are reported late, and the time of the first requested cycle.
    fn prepare(&mut self, events: &[Event]) {
        events.iter().for_each(|event| self.learn_name(event));
        let Since::Cycle(from) = self.since else {
            return;
        };
        // Cycles are counted from 1 in each incarnation of the executor: the newest is meant.
        let ours =
            |event: &&Event| event.source.role == EventOrigin::Executor && event.cycle.is_some();
        let newest = events
            .iter()
            .rfind(ours)
            .map(|event| &event.source.incarnation);
        let first = events
            .iter()
            .filter(ours)
            .find(|event| Some(&event.source.incarnation) == newest && event.cycle >= Some(from));
        if let Some(first) = first {
            self.since = Since::Time(first.time.clone());
        }
    }

    fn learn_name(&mut self, event: &Event) {
        if let EventKind::Loaded {
            command,
            executor,
            net,
            ..
        }
        | EventKind::Rejected {
            command,
            executor,
            net,
            ..
        } = &event.what
            && !net.is_empty()
        {
            self.names.insert((executor.clone(), *command), net.clone());
        }
        if let EventKind::Loaded {
            command,
            executor,
            outcomes,
            ..
        } = &event.what
            && !outcomes.is_empty()
        {
            let key = (executor.clone(), *command);
            self.outcomes.insert(key, outcomes.clone());
        }
    }

    fn net(&self, executor: &str, id: u64) -> String {
        let name = self.names.get(&(executor.to_owned(), id));
        name.map_or_else(|| format!("#{id}"), |name| format!("{name}#{id}"))
    }

    fn matches(&self, event: &Event) -> bool {
        let young = match &self.since {
            Since::Always => true,
            Since::Time(time) => event.time >= *time,
            Since::Cycle(cycle) => event.cycle.is_some_and(|is| is >= *cycle),
        };
        young && self.matches_net(event) && self.matches_device(event)
    }

    fn matches_net(&self, event: &Event) -> bool {
        let Some(matches) = &self.net else {
            return true;
        };
        event.what.command().is_some_and(|id| {
            let whole = self.net(event.executor(), id);
            let name = whole.split('#').next().unwrap_or_default();
            [whole.as_str(), name, &id.to_string()].contains(&matches.as_str())
        })
    }

    fn matches_device(&self, event: &Event) -> bool {
        let Some(matches) = &self.device else {
            return true;
        };
        let of_driver = event.source.role == EventOrigin::Driver && event.source.label == *matches;
        let process = matches.strip_prefix("driver/").unwrap_or(matches);
        of_driver || event.what.device() == Some(process)
    }

    fn show(&mut self, event: &Event) {
        self.learn_name(event);
        if !self.matches(event) {
            return;
        }
        let sentence = event.sentence_with(self);
        match self.format {
            OutputFormat::Json => print_record(&json(event, &sentence, self)),
            OutputFormat::Human => {
                if !self.header_printed {
                    print_line(&row("TIME (UTC)", "CYCLE", "WHO", " ", "WHAT"));
                    self.header_printed = true;
                }
                let cycle = event.cycle.map_or_else(String::new, grouped);
                let mark = match event.severity {
                    EventSeverity::Info => " ",
                    EventSeverity::Warning => "!",
                    EventSeverity::Error => "‼",
                };
                let time = event.time.get(11..23).unwrap_or(&event.time);
                // Other processes wrote the log: control characters must not reach the terminal.
                let clean = |text: &str| text.replace(char::is_control, " ");
                print_line(&row(
                    &clean(time),
                    &cycle,
                    &clean(&event.who()),
                    mark,
                    &clean(&sentence),
                ));
            }
        }
    }
}

impl CommandNames for EventView {
    fn net(&self, executor: &str, id: u64) -> String {
        EventView::net(self, executor, id)
    }

    fn outcome(&self, executor: &str, id: u64, number: u32) -> Option<String> {
        let outcomes = self.outcomes.get(&(executor.to_owned(), id))?;
        outcomes.get(number.checked_sub(1)? as usize).cloned()
    }
}

fn row(time: &str, cycle: &str, who: &str, mark: &str, what: &str) -> String {
    format!("{time:<12}  {cycle:>10}  {who:<12} {mark} {what}")
}

/// Returns the line of the log as JSON, with its sentence and the net's name added.
fn json(event: &Event, sentence: &str, view: &EventView) -> String {
    let mut value = serde_json::to_value(event).unwrap_or_default();
    if let Some(object) = value.as_object_mut() {
        object.insert("words".to_owned(), sentence.into());
        if let Some(id) = event.what.command() {
            object.insert("net".to_owned(), view.net(event.executor(), id).into());
        }
        if let EventKind::Command {
            command,
            outcome: Some(number),
            ..
        } = event.what
            && let Some(outcome) = view.outcome(event.executor(), command, number)
        {
            object.insert("outcome".to_owned(), outcome.into());
        }
    }
    value.to_string()
}

fn since(text: Option<&str>) -> Result<Since, Failure> {
    let Some(text) = text else {
        return Ok(Since::Always);
    };
    if let Ok(cycle) = text.replace([' ', '_'], "").parse() {
        return Ok(Since::Cycle(cycle));
    }
    match super::duration(text) {
        Ok(ago) => Ok(Since::Time(wall_time_before(ago))),
        Err(message) => Err(Failure::new(
            codes::BAD_REQUEST,
            message,
            "--since takes a duration (10s, 10min) or a cycle number",
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcc_protocol::events::{CommandFault, EventSource};

    fn event(role: EventOrigin, label: &str, cycle: Option<u64>, what: EventKind) -> Event {
        Event::now(EventSource::this(role, label), cycle, what)
    }

    fn loaded() -> Event {
        let executor = EventSource::this(EventOrigin::Executor, "exec").incarnation;
        let what = EventKind::Loaded {
            command: 3,
            executor,
            net: "line".into(),
            primitives: 9,
            uses: vec!["lwr".into()],
            outcomes: vec!["arrived".into(), "touched".into()],
        };
        event(EventOrigin::Loader, "loader", None, what)
    }

    fn lost() -> Event {
        let fault = CommandFault {
            code: "device lost".into(),
            device: Some("lwr".into()),
            joint: None,
            rule: None,
            value: None,
            limit: None,
            unit: None,
        };
        let what = EventKind::Command {
            command: 3,
            state: "terminated".into(),
            reason: Some("fault".into()),
            outcome: None,
            cycles: Some(7),
            fault: Some(fault),
        };
        event(EventOrigin::Executor, "exec", Some(70), what)
    }

    fn view(arguments: &Arguments) -> EventView {
        let mut view = EventView::new(OutputFormat::Human, arguments).unwrap();
        view.prepare(&[loaded(), lost()]);
        view
    }

    #[test]
    fn a_command_has_the_name_under_which_it_was_loaded() {
        let view = view(&Arguments::default());
        let sentence = lost().sentence(&|executor, id| view.net(executor, id));
        assert!(
            sentence.starts_with("line#3 terminated by a fault, device lost: lwr"),
            "{sentence}"
        );
        assert_eq!(view.net("another life", 3), "#3");
    }

    #[test]
    fn an_outcome_has_the_name_of_the_text() {
        let view = view(&Arguments::default());
        for (cycles, words) in [
            (2104, "line#3 terminated: finished: touched"),
            (1, "line#3 terminated: finished in its first cycle: touched"),
        ] {
            let what = EventKind::Command {
                command: 3,
                state: "terminated".into(),
                reason: Some("finished".into()),
                outcome: Some(2),
                cycles: Some(cycles),
                fault: None,
            };
            let ended = event(EventOrigin::Executor, "exec", Some(70), what);
            assert_eq!(ended.sentence_with(&view), words);
            let line = json(&ended, words, &view);
            assert!(line.contains("\"outcome\":\"touched\""), "{line}");
        }
    }

    #[test]
    fn a_net_is_wanted_by_name_id_or_both() {
        for net in ["line", "line#3", "3"] {
            let view = view(&Arguments {
                net: Some(net.into()),
                ..Arguments::default()
            });
            assert!(view.matches(&lost()), "{net}");
        }
        let view = view(&Arguments {
            net: Some("other".into()),
            ..Arguments::default()
        });
        assert!(!view.matches(&lost()));
    }

    #[test]
    fn a_device_is_wanted_with_its_driver_and_its_process() {
        let view = view(&Arguments {
            device: Some("lwr".into()),
            ..Arguments::default()
        });
        let stopping = || EventKind::Stopping { why: "x".into() };
        let died = EventKind::ProcessDied {
            process: "driver/lwr".into(),
            pid: 1,
            how: "SIGKILL".into(),
            last_words: String::new(),
        };
        assert!(view.matches(&lost()));
        assert!(view.matches(&event(EventOrigin::Driver, "lwr", None, stopping())));
        assert!(view.matches(&event(EventOrigin::Supervisor, "up", None, died)));
        assert!(!view.matches(&event(EventOrigin::Driver, "io", None, stopping())));
    }

    #[test]
    fn the_newest_run_includes_runs_before_it_that_died() {
        let start = |died: bool| {
            let last = rcc_protocol::events::LastEvent {
                who: "loader".into(),
                time: String::new(),
                words: String::new(),
            };
            let what = EventKind::CellStarted {
                config: "cell.yaml".into(),
                ports: std::collections::BTreeMap::new(),
                previous: died.then_some(last),
            };
            event(EventOrigin::Supervisor, "up", None, what)
        };
        assert_eq!(newest_run(&[]), 0);
        assert_eq!(newest_run(&[loaded(), lost()]), 0);
        let all = [start(false), lost(), start(false), lost(), start(true)];
        assert_eq!(newest_run(&all), 2);
    }

    #[test]
    fn since_takes_a_time_or_a_cycle() {
        assert_eq!(since(Some("81 422")).unwrap(), Since::Cycle(81_422));
        assert!(matches!(since(Some("10min")).unwrap(), Since::Time(_)));
        assert!(since(Some("yesterday")).is_err());
        let since = Some("71".to_owned());
        let view = view(&Arguments {
            since,
            ..Arguments::default()
        });
        assert!(!view.matches(&lost()));
    }
}
