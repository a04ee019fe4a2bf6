//! The messages about a cell, as a recording and a live viewer get them: the monitors of nets put together, the devices, the
//! arms, the events and the health of the cell. Run by the thread that writes or sends them; it follows the executors.

use rcc_core::counted::Counted;
use rcc_core::message::{CycleStatus, DeviceState, Tables};
use rcc_ipc::events::EventReader;
use rcc_os::{clock, wall};
use rcc_protocol::events::{Event, EventSeverity};
use rcc_recording::arm::{ViewedArm, urdf};
use rcc_recording::cdr::CdrWriter;
use rcc_recording::device::DeviceRecorder;
use rcc_recording::file::{AttachedText, ChannelInfo, RecordingError};
use rcc_recording::messages::{self, Diagnostic, DiagnosticLevel, LogLevel};
use rcc_recording::schemas::standard;
use rcc_recording::sink::{ChannelId, MessageSink, RecordingState};

use crate::names::CommandDirectory;
use crate::nets::NetRecorder;
use crate::selection::Selection;
use crate::source::{ExecutorFacts, SourceBatch};

/// Options of the messages.
#[derive(Clone, Debug)]
pub struct MessageOptions {
    /// Selected nets and ports.
    pub selection: Selection,
    /// Time between two messages that draw an arm, ns.
    pub view_every_ns: u64,
    /// Name of the program's own row among the diagnostics.
    pub reader: &'static str,
}

/// Counts of records and measurements that are missing, or rounded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct RecordLosses {
    /// Records of monitors that the stream or the queue lost.
    pub lost: u64,
    /// Measurements that were overwritten before they were read.
    pub missed: u64,
    /// Cycles of nets that were left out because records of them are lost.
    pub incomplete: u64,
    /// Int values beyond ±2^53, rounded.
    pub rounded: u64,
}

impl RecordLosses {
    /// Returns how many are missing.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.lost + self.missed + self.incomplete
    }
}

struct Channels {
    log: ChannelId,
    diagnostics: ChannelId,
    description: ChannelId,
}

/// Makes the messages about one cell.
pub struct CellMessages {
    options: MessageOptions,
    channels: Channels,
    nets: Option<NetRecorder>,
    devices: Vec<DeviceRecorder>,
    events: Option<EventReader>,
    /// Wall time minus monotonic time at the start, ns: fixed, so that times never go back.
    offset_ns: u64,
    losses: RecordLosses,
    /// Losses and late cycles at the last diagnosis.
    last: [u64; 2],
    state: RecordingState,
    out: CdrWriter,
}

impl CellMessages {
    /// Adds the channels that do not depend on nets and devices.
    #[must_use]
    pub fn new(sink: &mut dyn MessageSink, options: MessageOptions) -> CellMessages {
        let wall_ns = u64::try_from(wall::since_epoch().as_nanos()).unwrap_or(0);
        let mut channel = |topic: &str, schema: &str| {
            sink.channel(ChannelInfo {
                topic: topic.to_owned(),
                schema: standard(schema),
                metadata: Default::default(),
            })
        };
        let channels = Channels {
            log: channel("/rosout", "rcl_interfaces/Log"),
            diagnostics: channel("/diagnostics", "diagnostic_msgs/DiagnosticArray"),
            description: channel("/robot_description", "std_msgs/String"),
        };
        CellMessages {
            options,
            channels,
            nets: None,
            devices: Vec::new(),
            events: None,
            offset_ns: wall_ns.saturating_sub(clock::monotonic_ns()),
            losses: RecordLosses::default(),
            last: [0; 2],
            state: RecordingState::Open,
            out: CdrWriter::new(),
        }
    }

    /// Returns whether the sink can take more.
    pub fn state(&self) -> RecordingState {
        self.state
    }

    /// Returns what is missing so far, without what the net that is being read has lost.
    #[must_use]
    pub fn losses(&self) -> RecordLosses {
        self.losses
    }

    /// Returns the patterns of ports for which no net had a monitor.
    #[must_use]
    pub fn unmatched(&self) -> Vec<String> {
        self.options.selection.unmatched()
    }

    fn note(&mut self, state: RecordingState) {
        if state == RecordingState::Full {
            self.state = state;
        }
    }

    /// Writes what a poll has read.
    ///
    /// # Errors
    /// Fails if the sink does.
    pub fn batch(
        &mut self,
        sink: &mut dyn MessageSink,
        batch: &SourceBatch,
    ) -> Result<(), RecordingError> {
        if let Some(facts) = &batch.executor {
            self.attach(sink, facts)?;
        }
        self.losses.lost += batch.lost;
        self.losses.missed += batch.missed;
        let offset_ns = self.offset_ns;
        let wall = move |stamp_ns: u64| stamp_ns.saturating_add(offset_ns);
        for (index, measured) in &batch.measurements {
            let Some(device) = self.devices.get_mut(*index) else {
                continue;
            };
            let time_ns = measured.map_or_else(clock::monotonic_ns, |one| one.stamp_ns);
            let state = device.write(sink, wall(time_ns), measured.as_ref())?;
            self.note(state);
        }
        for record in &batch.records {
            let Some(nets) = &mut self.nets else { break };
            let state = nets.record(sink, record, &wall)?;
            self.note(state);
        }
        if let Some(status) = &batch.status {
            self.diagnose(sink, &status.0, &status.1)?;
        }
        if batch.gone {
            self.end_nets(sink)?;
        }
        Ok(())
    }

    /// Begins to write an executor's nets and devices.
    fn attach(
        &mut self,
        sink: &mut dyn MessageSink,
        facts: &ExecutorFacts,
    ) -> Result<(), RecordingError> {
        self.end_nets(sink)?;
        let directory = CommandDirectory::of(&facts.cell, facts.incarnation);
        self.nets = Some(NetRecorder::new(directory, self.options.selection.clone()));
        let state = facts.cell.state();
        self.events
            .get_or_insert_with(|| EventReader::open_at_end(&state));
        let time_ns = self.offset_ns + clock::monotonic_ns();
        if !facts.cell_text.is_empty() {
            let text = AttachedText {
                name: format!("{}.yaml", facts.cell.name()),
                media_type: "application/yaml".to_owned(),
                text: facts.cell_text.clone(),
            };
            sink.attach(text, time_ns)?;
        }
        let arms = facts.devices.iter().filter_map(|one| one.arm.clone());
        let arms: Vec<ViewedArm> = arms.collect();
        if !arms.is_empty() {
            messages::text(&mut self.out, &urdf(facts.cell.name(), &arms));
            let (channel, out) = (self.channels.description, self.out.bytes());
            let state = sink.write_kept(channel, time_ns, out)?;
            self.note(state);
        }
        let devices = facts.devices.iter().cloned();
        let view_every_ns = self.options.view_every_ns;
        self.devices = devices
            .map(|device| DeviceRecorder::new(sink, device, view_every_ns))
            .collect();
        Ok(())
    }

    /// Writes the last cycle of the nets of an executor that is gone.
    ///
    /// # Errors
    /// As [`CellMessages::batch`].
    pub fn end_nets(&mut self, sink: &mut dyn MessageSink) -> Result<(), RecordingError> {
        let offset_ns = self.offset_ns;
        if let Some(mut nets) = self.nets.take() {
            let wall = move |stamp_ns: u64| stamp_ns.saturating_add(offset_ns);
            let state = nets.flush(sink, &wall)?;
            nets.release(sink);
            self.note(state);
            self.losses.incomplete += nets.incomplete;
            self.losses.rounded += nets.rounded;
            self.options.selection = nets.selection;
        }
        Ok(())
    }

    /// Writes the events since the last call; call it once a second or more often.
    ///
    /// # Errors
    /// As [`CellMessages::batch`].
    pub fn write_events(&mut self, sink: &mut dyn MessageSink) -> Result<(), RecordingError> {
        let Some(events) = &mut self.events else {
            return Ok(());
        };
        // A log that cannot be read now is tried again.
        for event in events.poll().unwrap_or_default() {
            let now_ns = self.offset_ns + clock::monotonic_ns();
            let time_ns = time_of(&event).unwrap_or(now_ns);
            let level = match event.severity {
                EventSeverity::Info => LogLevel::Info,
                EventSeverity::Warning => LogLevel::Warning,
                EventSeverity::Error => LogLevel::Error,
            };
            let sentence = event.sentence(&|_, id| format!("#{id}"));
            let who = event.who();
            messages::log(&mut self.out, time_ns, level, [&who, &sentence]);
            let state = sink.write(self.channels.log, time_ns, self.out.bytes())?;
            self.note(state);
        }
        Ok(())
    }

    fn diagnose(
        &mut self,
        sink: &mut dyn MessageSink,
        status: &CycleStatus,
        tables: &Tables,
    ) -> Result<(), RecordingError> {
        let time_ns = self.offset_ns + clock::monotonic_ns();
        let incomplete = self.nets.as_ref().map_or(0, |nets| nets.incomplete);
        let losses = RecordLosses {
            incomplete: self.losses.incomplete + incomplete,
            ..self.losses
        };
        let new = [status.late, losses.count()];
        let mut parts = vec![executor(status, new[0] > self.last[0])];
        for (device, row) in self.devices.iter().zip(&tables.devices) {
            let state = DeviceState::from_number(row.state);
            parts.push(Diagnostic {
                level: match state {
                    DeviceState::Offline => DiagnosticLevel::Error,
                    _ => DiagnosticLevel::Ok,
                },
                name: format!("device {}", device.device().name),
                message: state.name().to_owned(),
                values: [
                    ("quality", f64::from(row.quality_permille) / 1000.0),
                    ("losses", row.losses as f64),
                ]
                .map(|(key, value)| (key.to_owned(), value.to_string()))
                .into(),
            });
        }
        parts.push(reader(self.options.reader, losses, new[1] > self.last[1]));
        self.last = new;
        messages::diagnostics(&mut self.out, time_ns, &parts);
        let (channel, out) = (self.channels.diagnostics, self.out.bytes());
        let state = sink.write(channel, time_ns, out)?;
        self.note(state);
        Ok(())
    }
}

fn time_of(event: &Event) -> Option<u64> {
    let time = rcc_protocol::events::since_epoch_of(&event.time)?;
    u64::try_from(time.as_nanos()).ok()
}

fn level(is_worse: bool) -> DiagnosticLevel {
    match is_worse {
        true => DiagnosticLevel::Warning,
        false => DiagnosticLevel::Ok,
    }
}

fn executor(status: &CycleStatus, is_late: bool) -> Diagnostic {
    let numbers = [
        ("cycle", status.cycle),
        ("period_ns", status.period_ns),
        ("late_cycles", status.late),
        ("skipped_periods", status.skipped_periods),
        ("worst_wake_ns", status.worst_wake_ns),
        ("exec_max_ns", status.exec_max_ns),
        ("running", u64::from(status.running)),
        ("dropped_records", status.dropped_records),
    ];
    Diagnostic {
        level: level(is_late),
        name: "executor".to_owned(),
        message: Counted(status.late, "late cycle").to_string(),
        values: numbers
            .map(|(key, value)| (key.to_owned(), value.to_string()))
            .into(),
    }
}

fn reader(name: &str, losses: RecordLosses, is_worse: bool) -> Diagnostic {
    let numbers = [
        ("lost_records", losses.lost),
        ("missed_measurements", losses.missed),
        ("incomplete_cycles", losses.incomplete),
    ];
    Diagnostic {
        level: level(is_worse),
        name: name.to_owned(),
        message: format!("{} lost", losses.count()),
        values: numbers
            .map(|(key, value)| (key.to_owned(), value.to_string()))
            .into(),
    }
}
