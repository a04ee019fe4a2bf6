//! `tail`: prints values by name as they arrive. Run by the monitor's one thread; it ends when the reader is gone.

use std::io::{self, Write};
use std::time::{Duration, Instant};

use rcc_core::counted::Counted;
use rcc_core::message::MonitorRecord;
use rcc_core::printable::{OneLine, Printable};
use serde_json::{Value, json};

use crate::signals::Signals;
use rcc_protocol::element_kind::ElementKind;
use rcc_protocol::pattern::Pattern;
use rcc_reading::names::{CommandNames, MonitorInfo};
use rcc_reading::stream::{ExecutorFollower, StreamError};

/// Interval at which the stream is polled; its buffers hold more than 100 ms.
const LOOK_EVERY: Duration = Duration::from_millis(5);
/// Interval at which an executor is looked for.
const FIND_EVERY: Duration = Duration::from_millis(50);

/// Output format.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Format {
    /// One line per value.
    Human,
    /// One JSON object per line.
    Json,
}

/// Values to print, and for how long.
#[derive(Clone, Debug)]
pub struct TailOptions {
    /// Patterns of the values to show; all if empty.
    pub patterns: Vec<Pattern>,
    /// Output format.
    pub format: Format,
    /// Maximum number of records.
    pub count: Option<u64>,
    /// Maximum time.
    pub duration: Option<Duration>,
}

/// The reason why printing failed.
#[derive(Debug, thiserror::Error)]
pub enum TailError {
    /// The stream cannot be read.
    #[error(transparent)]
    Stream(#[from] StreamError),
    /// The output cannot be written.
    #[error("cannot write the output: {0}")]
    Output(#[from] io::Error),
}

/// The reason why printing ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TailEnd {
    /// The count or the time is reached.
    Done,
    /// A signal, with its number.
    Signal(i32),
    /// The reader of the output is gone.
    ReaderGone,
}

/// Prints a line to stderr; a failure is ignored.
pub fn print_note(text: &str) {
    let _ = writeln!(io::stderr(), "{}", Printable(text));
}

/// Prints until the count or the time is reached, a signal arrives, or the reader is gone.
///
/// # Errors
/// Returns an error if the stream cannot be read or the output cannot be written.
pub fn tail(
    cell: &str,
    options: &TailOptions,
    signals: &mut Signals,
    out: &mut impl Write,
    reader_is_gone: impl Fn() -> bool,
) -> Result<TailEnd, TailError> {
    let mut follower = ExecutorFollower::new(cell);
    let started = Instant::now();
    let mut printer = Printer::new(options);
    let mut waiting_told = false;
    loop {
        if let Some(signal) = signals.pending() {
            return Ok(TailEnd::Signal(signal));
        }
        if options
            .duration
            .is_some_and(|limit| started.elapsed() >= limit)
        {
            return Ok(TailEnd::Done);
        }
        let update = follower.poll()?;
        match update.changed {
            Some(false) => print_note(&format!(
                "the executor of cell '{cell}' is gone; waiting for a new one"
            )),
            None if !follower.is_attached() && !waiting_told => {
                waiting_told = true;
                print_note(&format!("cell '{cell}' has no executor; waiting for one"));
            }
            _ => {}
        }
        let printed = print(
            &mut printer,
            &update.records,
            update.lost,
            &mut follower,
            out,
        );
        match printed {
            Err(error) if error.kind() == io::ErrorKind::BrokenPipe => {
                return Ok(TailEnd::ReaderGone);
            }
            Err(error) => return Err(error.into()),
            Ok(()) if options.count.is_some_and(|most| printer.printed >= most) => {
                return Ok(TailEnd::Done);
            }
            Ok(()) => {}
        }
        if update.records.is_empty() {
            if reader_is_gone() {
                return Ok(TailEnd::ReaderGone);
            }
            std::thread::sleep(if follower.is_attached() {
                LOOK_EVERY
            } else {
                FIND_EVERY
            });
        }
    }
}

fn print(
    printer: &mut Printer<'_>,
    records: &[MonitorRecord],
    lost: u64,
    follower: &mut ExecutorFollower,
    out: &mut impl Write,
) -> io::Result<()> {
    if lost > 0 {
        printer.lost(lost, out)?;
    }
    let Some(names) = follower.names() else {
        return Ok(());
    };
    for record in records {
        let command = names.command(record.command);
        printer.record(record, command, out)?;
    }
    if records.is_empty() {
        Ok(())
    } else {
        out.flush()
    }
}

/// Formats records as lines.
struct Printer<'a> {
    options: &'a TailOptions,
    printed: u64,
    first_stamp_ns: Option<u64>,
}

impl<'a> Printer<'a> {
    fn new(options: &'a TailOptions) -> Printer<'a> {
        Printer {
            options,
            printed: 0,
            first_stamp_ns: None,
        }
    }

    fn lost(&self, lost: u64, out: &mut impl Write) -> io::Result<()> {
        match self.options.format {
            Format::Human => {
                print_note(&format!("lost here: {}", Counted(lost, "record")));
                Ok(())
            }
            Format::Json => writeln!(out, "{}", json!({"lost": lost})),
        }
    }

    fn record(
        &mut self,
        record: &MonitorRecord,
        command: &CommandNames,
        out: &mut impl Write,
    ) -> io::Result<()> {
        if self.options.count.is_some_and(|most| self.printed >= most) {
            return Ok(());
        }
        let monitor = command.monitors.get(record.monitor as usize);
        let unnamed = MonitorInfo {
            source: format!("monitor{}", record.monitor),
            ..MonitorInfo::default()
        };
        let monitor = monitor.unwrap_or(&unnamed);
        let Some(element) = self.matching_element(&command.net, monitor) else {
            return Ok(());
        };
        let width = (record.width as usize).min(record.values.len());
        let mut elements = record.values.get(..width).unwrap_or_default();
        let mut name = format!("{}/{}", command.net, monitor.source);
        if let Some(index) = element {
            let Some(one) = elements.get(index..=index) else {
                return Ok(());
            };
            elements = one;
            name = format!("{name}[{index}]");
        }
        self.printed += 1;
        match self.options.format {
            Format::Human => self.human(record, &name, monitor, elements, out),
            Format::Json => json_line(record, &name, command, monitor, elements, out),
        }
    }

    /// Returns `Some(element)` if a pattern matches this monitor, by the observed port or by its own id.
    fn matching_element(&self, net: &str, monitor: &MonitorInfo) -> Option<Option<usize>> {
        if self.options.patterns.is_empty() {
            return Some(None);
        }
        let names = [
            format!("{net}/{}", monitor.source),
            format!("{net}/{}", monitor.primitive),
        ];
        let means = |pattern: &&Pattern| names.iter().any(|name| pattern.matches(name));
        self.options
            .patterns
            .iter()
            .find(means)
            .map(|pattern| pattern.element)
    }

    fn human(
        &mut self,
        record: &MonitorRecord,
        name: &str,
        monitor: &MonitorInfo,
        elements: &[f64],
        out: &mut impl Write,
    ) -> io::Result<()> {
        let first = *self.first_stamp_ns.get_or_insert(record.stamp_ns);
        let seconds = record.stamp_ns.saturating_sub(first) as f64 / 1e9;
        let kind = ElementKind::of(&monitor.ty);
        let name = OneLine(name).to_string();
        let mut line = format!("{seconds:10.3} s  {name:<24}");
        for element in elements {
            line.push_str(&format!(" {:>11}", kind.human(*element)));
        }
        match monitor.unit.as_deref() {
            None | Some("" | "1") => {}
            Some(unit) => line.push_str(&format!(" {unit}")),
        }
        writeln!(out, "{}", Printable(&line))
    }
}

fn json_line(
    record: &MonitorRecord,
    name: &str,
    command: &CommandNames,
    monitor: &MonitorInfo,
    elements: &[f64],
    out: &mut impl Write,
) -> io::Result<()> {
    let kind = ElementKind::of(&monitor.ty);
    let value = match elements {
        [one] => kind.json(*one),
        all => Value::Array(all.iter().map(|element| kind.json(*element)).collect()),
    };
    let line = json!({
        "name": name,
        "net": command.net,
        "command": record.command,
        "source": monitor.source,
        "monitor": monitor.primitive,
        "type": monitor.ty,
        "unit": monitor.unit,
        "sequence": record.sequence,
        "cycle": record.cycle,
        "stamp_ns": record.stamp_ns,
        "value": value,
    });
    writeln!(out, "{}", Printable(&line.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    fn printed(format: Format, patterns: &[&str], values: &[f64], ty: &str) -> String {
        let options = TailOptions {
            patterns: patterns.iter().filter_map(|p| p.parse().ok()).collect(),
            format,
            count: None,
            duration: None,
        };
        let mut record = MonitorRecord {
            cycle: 7,
            width: values.len() as u32,
            ..MonitorRecord::zeroed()
        };
        record.values[..values.len()].copy_from_slice(values);
        let command = CommandNames {
            net: "line".into(),
            monitors: vec![MonitorInfo {
                primitive: "watch".into(),
                source: "move.pose".into(),
                ty: ty.into(),
                unit: Some("m".into()),
                ..MonitorInfo::default()
            }],
            text: String::new(),
        };
        let mut out = Vec::new();
        let mut printer = Printer::new(&options);
        printer
            .record(&record, &command, &mut out)
            .expect("a Vec takes everything");
        String::from_utf8(out).expect("only text is written")
    }

    #[test]
    fn people_see_null_as_a_dash_and_the_unit() {
        let line = printed(Format::Human, &[], &[0.5, f64::NAN], "Real[2]");
        assert!(
            line.contains("line/move.pose") && line.contains("0.500000"),
            "{line}"
        );
        assert!(line.trim_end().ends_with("– m"), "{line}");
    }

    #[test]
    fn programs_see_null_as_null_with_cycle_and_stamp() {
        let line = printed(Format::Json, &[], &[0.5, f64::NAN], "Real[2]");
        let value: Value = serde_json::from_str(&line).expect("a line of JSON");
        assert_eq!(value["value"], json!([0.5, null]));
        assert_eq!(
            (&value["cycle"], &value["stamp_ns"]),
            (&json!(7), &json!(0))
        );
    }

    #[test]
    fn one_element_is_shown_alone() {
        let line = printed(Format::Json, &["line/move.pose[1]"], &[0.5, 2.5], "Real[2]");
        let value: Value = serde_json::from_str(&line).expect("a line of JSON");
        assert_eq!(
            (&value["name"], &value["value"]),
            (&json!("line/move.pose[1]"), &json!(2.5))
        );
    }

    #[test]
    fn a_monitor_is_selected_by_its_port_or_by_its_own_id() {
        for (pattern, shown) in [("line/move.*", true), ("*/watch", true), ("other/*", false)] {
            let line = printed(Format::Human, &[pattern], &[1.0], "Real");
            assert_eq!(!line.is_empty(), shown, "{pattern}");
        }
    }
}
