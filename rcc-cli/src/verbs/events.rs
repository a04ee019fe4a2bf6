//! `events`: shows the cell's event log: process deaths, lost devices, ended nets and their causes. Reads files of the
//! state folder, so it works while every process of the cell is dead, after its end and after a restart of the machine;
//! with `--url` it asks the loader.

mod filter;
mod late;
mod log;
mod view;

use rcc_api::bodies::DeviceView;
use rcc_api::codes;
use rcc_protocol::events::{Event, EventKind, EventSeverity};

use crate::context::Context;
use crate::failure::Failure;
use crate::interrupt::Interrupts;
use crate::kept_state::KeptState;
use crate::output::print_note;
use crate::supervisor::running;
use crate::table::counted;
use filter::{EventFilter, Since};
use log::EventLog;
use view::EventView;

/// Arguments of `events`.
#[derive(clap::Args, Debug, Default)]
pub struct Arguments {
    /// Keep printing new events until Ctrl-C or the end of the cell
    #[arg(long, short)]
    follow: bool,
    /// Only the last N lines
    #[arg(long, short = 'n', value_name = "N")]
    lines: Option<usize>,
    /// Also the events of earlier runs of the cell
    #[arg(long)]
    all: bool,
    /// Only events younger than a time (500ms, 10min, 3h, 2d), since a date (2026-11-23, 2026-11-23T16:35), or from an
    /// executor cycle on (3732)
    #[arg(long, value_name = "TIME|CYCLE")]
    since: Option<String>,
    /// Only events of at least this severity
    #[arg(long, value_name = "SEVERITY")]
    severity: Option<SeverityArgument>,
    /// Only events of this net: name, name#id or id
    #[arg(long, value_name = "NET")]
    net: Option<String>,
    /// Only events of this device, its driver, or this process
    #[arg(long, value_name = "NAME")]
    device: Option<String>,
}

/// Severity on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum SeverityArgument {
    /// Everything
    Info,
    /// Errors, and disturbances that the cell handled itself
    Warning,
    /// Losses of processes and devices, and nets that ended because of them
    Error,
}

impl From<SeverityArgument> for EventSeverity {
    fn from(given: SeverityArgument) -> EventSeverity {
        match given {
            SeverityArgument::Info => EventSeverity::Info,
            SeverityArgument::Warning => EventSeverity::Warning,
            SeverityArgument::Error => EventSeverity::Error,
        }
    }
}

/// Runs the verb.
///
/// # Errors
/// Fails if nothing is kept of such a cell, if its log cannot be read, if a filter names something unknown, or if Ctrl-C
/// ended the verb.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let mut filter = EventFilter::new(&arguments)?;
    // A cell at an address keeps its log there.
    let kept = match context.remote {
        Some(_) => None,
        None => Some(KeptState::find(context)?),
    };
    if let Some(kept) = &kept {
        if arguments.follow && kept.cell.is_none() {
            return Err(Failure::new(
                codes::NO_LOADER,
                format!("cell `{}` is not up: no events come", context.cell_name()),
                "leave out --follow to see the events that are kept of it, or start it with `rcc-cli up FILE`",
            ));
        }
        kept.note(context, "its events are");
    }
    let interrupts = Interrupts::listen()?;
    let mut log = EventLog::open(context, kept.as_ref())?;
    let mut batch = log.poll()?;
    // Sorts the events of several processes by time.
    batch.sort_by(|a, b| a.time.cmp(&b.time));
    filter.prepare(&batch);
    let devices = match (&kept, &arguments.device) {
        (Some(kept), _) => configured_devices(kept),
        (None, Some(_)) => devices_of(context)?,
        (None, None) => Vec::new(),
    };
    filter.require_known(&devices, arguments.follow)?;
    if !arguments.all && *filter.since() == Since::Always {
        let earlier = newest_run(&batch);
        if earlier > 0 {
            print_note(&format!(
                "{} of earlier runs not shown (--all)",
                counted(earlier as u64, "event")
            ));
        }
        batch.drain(..earlier);
    }
    let mut view = EventView::new(context.format, filter);
    view.show_kept(&batch, arguments.lines);
    // An end event among the kept ones may be of an earlier run: the cell runs as long as its runtime folder exists.
    let mut over = false;
    while arguments.follow && !over {
        if interrupts.asked() {
            view.end();
            return Err(Failure::interrupted());
        }
        // Without a cell nobody writes any more; what came last is read once more.
        over = kept.as_ref().is_some_and(|kept| {
            let cell = kept.cell.as_ref();
            cell.is_none_or(|cell| !cell.runtime_dir().is_dir())
        });
        std::thread::sleep(log.interval());
        batch = log.poll()?;
        batch.iter().for_each(|event| view.show_new(event));
        view.flush_if_due();
        over |= batch.iter().any(is_end);
    }
    view.end();
    if arguments.follow {
        let folder = kept.map(|kept| kept.state.path().display().to_string());
        print_note(&format!(
            "the cell has ended; its events stay in {}",
            folder
                .as_deref()
                .unwrap_or("the state folder of its machine")
        ));
    }
    if log.unreadable() > 0 {
        print_note(&format!(
            "skipped {} truncated or invalid lines of the log",
            log.unreadable()
        ));
    }
    Ok(())
}

/// Returns the devices of the cell at the address.
fn devices_of(context: &Context) -> Result<Vec<String>, Failure> {
    let devices: Vec<DeviceView> = context.client()?.get("/devices")?;
    Ok(devices.into_iter().map(|device| device.name).collect())
}

/// Returns the devices of the cell's configuration, which may not have had an event yet.
fn configured_devices(kept: &KeptState) -> Vec<String> {
    let config = kept.cell.as_ref().map(running::read);
    let config = config.and_then(Result::ok);
    config.map_or_else(Vec::new, |config| {
        config
            .devices
            .into_iter()
            .map(|device| device.name)
            .collect()
    })
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

#[cfg(test)]
mod tests;
