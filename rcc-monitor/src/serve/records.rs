//! Reads the monitors' records while a page wants one of them: the executor's stream has few places, and without pages
//! this process takes none. Runs in a thread of its own, which polls shared memory.

use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rcc_core::message::MonitorRecord;
use rcc_protocol::pattern::Pattern;
use serde_json::{Value, json};

use super::hub::{Hub, Update};
use super::values::{Series, Source};
use rcc_protocol::element_kind::ElementKind;
use rcc_reading::names::CommandDirectory;
use rcc_reading::stream::ExecutorFollower;

/// Interval at which the stream is polled; its buffers hold more than 100 ms.
const LOOK_EVERY: Duration = Duration::from_millis(5);
/// Polling interval for wanted ports and for executors.
const IDLE: Duration = Duration::from_millis(100);
/// Pause after the stream could not be read.
const RETRY_AFTER: Duration = Duration::from_secs(2);

/// Starts the thread; it ends with the hub.
///
/// # Errors
/// Returns an error if the system cannot create a thread.
pub fn start(cell: &str, hub: Arc<Hub>) -> std::io::Result<JoinHandle<()>> {
    let cell = cell.to_owned();
    std::thread::Builder::new()
        .name("records".to_owned())
        .spawn(move || {
            while !hub.ends.load(Ordering::Acquire) {
                match hub.wanted().ports.is_empty() {
                    true => std::thread::sleep(IDLE),
                    false => follow(&cell, &hub),
                }
            }
        })
}

/// Follows the executors until no page wants a port any more.
fn follow(cell: &str, hub: &Hub) {
    let mut follower = ExecutorFollower::new(cell);
    let mut changes = hub.changes();
    let mut selection = Selection::default();
    while !hub.ends.load(Ordering::Acquire) {
        if changes.has_changed().unwrap_or(true) || selection.patterns.is_empty() {
            changes.mark_unchanged();
            selection = Selection::of(&hub.wanted().ports);
            if selection.patterns.is_empty() {
                return;
            }
        }
        match follower.poll() {
            Err(error) => {
                let told = json!({"records": error.to_string()});
                hub.send(Update::Shared("trouble", told.to_string().into()));
                let until = Instant::now() + RETRY_AFTER;
                while Instant::now() < until && !hub.ends.load(Ordering::Acquire) {
                    std::thread::sleep(IDLE);
                }
            }
            Ok(update) => {
                if update.changed.is_some() {
                    selection.known.clear();
                }
                if update.lost > 0 {
                    let lost = json!({"records": update.lost});
                    hub.send(Update::Shared("lost", lost.to_string().into()));
                }
                if let Some(names) = follower.names() {
                    update
                        .records
                        .iter()
                        .for_each(|record| selection.forward(record, names, hub));
                }
                if update.records.is_empty() {
                    std::thread::sleep(if follower.is_attached() {
                        LOOK_EVERY
                    } else {
                        IDLE
                    });
                }
            }
        }
    }
}

/// The wanted monitors.
#[derive(Default)]
struct Selection {
    patterns: Vec<Pattern>,
    /// Whether a monitor is wanted, by command and index.
    known: HashMap<(u64, u32), Option<Series>>,
}

impl Selection {
    fn of(ports: &[String]) -> Selection {
        let patterns = ports.iter().filter_map(|port| port.parse().ok());
        Selection {
            patterns: patterns.collect(),
            known: HashMap::new(),
        }
    }

    fn forward(&mut self, record: &MonitorRecord, names: &mut CommandDirectory, hub: &Hub) {
        let patterns = &self.patterns;
        let place = (record.command, record.monitor);
        let series = self.known.entry(place).or_insert_with(|| {
            let command = names.command(record.command);
            let monitor = command.monitors.get(record.monitor as usize)?;
            let series = Series {
                id: record.command,
                net: command.net.clone(),
                port: monitor.source.clone(),
                ty: monitor.ty.clone(),
                unit: monitor.unit.clone(),
                source: Source::Monitor,
            };
            let meant = patterns.iter().any(|pattern| series.is_meant_by(pattern));
            meant.then_some(series)
        });
        if let Some(series) = series {
            hub.collector
                .add(series, record.cycle, value(record, &series.ty));
        }
    }
}

/// Converts a record: one element as itself, several as a list; null is null.
fn value(record: &MonitorRecord, ty: &str) -> Value {
    let kind = ElementKind::of(ty);
    let width = (record.width as usize).min(record.values.len());
    match record.values.get(..width).unwrap_or_default() {
        [one] => kind.json(*one),
        all => all.iter().map(|element| kind.json(*element)).collect(),
    }
}
