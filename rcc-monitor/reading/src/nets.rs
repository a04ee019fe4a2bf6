//! Puts the records of monitors together again: all monitors of a net that have the same rate are one table, and what they
//! saw in one cycle is one message. A cycle of which records are lost is not written, so that lost is never null. Run by the
//! thread that writes.

use std::collections::HashMap;

use rcc_core::fnv;
use rcc_core::message::MonitorRecord;
use rcc_protocol::events::hex_digits;
use rcc_recording::cdr::CdrWriter;
use rcc_recording::file::{AttachedText, ChannelInfo, RecordingError};
use rcc_recording::recording::NET_HASH;
use rcc_recording::sink::{ChannelId, MessageSink, RecordingState};
use rcc_recording::table::{Column, Table, TableKey, TableSubject, field_name};

use crate::names::{CommandDirectory, CommandNames, MonitorInfo};
use crate::selection::Selection;

/// Nets that are kept; the executor has places for 64 commands. Beyond it all are forgotten, and those that live are found
/// again.
const NETS_MAX: usize = 256;

/// The monitors of a net that have one rate.
struct MonitorTable {
    /// Index of the monitor, and the place of its first element in a message.
    monitors: Vec<(u32, usize)>,
    table: Table,
    channel: ChannelId,
    /// Elements of the cycle that is being put together.
    values: Vec<f64>,
    filled: usize,
}

/// The net of a command; empty if it is not recorded.
#[derive(Default)]
struct RecordedNet {
    tables: Vec<MonitorTable>,
}

/// Writes the monitors of nets.
pub struct NetRecorder {
    /// Selected nets and ports.
    pub selection: Selection,
    directory: CommandDirectory,
    nets: HashMap<u64, RecordedNet>,
    /// The cycle that is being put together: command, cycle, and its time stamp.
    open: Option<(u64, u64, u64)>,
    out: CdrWriter,
    /// Cycles of tables that were not written because records of them are lost.
    pub incomplete: u64,
    /// Ints that were rounded.
    pub rounded: u64,
}

/// Converts time stamps of the cell to times since 1970.
pub type WallTime<'a> = &'a dyn Fn(u64) -> u64;

impl NetRecorder {
    /// Writes the selected nets and ports of one executor.
    #[must_use]
    pub fn new(directory: CommandDirectory, selection: Selection) -> NetRecorder {
        NetRecorder {
            selection,
            directory,
            nets: HashMap::new(),
            open: None,
            out: CdrWriter::new(),
            incomplete: 0,
            rounded: 0,
        }
    }

    /// Writes a record together with the others of its cycle, as soon as the next cycle begins.
    ///
    /// # Errors
    /// Fails if the file cannot be written.
    pub fn record(
        &mut self,
        sink: &mut dyn MessageSink,
        record: &MonitorRecord,
        wall: WallTime<'_>,
    ) -> Result<RecordingState, RecordingError> {
        let mut state = RecordingState::Open;
        let here = (record.command, record.cycle, record.stamp_ns);
        if self.open.is_some_and(|open| open != here) {
            state = self.flush(sink, wall)?;
        }
        if !self.nets.contains_key(&record.command) {
            if self.nets.len() >= NETS_MAX {
                state = self.flush(sink, wall)?;
                self.release(sink);
                self.directory.forget();
            }
            let names = self.directory.command(record.command);
            let net = recorded_net(sink, names, &mut self.selection, wall(record.stamp_ns))?;
            self.nets.insert(record.command, net);
        }
        self.open = Some(here);
        let net = self.nets.entry(record.command).or_default();
        for table in &mut net.tables {
            let place = table
                .monitors
                .iter()
                .find(|(index, _)| *index == record.monitor);
            let Some((_, first)) = place else { continue };
            let width = (record.width as usize).min(record.values.len());
            let places = table.values.iter_mut().skip(*first).take(width);
            for (place, value) in places.zip(record.values) {
                *place = value;
            }
            table.filled += 1;
        }
        Ok(state)
    }

    /// Forgets all nets; the sink need not keep their channels.
    pub fn release(&mut self, sink: &mut dyn MessageSink) {
        for net in std::mem::take(&mut self.nets).into_values() {
            let channels: Vec<ChannelId> = net.tables.iter().map(|table| table.channel).collect();
            sink.release(&channels);
        }
    }

    /// Writes the cycle that is being put together.
    ///
    /// # Errors
    /// Fails if the file cannot be written.
    pub fn flush(
        &mut self,
        sink: &mut dyn MessageSink,
        wall: WallTime<'_>,
    ) -> Result<RecordingState, RecordingError> {
        let mut state = RecordingState::Open;
        let Some((command, cycle, stamp_ns)) = self.open.take() else {
            return Ok(state);
        };
        let Some(net) = self.nets.get_mut(&command) else {
            return Ok(state);
        };
        for table in &mut net.tables {
            let filled = std::mem::take(&mut table.filled);
            if filled == table.monitors.len() {
                let key = TableKey { cycle, command };
                self.rounded += table.table.encode(key, &table.values, &mut self.out);
                state = sink.write(table.channel, wall(stamp_ns), self.out.bytes())?;
            } else if filled > 0 {
                self.incomplete += 1;
            }
        }
        Ok(state)
    }
}

/// Makes the tables of a net, and attaches its text.
fn recorded_net(
    sink: &mut dyn MessageSink,
    names: &CommandNames,
    selection: &mut Selection,
    time_ns: u64,
) -> Result<RecordedNet, RecordingError> {
    if !selection.has_net(&names.net) {
        return Ok(RecordedNet::default());
    }
    let monitors = selection.monitors(&names.net, &names.monitors);
    if monitors.is_empty() && !names.monitors.is_empty() {
        return Ok(RecordedNet::default());
    }
    let hash = hex_digits(fnv::add(fnv::EMPTY, names.text.as_bytes()));
    if !names.text.is_empty() {
        let text = AttachedText {
            name: format!("{}-{hash}.yaml", field_name(&names.net)),
            media_type: "application/yaml".to_owned(),
            text: names.text.clone(),
        };
        sink.attach(text, time_ns)?;
    }
    let mut rates: Vec<u32> = monitors.iter().map(|(_, one)| one.every).collect();
    rates.sort_unstable();
    rates.dedup();
    let tables = rates.iter().enumerate().map(|(number, every)| {
        let monitors = monitors.iter().copied();
        let monitors = monitors.filter(|(_, monitor)| monitor.every == *every);
        let mut topic = format!("/nets/{}", field_name(&names.net));
        if number > 0 {
            topic.push_str(&format!("/every_{every}"));
        }
        let subject = TableSubject {
            name: names.net.clone(),
            topic,
            metadata: [
                ("net".to_owned(), names.net.clone()),
                (NET_HASH.to_owned(), hash.clone()),
                ("every".to_owned(), every.to_string()),
            ]
            .into(),
        };
        monitor_table(sink, subject, monitors)
    });
    Ok(RecordedNet {
        tables: tables.collect(),
    })
}

fn monitor_table<'a>(
    sink: &mut dyn MessageSink,
    subject: TableSubject,
    monitors: impl Iterator<Item = (u32, &'a MonitorInfo)>,
) -> MonitorTable {
    let (mut places, mut columns, mut width) = (Vec::new(), Vec::new(), 0);
    for (index, monitor) in monitors {
        places.push((index, width));
        width += monitor.width as usize;
        columns.push(Column {
            name: monitor.source.clone(),
            type_name: monitor.ty.clone(),
            unit: monitor.unit.clone(),
            width: monitor.width as usize,
            never_null: monitor.never_null,
        });
    }
    let table = Table::new(subject, columns);
    let channel = sink.channel(ChannelInfo {
        topic: table.topic.clone(),
        schema: table.schema.clone(),
        metadata: table.metadata.clone(),
    });
    MonitorTable {
        monitors: places,
        values: vec![f64::NAN; width],
        table,
        channel,
        filled: 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use rcc_ipc::Cell;
    use rcc_recording::read::{ReadEnd, read};
    use rcc_recording::recording::{Recording, RecordingOptions, WhenFull};

    const FILE: &str = r#"{"net": "line", "text": "net: line\n", "names": {"monitors": [
        {"primitive": "a", "source": "move.way", "type": "Real", "unit": "m", "width": 1, "every": 1},
        {"primitive": "b", "source": "touch.out", "type": "Bool", "width": 1, "every": 1},
        {"primitive": "c", "source": "count.out", "type": "Int[2]", "width": 2, "every": 10}]}}"#;

    fn record(cycle: u64, monitor: u32, values: &[f64]) -> MonitorRecord {
        let mut record = MonitorRecord {
            cycle,
            stamp_ns: cycle * 1_000_000,
            command: 7,
            monitor,
            width: values.len() as u32,
            ..MonitorRecord::zeroed()
        };
        record.values[..values.len()].copy_from_slice(values);
        record
    }

    /// Writes these records of the net and returns the rows of each topic, and how many cycles were left out.
    fn recorded(
        records: &[MonitorRecord],
        nets: &[&str],
        ports: &[&str],
    ) -> (Vec<String>, u64, Vec<String>) {
        let folder = rcc_testing::folder();
        let cell = Cell::at("test", folder.path()).expect("a cell");
        let commands = cell.commands_dir().join(format!("{:016x}", 5));
        std::fs::create_dir_all(&commands).expect("a folder");
        std::fs::write(commands.join("7.json"), FILE).expect("a file");
        let path = folder.path().join("out.mcap");
        let mut recording = Recording::create(RecordingOptions {
            path: path.clone(),
            replace: false,
            bytes_max: 1 << 30,
            when_full: WhenFull::Stop,
        })
        .expect("a file");
        let selection = Selection {
            nets: nets.iter().filter_map(|one| one.parse().ok()).collect(),
            ports: ports.iter().filter_map(|one| one.parse().ok()).collect(),
        };
        let mut nets = NetRecorder::new(CommandDirectory::of(&cell, 5), selection);
        let wall = |stamp_ns: u64| stamp_ns + 1;
        for record in records {
            let _ = nets.record(&mut recording, record, &wall).expect("written");
        }
        let _ = nets.flush(&mut recording, &wall).expect("written");
        recording.finish().expect("written");
        let mut rows = Vec::new();
        let end = read(&path, |table, _, time_ns, row| {
            assert_eq!(
                (row.key.command, time_ns),
                (7, row.key.cycle * 1_000_000 + 1)
            );
            rows.push(format!(
                "{} {} {:?}",
                table.topic, row.key.cycle, row.values
            ));
        });
        assert_eq!(end.expect("a recording"), ReadEnd::Complete);
        (rows, nets.incomplete, nets.selection.unmatched())
    }

    #[test]
    fn monitors_of_one_rate_are_one_message_and_a_cycle_with_losses_is_left_out() {
        let int = |value: i64| f64::from_bits(value as u64);
        let records = [
            record(1, 0, &[0.5]),
            record(1, 1, &[1.0]),
            record(1, 2, &[int(-3), int(i64::MIN)]),
            record(2, 0, &[f64::NAN]),
            record(2, 1, &[f64::NAN]),
            // The record of the other monitor is lost.
            record(3, 0, &[0.7]),
            record(4, 0, &[0.8]),
            record(4, 1, &[0.0]),
        ];
        let (rows, incomplete, _) = recorded(&records, &[], &[]);
        let expected = [
            "/nets/line 1 [0.5, 1.0]",
            "/nets/line/every_10 1 [-3.0, NaN]",
            "/nets/line 2 [NaN, NaN]",
            "/nets/line 4 [0.8, 0.0]",
        ];
        assert_eq!((rows, incomplete), (expected.map(str::to_owned).into(), 1));
    }

    #[test]
    fn other_nets_are_not_recorded() {
        let records = [record(1, 0, &[0.5]), record(1, 1, &[1.0])];
        assert_eq!(recorded(&records, &["li*"], &[]).0.len(), 1);
        let none = (Vec::new(), 0, Vec::new());
        assert_eq!(recorded(&records, &["other"], &[]), none);
    }

    #[test]
    fn only_the_selected_ports_are_recorded_and_patterns_without_a_monitor_are_told() {
        let records = [
            record(1, 0, &[0.5]),
            record(1, 1, &[1.0]),
            record(1, 2, &[1.0, 2.0]),
            record(2, 0, &[0.6]),
            record(2, 1, &[0.0]),
        ];
        let (rows, incomplete, unmatched) =
            recorded(&records, &[], &["line/move.*", "line/none.out", "other/*"]);
        assert_eq!(rows, ["/nets/line 1 [0.5]", "/nets/line 2 [0.6]"]);
        assert_eq!(
            (incomplete, unmatched),
            (0, vec!["line/none.out".into(), "other/*".into()])
        );
        // Both selections apply.
        let (rows, _, unmatched) = recorded(&records, &["other"], &["line/*"]);
        assert_eq!((rows.len(), unmatched.len()), (0, 1));
    }
}
