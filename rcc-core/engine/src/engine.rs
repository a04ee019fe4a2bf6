//! The work of one cycle of the real-time thread, without clock and sleep: tests run the same code in virtual time. Owns the
//! command table, every running net and the commands of every device.
//!
//! Order within a cycle: latch inputs (by the caller, into [`Engine::latch`]) → requests → conditions of rules → values
//! between nets → hand-overs, first that of a request, then those of rules → nets →
//! guard → set-points → records. Nothing here allocates, locks, formats or calls the system.
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::indexing_slicing
    )
)]

mod admission;
mod command_table;
mod devices;
mod handover;
mod leases;
mod lifecycle;
mod rates;
mod requests;
mod rule_checks;
mod rule_table;
mod rules;
mod timing;
mod topics;

use bytemuck::Zeroable;
use rcc_core::frame::DeviceModel;
use rcc_core::message::{
    COMMANDS_MAX, ClockStatus, CommandEntry, CommandImage, CycleStatus, FaultCode, FaultRecord,
    MAGIC, Measurement, Tables,
};

use rcc_protocol::rules::DisarmReason;

use crate::boards::{DeviceBoards, VirtualBoards};
use crate::queue::{EngineEvent, EngineReply, EngineRequest, RtRingEnds};
use crate::record::FlightRecorder;
use command_table::CommandTable;
use devices::Devices;
use handover::Handover;
use leases::LeaseTable;
use rule_table::RuleTable;
use timing::CycleTimer;
use topics::PublishedTopics;

/// Most requests that are taken in one cycle.
pub const REQUESTS_PER_CYCLE: usize = 8;
/// Longest time between two writes of the tables; they are also written when they change.
pub const TABLES_EVERY_NS: u64 = 16_000_000;
/// Longest time that a driver may take to follow its first set-points, and to settle after the last.
pub const SETTLE_MAX_NS: u64 = 1_000_000_000;

/// The engine's view of the cell's configuration.
#[derive(Clone, Debug)]
pub struct EngineConfig {
    /// Incarnation of this executor.
    pub incarnation: u64,
    /// Id of the first command, of the first rule and of the first lease: larger than any that an earlier executor of the
    /// cell gave.
    pub first_id: u64,
    /// Base period, ns.
    pub period_ns: u64,
    /// Age at which a board counts as stale and its device as lost, ns.
    pub stale_after_ns: u64,
    /// Number of consecutive late cycles after which the most expensive net is terminated; 0: never.
    pub late_in_a_row_max: u32,
    /// Devices, in the order of the configuration.
    pub models: Vec<DeviceModel>,
}

/// Everything that the real-time thread owns.
#[derive(Debug)]
pub struct Engine<B: DeviceBoards = VirtualBoards> {
    period_ns: u64,
    stale_after_ns: u64,
    late_in_a_row_max: u32,
    dt_s: f64,
    /// Cycles between two writes of unchanged tables, at least 1.
    tables_every: u64,
    rings: RtRingEnds<B>,
    devices: Devices<B>,
    commands: Box<CommandTable>,
    topics: Box<PublishedTopics>,
    /// A hand-over that waits until all nets that start are due; it is tried before the rows are evaluated.
    handover: Option<Handover>,
    rules: Box<RuleTable>,
    leases: Box<LeaseTable>,
    status: CycleStatus,
    /// The tables as last published.
    published: Box<Tables>,
    tables_changed: bool,
    next_id: u64,
    next_engagement: u64,
    next_record: u64,
    time: CycleTimer,
    stopping: bool,
    recorder: Option<Box<FlightRecorder>>,
}

impl Engine {
    /// Allocates all memory of an engine in virtual time.
    pub fn new(config: EngineConfig, rings: RtRingEnds) -> Engine {
        let image = || Box::new(CommandImage::new(config.incarnation, config.period_ns));
        let set_points = config.models.iter().map(|_| image()).collect();
        Engine::with_boards(config, rings, set_points)
    }

    /// The command image of a device, which its driver reads.
    pub fn image(&self, device: usize) -> Option<&CommandImage> {
        let (_, device) = self.devices.get(device)?;
        Some(device.set_points())
    }
}

impl<B: DeviceBoards> Engine<B> {
    /// Allocates all memory of the real-time thread. `set_points` are the boards of the devices in `config.models`, in
    /// the same order.
    pub fn with_boards(
        config: EngineConfig,
        rings: RtRingEnds<B>,
        set_points: Vec<B::SetPoints>,
    ) -> Engine<B> {
        let mut status = CycleStatus::zeroed();
        status.magic = MAGIC;
        status.incarnation = config.incarnation;
        status.period_ns = config.period_ns;
        status.clock = ClockStatus::OWN;
        Engine {
            period_ns: config.period_ns,
            stale_after_ns: config.stale_after_ns,
            late_in_a_row_max: config.late_in_a_row_max,
            dt_s: config.period_ns as f64 / 1e9,
            tables_every: (TABLES_EVERY_NS / config.period_ns.max(1)).max(1),
            rings,
            devices: Devices::new(&config, set_points),
            commands: CommandTable::new(),
            topics: PublishedTopics::new(),
            handover: None,
            rules: RuleTable::new(config.first_id),
            leases: Box::new(LeaseTable::new(config.first_id)),
            status,
            published: bytemuck::zeroed_box(),
            tables_changed: true,
            next_id: config.first_id,
            next_engagement: 1,
            next_record: 1,
            time: CycleTimer::new(config.period_ns),
            stopping: false,
            recorder: None,
        }
    }

    /// Sets what the thread was granted, for the status (bits, see [`CycleStatus::grants`]).
    #[must_use]
    pub fn with_grants(mut self, grants: u32) -> Engine<B> {
        self.status.grants = grants;
        self
    }

    /// Adds a flight recorder, which records everything that replay needs.
    #[must_use]
    pub fn recorded_by(mut self, recorder: FlightRecorder) -> Engine<B> {
        self.recorder = Some(Box::new(recorder));
        self
    }

    /// Hands over a recording that is frozen but still waits for its time; to be called before the engine ends.
    pub fn end_recording(&mut self) {
        if let Some(recorder) = &mut self.recorder {
            recorder.hand_over();
        }
    }

    /// The counters, as of the last cycle.
    pub fn status(&self) -> &CycleStatus {
        &self.status
    }

    /// The command and device tables, to be published.
    pub fn tables(&self) -> Tables {
        let mut tables = Tables::zeroed();
        (tables.magic, tables.cycle) = (MAGIC, self.status.cycle);
        for (place, row) in tables.commands.iter_mut().zip(self.commands.rows()) {
            *place = row.entry;
        }
        for (place, (_, device)) in tables.devices.iter_mut().zip(self.devices.iter()) {
            *place = device.entry;
        }
        tables
    }

    /// The published row of a command.
    pub fn command(&self, id: u64) -> Option<&CommandEntry> {
        let row = self.commands.find(id, |_| true).ok()?;
        Some(&self.commands[row].entry)
    }

    /// The tables, as [`Engine::tables`], if they must be written now: they changed since the last call, or it is time.
    /// Rows that were and are free are not copied.
    pub fn tables_due(&mut self) -> Option<&Tables> {
        let changed = std::mem::take(&mut self.tables_changed);
        if !changed && !self.status.cycle.is_multiple_of(self.tables_every) {
            return None;
        }
        let tables = &mut *self.published;
        (tables.magic, tables.cycle) = (MAGIC, self.status.cycle);
        for (place, row) in tables.commands.iter_mut().zip(self.commands.rows()) {
            if place.id != 0 || row.entry.id != 0 {
                *place = row.entry;
            }
        }
        for (place, (_, device)) in tables.devices.iter_mut().zip(self.devices.iter()) {
            *place = device.entry;
        }
        Some(tables)
    }

    /// The measurement of a device that was latched for this cycle; `None` while the device is lost.
    pub fn measurement(&self, device: usize) -> Option<&Measurement> {
        let (input, _) = self.devices.get(device)?;
        input.present.then_some(&input.measurement)
    }

    /// Sets the source of the cycles' time, for the status board.
    pub fn set_clock(&mut self, clock: ClockStatus) {
        self.status.clock = clock;
    }

    /// Returns true if no net is active.
    pub fn is_idle(&self) -> bool {
        self.status.running == 0
    }

    /// Begins to stop the engine: from now on no net is started; running nets are canceled, or aborted if they cannot
    /// be canceled.
    pub fn begin_stop(&mut self) {
        if !std::mem::replace(&mut self.stopping, true) {
            self.disarm_where(DisarmReason::Stopping, |_| true);
            self.cancel_all();
        }
    }

    /// Runs one cycle, after the devices were latched. `now_ns` is the time at which it woke (CLOCK_MONOTONIC).
    pub fn cycle(&mut self, now_ns: u64) {
        self.status.cycle += 1;
        self.status.stamp_ns = now_ns;
        let changed = self.devices.take_changed();
        if let Some(recorder) = &mut self.recorder {
            let (_, inputs) = self.devices.slices();
            recorder.begin(self.status.cycle, now_ns, (inputs, changed));
        }
        self.time.begin(now_ns);
        for (_, device) in self.devices.iter_mut() {
            device.begin_cycle();
        }
        self.take_requests();
        self.expire_leases();
        self.judge_rules();
        self.deliver(self.commands.busy);
        let started = self.try_handover(now_ns);
        let started = self.fire_rules(started, now_ns);
        for row in self.commands.busy.without(started).rows() {
            self.run_row(row, now_ns);
            self.account_net(row);
        }
        self.time.end_nets();
        self.select_next_timed_net();
        for (input, device) in self.devices.iter_mut() {
            device.write_set_point(input, self.status.cycle, now_ns);
        }
        self.commands.remove_idle();
        self.status.running = self.commands.busy.count();
    }

    fn take_requests(&mut self) {
        for _ in 0..REQUESTS_PER_CYCLE {
            // Each request has at most three replies, now or later; without room for them no request is taken, so none
            // is lost.
            if self.rings.replies.slots() < COMMANDS_MAX + 3 {
                return;
            }
            match self.rings.requests.pop() {
                // Requests behind a hand-over are executed after it was tried.
                Ok(request @ EngineRequest::Handover { .. }) => return self.execute(request),
                Ok(request) => self.execute(request),
                Err(_) => return,
            }
        }
    }

    /// Sends a reply to the intake thread. There is room: see [`Engine::take_requests`].
    fn send_reply(&mut self, reply: EngineReply<B>) {
        if let Err(rtrb::PushError::Full(reply)) = self.rings.replies.push(reply) {
            // Unreachable by the rule above; leaking is the only reaction that does not free memory here.
            std::mem::forget(reply);
        }
    }

    fn log(&mut self, event: EngineEvent) {
        if self.rings.events.push(event).is_err() {
            self.status.dropped_records += 1;
        }
    }

    fn fault(&self, code: FaultCode) -> FaultRecord {
        FaultRecord {
            code: code as u32,
            cycle: self.status.cycle,
            ..FaultRecord::NONE
        }
    }
}
