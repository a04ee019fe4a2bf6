//! Prints events as a table or as JSON lines. In the table late cycles are folded. Run by the main thread.

use std::time::{Duration, Instant};

use rcc_protocol::events::{CommandNames, Event, EventKind, EventSeverity, wall_time};

use super::filter::EventFilter;
use super::late::LateFold;
use crate::context::OutputFormat;
use crate::output::{print_line, print_record};
use crate::table::grouped;

/// Longest time for which late cycles are held back to be folded while the log is followed.
const FOLD_MAX: Duration = Duration::from_secs(10);
/// Length of the date in a time of the log.
const DATE_LENGTH: usize = 10;

/// A line of the table.
#[derive(Clone, Debug)]
pub(super) enum Line {
    /// One event.
    Event(Box<Event>),
    /// Several reports of late cycles.
    Late(Box<LateFold>),
}

impl Line {
    fn event(&self) -> &Event {
        match self {
            Line::Event(event) => event,
            Line::Late(fold) => &fold.whole,
        }
    }
}

/// Printer of events.
#[derive(Debug)]
pub(super) struct EventView {
    format: OutputFormat,
    filter: EventFilter,
    header_printed: bool,
    /// Date of the last line, at first today's.
    date: String,
    /// Late cycles that came while the log is followed and are not printed yet.
    held: Option<(LateFold, Instant)>,
}

impl EventView {
    pub(super) fn new(format: OutputFormat, filter: EventFilter) -> EventView {
        EventView {
            format,
            filter,
            header_printed: false,
            date: date(&wall_time()).to_owned(),
            held: None,
        }
    }

    /// Prints the events that are there, or their last `most` lines.
    pub(super) fn show_kept(&mut self, events: &[Event], most: Option<usize>) {
        let matching = events.iter().filter(|event| self.filter.matches(event));
        let lines = match self.format {
            OutputFormat::Human => folded(matching),
            OutputFormat::Json => matching
                .cloned()
                .map(|event| Line::Event(Box::new(event)))
                .collect(),
        };
        let skipped = most.map_or(0, |most| lines.len().saturating_sub(most));
        lines.iter().skip(skipped).for_each(|line| self.print(line));
    }

    /// Prints an event that has just come; late cycles are held back for a moment.
    pub(super) fn show_new(&mut self, event: &Event) {
        self.filter.learn(event);
        if !self.filter.matches(event) {
            return;
        }
        if self.format == OutputFormat::Human {
            if let Some((fold, _)) = &mut self.held
                && fold.add(event)
            {
                return;
            }
            if interrupts_fold(event) {
                self.end();
            }
            if let Some(fold) = LateFold::begin(event) {
                self.held = Some((fold, Instant::now()));
                return;
            }
        }
        self.print(&Line::Event(Box::new(event.clone())));
    }

    /// Prints late cycles that have been held back for long enough.
    pub(super) fn flush_if_due(&mut self) {
        if self
            .held
            .as_ref()
            .is_some_and(|(_, begun)| begun.elapsed() > FOLD_MAX)
        {
            self.end();
        }
    }

    /// Prints late cycles that are still held back.
    pub(super) fn end(&mut self) {
        if let Some((fold, _)) = self.held.take() {
            self.print(&Line::Late(Box::new(fold)));
        }
    }

    fn print(&mut self, line: &Line) {
        let event = line.event();
        let sentence = match line {
            Line::Event(event) => event.sentence_with(&self.filter),
            Line::Late(fold) => fold.sentence(&self.filter),
        };
        if self.format == OutputFormat::Json {
            print_record(&json(event, &sentence, &self.filter));
            return;
        }
        // Other processes wrote the log: control characters must not reach the terminal.
        let clean = |text: &str| text.replace(char::is_control, " ");
        if !self.header_printed {
            print_line(&row("TIME (UTC)", "CYCLE", "WHO", " ", "WHAT"));
            self.header_printed = true;
        }
        if date(&event.time) != self.date {
            self.date = date(&event.time).to_owned();
            print_line(&clean(&self.date));
        }
        let cycle = event.cycle.map_or_else(String::new, grouped);
        let mark = match event.severity {
            EventSeverity::Info => " ",
            EventSeverity::Warning => "!",
            EventSeverity::Error => "‼",
        };
        let time = event.time.get(11..23).unwrap_or(&event.time);
        print_line(&row(
            &clean(time),
            &cycle,
            &clean(&event.who()),
            mark,
            &clean(&sentence),
        ));
    }
}

/// Folds late cycles: each report joins the last one of its executor, unless something else that is a warning or an error
/// stands between them. The line stands where the first of them was.
pub(super) fn folded<'a>(events: impl Iterator<Item = &'a Event>) -> Vec<Line> {
    let mut lines = Vec::new();
    let mut open = None;
    for event in events {
        if let Some(Line::Late(fold)) = open.and_then(|at: usize| lines.get_mut(at))
            && fold.add(event)
        {
            continue;
        }
        if interrupts_fold(event) {
            open = None;
        }
        match LateFold::begin(event) {
            Some(fold) => {
                open = Some(lines.len());
                lines.push(Line::Late(Box::new(fold)));
            }
            None => lines.push(Line::Event(Box::new(event.clone()))),
        }
    }
    lines
}

/// Returns true if the order of this event and of late cycles matters to a reader.
fn interrupts_fold(event: &Event) -> bool {
    event.severity > EventSeverity::Info
}

fn date(time: &str) -> &str {
    time.get(..DATE_LENGTH).unwrap_or(time)
}

fn row(time: &str, cycle: &str, who: &str, mark: &str, what: &str) -> String {
    format!("{time:<12}  {cycle:>10}  {who:<12} {mark} {what}")
}

/// Returns the line of the log as JSON, with its sentence and the net's name added.
pub(super) fn json(event: &Event, sentence: &str, filter: &EventFilter) -> String {
    let mut value = serde_json::to_value(event).unwrap_or_default();
    if let Some(object) = value.as_object_mut() {
        object.insert("words".to_owned(), sentence.into());
        if let Some(id) = event.what.command() {
            let title = filter.title(event.executor(), id);
            object.insert("net".to_owned(), title.into());
        }
        if let EventKind::Command {
            command,
            outcome: Some(number),
            ..
        } = event.what
            && let Some(outcome) = filter.outcome(event.executor(), command, number)
        {
            object.insert("outcome".to_owned(), outcome.into());
        }
    }
    value.to_string()
}
