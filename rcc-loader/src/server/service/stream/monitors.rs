//! The monitored values of a stream: every record that the nets' `Monitor`s publish, in batches, without a request to the
//! executor. Run by the stream's worker thread.

use std::collections::{BTreeMap, HashMap};

use rcc_api::codes;
use rcc_api::error::ApiError;
use rcc_api::streams::{MonitorBatch, StreamMonitored};
use rcc_core::message::MonitorRecord;
use rcc_core::types::NULL_INT;
use rcc_ipc::Subscriber;
use rcc_language::names::MonitorNames;
use rcc_protocol::pattern::Pattern;
use serde_json::{Number, Value};

use crate::server::executor::{ExecutorConnection, ExecutorLink};
use crate::server::store::CommandStore;

/// Cycles without a record after which a message shows how far the stream is, as time in seconds.
const MARK_EVERY_S: f64 = 0.05;

/// Reads the records of one executor after the other.
pub(super) struct MonitorReader {
    patterns: Vec<Pattern>,
    records: Option<Subscriber<MonitorRecord>>,
    /// Incarnation of the executor whose records these are.
    incarnation: u64,
    next_sequence: Option<u64>,
    commands: HashMap<u64, CommandMonitors>,
    buffer: Vec<MonitorRecord>,
    /// Cycle of the last message.
    marked: u64,
}

/// The monitors of one command that match, by index; those that do not are `None`.
#[derive(Default)]
struct CommandMonitors {
    net: String,
    started_cycle: u64,
    monitors: Vec<Option<SelectedMonitor>>,
}

struct SelectedMonitor {
    port: String,
    ty: String,
    element: Option<usize>,
}

impl MonitorReader {
    /// Subscribes to the records of the living executor.
    ///
    /// # Errors
    /// Returns an error if a pattern is invalid, or if the executor has no room for another reader.
    pub fn open(
        ports: &[String],
        executor: &ExecutorLink,
        attached: &ExecutorConnection,
    ) -> Result<MonitorReader, ApiError> {
        let patterns = ports.iter().map(|port| {
            let pattern: Result<Pattern, _> = port.parse();
            pattern.map_err(|error| ApiError::new(codes::BAD_REQUEST, error.to_string(), ""))
        });
        let mut reader = MonitorReader {
            patterns: patterns.collect::<Result<_, _>>()?,
            records: None,
            incarnation: 0,
            next_sequence: None,
            commands: HashMap::new(),
            buffer: Vec::new(),
            marked: 0,
        };
        reader.subscribe(executor, attached)?;
        Ok(reader)
    }

    /// Subscribes to the records of this executor, if they are not read yet.
    ///
    /// # Errors
    /// Returns an error if it has no room for another reader.
    pub fn subscribe(
        &mut self,
        executor: &ExecutorLink,
        attached: &ExecutorConnection,
    ) -> Result<(), ApiError> {
        let incarnation = attached.announcement.incarnation;
        if self.incarnation != incarnation || self.records.is_none() {
            self.records = None;
            self.commands.clear();
            self.next_sequence = None;
            self.marked = 0;
            self.records = Some(executor.subscribe_records(attached)?);
            self.incarnation = incarnation;
        }
        Ok(())
    }

    /// Reads what has arrived. Returns the message about it, and the number of records that were lost; `None` while
    /// there is nothing to say.
    pub fn read(
        &mut self,
        attached: &ExecutorConnection,
        store: &CommandStore,
    ) -> (Option<StreamMonitored>, u64) {
        let status = attached.status();
        let mut records = std::mem::take(&mut self.buffer);
        if let Some(subscriber) = &mut self.records {
            // On an error the stream is opened again with the next executor.
            while subscriber.read_into(&mut records).unwrap_or(false) {}
        }
        let mut lost = 0;
        for record in &records {
            let expected = self.next_sequence.unwrap_or(record.sequence);
            lost += record.sequence.saturating_sub(expected);
            self.next_sequence = Some(record.sequence + 1);
        }
        let batches = self.batches(&records, attached, store);
        records.clear();
        self.buffer = records;
        let period_s = status.period_ns as f64 / 1e9;
        let is_due = status.cycle.saturating_sub(self.marked) as f64 * period_s >= MARK_EVERY_S;
        let message = (is_due || !batches.is_empty()).then_some(StreamMonitored {
            cycle: status.cycle,
            period_s,
            batches,
        });
        if message.is_some() {
            self.marked = status.cycle;
        }
        (message, lost)
    }

    /// Sorts the records that match by command and port.
    fn batches(
        &mut self,
        records: &[MonitorRecord],
        attached: &ExecutorConnection,
        store: &CommandStore,
    ) -> Vec<MonitorBatch> {
        let mut found: BTreeMap<(u64, u32), MonitorBatch> = BTreeMap::new();
        for record in records {
            let patterns = &self.patterns;
            let command = self
                .commands
                .entry(record.command)
                .or_insert_with(|| CommandMonitors::of(record.command, attached, store, patterns));
            let monitor = command.monitors.get(record.monitor as usize);
            let Some(Some(monitor)) = monitor else {
                continue;
            };
            let batch = found
                .entry((record.command, record.monitor))
                .or_insert_with(|| MonitorBatch {
                    id: record.command,
                    net: command.net.clone(),
                    port: monitor.port.clone(),
                    started_cycle: command.started_cycle,
                    cycles: Vec::new(),
                    values: Vec::new(),
                });
            batch.cycles.push(record.cycle);
            batch.values.push(monitor.value(record));
        }
        found.into_values().collect()
    }
}

impl CommandMonitors {
    fn of(
        id: u64,
        attached: &ExecutorConnection,
        store: &CommandStore,
        patterns: &[Pattern],
    ) -> CommandMonitors {
        let Some(names) = store.names(id) else {
            return CommandMonitors::default();
        };
        let row = attached.tables().command(id).copied();
        let monitors = names.monitors.iter();
        let monitors = monitors.map(|monitor| select(&names.net, monitor, patterns));
        CommandMonitors {
            started_cycle: row.map_or(0, |row| row.started_cycle),
            monitors: monitors.collect(),
            net: names.net,
        }
    }
}

/// Returns the monitor if a pattern matches it, by the observed port or by its own id.
fn select(net: &str, monitor: &MonitorNames, patterns: &[Pattern]) -> Option<SelectedMonitor> {
    let names = [&monitor.source, &monitor.primitive].map(|name| format!("{net}/{name}"));
    let mut matching = patterns
        .iter()
        .filter(|pattern| names.iter().any(|name| pattern.matches(name)));
    let element = matching.next()?.element;
    let width = monitor.width as usize;
    if element.is_some_and(|element| element >= width) {
        return None;
    }
    Some(SelectedMonitor {
        port: element.map_or_else(
            || monitor.source.clone(),
            |element| format!("{}[{element}]", monitor.source),
        ),
        ty: monitor.type_name.clone(),
        element,
    })
}

impl SelectedMonitor {
    /// Converts a record's value to JSON; null stays null, and a composite is null as a whole.
    fn value(&self, record: &MonitorRecord) -> Value {
        let kind = self.ty.split('[').next().unwrap_or_default();
        let width = (record.width as usize).min(record.values.len());
        let mut elements = record.values.get(..width).unwrap_or_default();
        let is_whole = !matches!(kind, "Real" | "Bool" | "Int");
        let json = |value: &f64| match kind {
            "Bool" if value.is_nan() => Value::Null,
            "Bool" => Value::Bool(*value != 0.0),
            "Int" => match value.to_bits().cast_signed() {
                NULL_INT => Value::Null,
                number => Value::from(number),
            },
            _ if value.is_infinite() => Value::from(value.to_string()),
            _ => Number::from_f64(*value).map_or(Value::Null, Value::Number),
        };
        if let Some(element) = self.element {
            elements = elements.get(element..=element).unwrap_or_default();
        }
        match elements {
            [one] if self.element.is_some() || !self.ty.contains('[') && !is_whole => json(one),
            all if is_whole && all.last().is_none_or(|last| last.is_nan()) => Value::Null,
            all => Value::Array(all.iter().map(json).collect()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use rcc_core::types::Store;

    fn monitor(source: &str, type_name: &str, width: u32) -> MonitorNames {
        MonitorNames {
            primitive: format!("watch_{}", source.replace('.', "_")),
            source: source.to_owned(),
            store: Store::Real,
            slot: 0,
            width,
            type_name: type_name.to_owned(),
            unit: None,
            rate_hz: 1000.0,
            every: 1,
            never_null: false,
        }
    }

    fn shown(pattern: &str, monitor: &MonitorNames, values: &[f64]) -> Option<(String, Value)> {
        let patterns: Vec<Pattern> = pattern.parse().into_iter().collect();
        let selected = select("line", monitor, &patterns)?;
        let mut record = MonitorRecord::zeroed();
        record.width = values.len() as u32;
        record.values[..values.len()].copy_from_slice(values);
        Some((selected.port.clone(), selected.value(&record)))
    }

    #[test]
    fn a_monitor_is_found_by_its_port_and_its_name_and_null_stays_null() {
        let done = monitor("move.done", "Bool", 1);
        let joints = monitor("move.joints", "Real[2]", 2);
        let pose = monitor("move.pose", "Pose", 7);
        for (pattern, monitor, values, port, value) in [
            ("line/*", &done, &[f64::NAN][..], "move.done", Value::Null),
            (
                "line/watch_move_done",
                &done,
                &[1.0],
                "move.done",
                true.into(),
            ),
            (
                "move.joints",
                &joints,
                &[0.5, f64::NAN],
                "move.joints",
                serde_json::json!([0.5, null]),
            ),
            (
                "line/move.joints[0]",
                &joints,
                &[0.5, 1.0],
                "move.joints[0]",
                serde_json::json!(0.5),
            ),
            (
                "*/move.pose",
                &pose,
                &[f64::NAN; 7],
                "move.pose",
                Value::Null,
            ),
        ] {
            let found = shown(pattern, monitor, values);
            assert_eq!(found, Some((port.to_owned(), value)), "{pattern}");
        }
        assert_eq!(shown("other/*", &done, &[1.0]), None);
        assert_eq!(shown("line/move.joints[2]", &joints, &[0.5, 1.0]), None);
    }
}
