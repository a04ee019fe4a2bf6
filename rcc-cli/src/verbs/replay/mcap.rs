//! `replay --mcap`: an incident as an MCAP file with every port of its nets, the measurements of its devices, the times of
//! its cycles, and what happened. Written while the replay runs.

use std::collections::BTreeMap;
use std::iter::Peekable;
use std::path::Path;

use rcc_api::command_file::CommandFile;
use rcc_api::incident_nets::IncidentNet;
use rcc_core::fnv;
use rcc_core::message::{CommandState, EndReason};
use rcc_core::types::{NULL_BOOL, Store};
use rcc_engine::incident::Incident;
use rcc_engine::net::Net;
use rcc_engine::record::entry::{RecordEntries, RecordEntry, input_of};
use rcc_engine::replay::ReplayStep;
use rcc_protocol::events::{hex_digits, since_epoch_of};
use rcc_protocol::pattern::Pattern;
use rcc_recording::arm::{ViewedArm, urdf};
use rcc_recording::cdr::CdrWriter;
use rcc_recording::device::{DeviceRecorder, RecordedDevice};
use rcc_recording::file::{AttachedText, ChannelInfo, RecordingError};
use rcc_recording::messages::{self, LogLevel};
use rcc_recording::recording::{Recording, RecordingOptions, RecordingSummary, WhenFull};
use rcc_recording::schemas::standard;
use rcc_recording::sink::{ChannelId, MessageSink};
use rcc_recording::table::{Column, Table, TableKey, TableSubject, field_name};

use super::reason;

/// Time between two messages that draw an arm, ns.
const VIEW_EVERY_NS: u64 = 10_000_000;
/// Columns of the times of cycles.
const CYCLE_COLUMNS: [(&str, &str, &str); 3] = [
    ("wake_latency", "Real", "s"),
    ("execution", "Real", "s"),
    ("skipped_periods", "Int", ""),
];

/// The slots of one column.
#[derive(Clone, Copy, Debug)]
struct ColumnSlots {
    store: Store,
    first: usize,
    width: usize,
}

/// A net that is written.
struct WrittenNet {
    table: Table,
    channel: ChannelId,
    slots: Vec<ColumnSlots>,
}

/// Converts the time stamps of the cycles to times since 1970.
#[derive(Clone, Copy, Debug)]
struct WallClock {
    reason_ns: u64,
    reason_woke_ns: u64,
}

impl WallClock {
    /// The time of the reason is known as a text, and its cycle as a time stamp.
    fn of(incident: &Incident) -> WallClock {
        let (mut first, mut last, mut found) = (None, 0, None);
        for entry in RecordEntries::new(&incident.records).flatten() {
            if let RecordEntry::Cycle { cycle, woke_ns } = entry {
                first = first.or(Some(woke_ns));
                last = woke_ns;
                if cycle == incident.head.cycle {
                    found = Some(woke_ns);
                }
            }
        }
        WallClock {
            reason_ns: since_epoch_of(&incident.head.time)
                .map_or(0, |time| u64::try_from(time.as_nanos()).unwrap_or(0))
                // A time before the recording began would make times before 1970.
                .max(last - first.unwrap_or(last)),
            reason_woke_ns: found.unwrap_or(last),
        }
    }

    fn at(&self, woke_ns: u64) -> u64 {
        (self.reason_ns + woke_ns).saturating_sub(self.reason_woke_ns)
    }
}

/// Writes an incident.
pub struct IncidentRecording<'a> {
    recording: Recording,
    clock: WallClock,
    entries: Peekable<RecordEntries<'a>>,
    /// The cycle that the entries are at, and when it woke, ns since 1970.
    now: (u64, u64),
    from: u64,
    nets: BTreeMap<u64, WrittenNet>,
    titles: BTreeMap<u64, String>,
    devices: Vec<DeviceRecorder>,
    cycles: (Table, ChannelId),
    log: ChannelId,
    values: Vec<f64>,
    out: CdrWriter,
    rounded: u64,
    failed: Option<RecordingError>,
}

/// The selected part of an incident.
pub struct RecordedPart<'a> {
    /// The nets by id.
    pub nets: &'a BTreeMap<u64, IncidentNet>,
    /// Ports; all if empty.
    pub show: &'a [Pattern],
    /// First cycle.
    pub from: u64,
}

impl<'a> IncidentRecording<'a> {
    /// Creates the file; one that exists is replaced.
    ///
    /// # Errors
    /// Fails if the file cannot be written.
    pub fn create(
        path: &Path,
        incident: &'a Incident,
        part: &RecordedPart<'_>,
    ) -> Result<IncidentRecording<'a>, RecordingError> {
        let mut recording = Recording::create(RecordingOptions {
            path: path.to_owned(),
            replace: true,
            bytes_max: u64::MAX,
            when_full: WhenFull::Stop,
        })?;
        let clock = WallClock::of(incident);
        attach_texts(&mut recording, incident, clock.reason_ns)?;
        let devices = devices(&mut recording, incident);
        let arms = devices.iter().filter_map(|one| one.device().arm.clone());
        let arms: Vec<ViewedArm> = arms.collect();
        let mut out = CdrWriter::new();
        let start_ns = clock.at(0);
        if !arms.is_empty() {
            let channel =
                recording.channel(standard_channel("/robot_description", "std_msgs/String"));
            messages::text(&mut out, &urdf(&incident.head.cell, &arms));
            let _ = recording.write(channel, clock.reason_ns.min(start_ns.max(1)), out.bytes())?;
        }
        let nets = part.nets.iter().filter_map(|(id, named)| {
            let file = incident.files.get(id).map(Vec::as_slice);
            Some((*id, written_net(&mut recording, named, file, part.show)?))
        });
        let nets = nets.collect();
        let cycles = cycle_table();
        let channel = recording.channel(channel_of(&cycles));
        let log = recording.channel(standard_channel("/rosout", "rcl_interfaces/Log"));
        Ok(IncidentRecording {
            recording,
            clock,
            entries: RecordEntries::new(&incident.records).peekable(),
            now: (0, 0),
            from: part.from,
            nets,
            titles: part
                .nets
                .iter()
                .map(|(id, net)| (*id, net.title()))
                .collect(),
            devices,
            cycles: (cycles, channel),
            log,
            values: Vec::new(),
            out,
            rounded: 0,
            failed: None,
        })
    }

    /// Writes an evaluation, and before it what happened until then. An error is kept until [`IncidentRecording::finish`].
    pub fn step(&mut self, step: &ReplayStep<'_>) {
        if self.failed.is_some() {
            return;
        }
        let written = self.advance(Some(step.cycle)).and_then(|()| self.net(step));
        self.failed = written.err();
    }

    fn net(&mut self, step: &ReplayStep<'_>) -> Result<(), RecordingError> {
        let Some(net) = self.nets.get(&step.id).filter(|_| step.cycle >= self.from) else {
            return Ok(());
        };
        self.values.clear();
        for slots in &net.slots {
            push_values(step.net, *slots, &mut self.values);
        }
        let key = TableKey {
            cycle: step.cycle,
            command: step.id,
        };
        self.rounded += net.table.encode(key, &self.values, &mut self.out);
        let time_ns = self.clock.at(step.woke_ns);
        let _ = self
            .recording
            .write(net.channel, time_ns, self.out.bytes())?;
        Ok(())
    }

    /// Writes the entries up to and including this cycle.
    fn advance(&mut self, until: Option<u64>) -> Result<(), RecordingError> {
        while let Some(Ok(entry)) = self.entries.peek().copied() {
            if let RecordEntry::Cycle { cycle, woke_ns } = entry {
                if until.is_some_and(|until| cycle > until) {
                    break;
                }
                self.now = (cycle, self.clock.at(woke_ns));
            }
            self.entries.next();
            if self.now.0 >= self.from {
                self.entry(&entry)?;
            }
        }
        Ok(())
    }

    fn entry(&mut self, entry: &RecordEntry<'_>) -> Result<(), RecordingError> {
        let (cycle, time_ns) = self.now;
        let recording = &mut self.recording;
        match *entry {
            RecordEntry::Input { device, words } => {
                let Some(device) = self.devices.get_mut(device) else {
                    return Ok(());
                };
                let input = words.map(|words| input_of(Some(words)).measurement);
                let _ = device.write(recording, time_ns, input.as_ref())?;
            }
            RecordEntry::Times {
                wake_ns,
                exec_ns,
                skipped,
            } => {
                let values = [
                    wake_ns as f64 * 1e-9,
                    exec_ns as f64 * 1e-9,
                    f64::from_bits(skipped),
                ];
                let key = TableKey { cycle, command: 0 };
                let (table, channel) = &self.cycles;
                table.encode(key, &values, &mut self.out);
                let _ = recording.write(*channel, time_ns, self.out.bytes())?;
            }
            RecordEntry::State {
                id, state, reason, ..
            } => {
                let reason = EndReason::from_number(reason);
                let title = self.titles.get(&id).cloned();
                let title = title.unwrap_or_else(|| format!("#{id}"));
                let state = CommandState::from_number(state).name();
                let (level, words) = match reason {
                    EndReason::None => (LogLevel::Info, format!("{title}: {state}")),
                    EndReason::Fault => (LogLevel::Error, format!("{title}: {state}: fault")),
                    reason => (
                        LogLevel::Info,
                        format!("{title}: {state}: {}", reason.name()),
                    ),
                };
                messages::log(&mut self.out, time_ns, level, ["executor", &words]);
                let _ = recording.write(self.log, time_ns, self.out.bytes())?;
            }
            _ => {}
        }
        Ok(())
    }

    /// Writes the rest, up to cycle `until`, and ends the file. Returns what was written, and how many Ints were rounded.
    ///
    /// # Errors
    /// Fails if the file could not be written.
    pub fn finish(
        mut self,
        incident: &Incident,
        until: Option<u64>,
    ) -> Result<(RecordingSummary, u64), RecordingError> {
        if let Some(error) = self.failed.take() {
            return Err(error);
        }
        self.advance(until)?;
        let words = format!("incident: {}", reason(&incident.head));
        let time_ns = self.clock.reason_ns;
        messages::log(
            &mut self.out,
            time_ns,
            LogLevel::Error,
            ["recorder", &words],
        );
        let _ = self.recording.write(self.log, time_ns, self.out.bytes())?;
        Ok((self.recording.finish()?, self.rounded))
    }
}

fn standard_channel(topic: &str, schema: &str) -> ChannelInfo {
    ChannelInfo {
        topic: topic.to_owned(),
        schema: standard(schema),
        metadata: BTreeMap::new(),
    }
}

fn channel_of(table: &Table) -> ChannelInfo {
    ChannelInfo {
        topic: table.topic.clone(),
        schema: table.schema.clone(),
        metadata: table.metadata.clone(),
    }
}

fn cycle_table() -> Table {
    let subject = TableSubject {
        name: "executor cycles".to_owned(),
        topic: "/executor/cycles".to_owned(),
        metadata: [("device".to_owned(), "executor".to_owned())].into(),
    };
    let columns = CYCLE_COLUMNS.map(|(name, type_name, unit)| Column {
        name: name.to_owned(),
        type_name: type_name.to_owned(),
        unit: (!unit.is_empty()).then(|| unit.to_owned()),
        width: 1,
        never_null: true,
    });
    Table::new(subject, columns.into())
}

fn devices(recording: &mut Recording, incident: &Incident) -> Vec<DeviceRecorder> {
    let rows = incident.head.devices.iter().zip(&incident.models);
    let devices = rows.map(|(name, model)| RecordedDevice {
        name: name.clone(),
        arm: model
            .arm
            .map(|arm| ViewedArm::new(name, model.base, arm, model.limits)),
        channels: RecordedDevice::unnamed_channels(model.channels),
    });
    devices
        .map(|device| DeviceRecorder::new(recording, device, VIEW_EVERY_NS))
        .collect()
}

/// Attaches the head of the incident and the text of each net.
fn attach_texts(
    recording: &mut Recording,
    incident: &Incident,
    time_ns: u64,
) -> Result<(), RecordingError> {
    let head = serde_json::to_string_pretty(&incident.head).unwrap_or_default();
    let text = |name: String, media_type: &str, text: String| AttachedText {
        name,
        media_type: media_type.to_owned(),
        text,
    };
    recording.attach(
        text("incident.json".into(), "application/json", head),
        time_ns,
    )?;
    for (id, bytes) in &incident.files {
        let Ok(file) = serde_json::from_slice::<CommandFile>(bytes) else {
            continue;
        };
        let name = format!("{}-{id}.yaml", field_name(&file.net));
        recording.attach(text(name, "application/yaml", file.text), time_ns)?;
    }
    Ok(())
}

/// Makes the table of a net; `None` if no port is to be written.
fn written_net(
    recording: &mut Recording,
    named: &IncidentNet,
    file: Option<&[u8]>,
    show: &[Pattern],
) -> Option<WrittenNet> {
    let (mut columns, mut slots) = (Vec::new(), Vec::new());
    for primitive in &named.names.primitives {
        for port in &primitive.outputs {
            let name = format!("{}.{}", primitive.id, port.name);
            let full = format!("{}/{name}", named.net);
            if !show.is_empty() && !show.iter().any(|pattern| pattern.matches(&full)) {
                continue;
            }
            let width = port.width as usize;
            columns.push(Column {
                name,
                type_name: port.type_name.to_string(),
                unit: port.unit.as_deref().map(str::to_owned),
                width,
                never_null: primitive.never_null,
            });
            slots.push(ColumnSlots {
                store: port.store,
                first: port.slot as usize,
                width,
            });
        }
    }
    if columns.is_empty() {
        return None;
    }
    let file = file.and_then(|bytes| serde_json::from_slice::<CommandFile>(bytes).ok());
    let text = file.unwrap_or_default().text;
    let hash = hex_digits(fnv::add(fnv::EMPTY, text.as_bytes()));
    let subject = TableSubject {
        name: named.net.clone(),
        topic: format!("/nets/{}", field_name(&named.net)),
        metadata: [
            ("net".to_owned(), named.net.clone()),
            ("net_hash".to_owned(), hash),
        ]
        .into(),
    };
    let table = Table::new(subject, columns);
    let channel = recording.channel(channel_of(&table));
    Some(WrittenNet {
        table,
        channel,
        slots,
    })
}

/// Appends the elements of a column, as a table takes them.
fn push_values(net: &Net, slots: ColumnSlots, values: &mut Vec<f64>) {
    let (reals, bools, ints) = net.arenas();
    let range = slots.first..slots.first + slots.width;
    match slots.store {
        Store::Real => values.extend(reals.get(range).unwrap_or_default()),
        Store::Bool => {
            let bools = bools.get(range).unwrap_or_default();
            values.extend(bools.iter().map(|value| match value & NULL_BOOL {
                0 => f64::from(*value),
                _ => f64::NAN,
            }));
        }
        Store::Int => {
            let ints = ints.get(range).unwrap_or_default();
            values.extend(
                ints.iter()
                    .map(|value| f64::from_bits(value.cast_unsigned())),
            );
        }
    }
}
