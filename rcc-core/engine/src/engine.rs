//! The work of one cycle of the real-time thread, without clock, boards and sleep: tests run the same code in virtual
//! time. Owns the command table, every running net and the commands of every device.
//!
//! Order within a cycle: latch inputs (by the caller, into [`Engine::latch`]) → requests → values between nets → nets →
//! guard → command images and tables → records. Nothing here allocates, locks, formats or calls the system.

mod admission;
mod devices;
mod handover;
mod lifecycle;
mod rates;
mod timing;
mod topics;

use bytemuck::Zeroable;
use rcc_core::frame::{DeviceInput, DeviceModel, DeviceOutput};
use rcc_core::guard::Guard;
use rcc_core::message::{
    COMMANDS_MAX, ClockStatus, CommandImage, CommandState, CycleStatus, DEVICES_MAX, DeviceState,
    FaultCode, FaultRecord, MAGIC, Measurement, SetPoint, Tables,
};
use rcc_core::plan::Resources;

use rcc_ipc::BoardReader;

use crate::net::Nets;
use crate::queue::{EngineEvent, EngineReply, EngineRequest, RtRingEnds};
use crate::record::FlightRecorder;
use handover::{Handover, rows};
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
    /// Base period, ns.
    pub period_ns: u64,
    /// Age at which a board counts as stale and its device as lost, ns.
    pub stale_after_ns: u64,
    /// Number of consecutive late cycles after which the most expensive net is terminated; 0: never.
    pub late_in_a_row_max: u32,
    /// Devices, in the order of the configuration.
    pub models: Vec<DeviceModel>,
}

/// One device in the engine.
#[derive(Debug)]
struct EngineDevice {
    guard: Guard,
    /// The engagement of the command that currently commands the arm.
    engagement: Option<Engagement>,
    /// Guard and engagement before a hand-over is tried, to restore them if it is refused.
    before_handover: (Guard, Option<Engagement>),
    /// Output of this cycle.
    output: DeviceOutput,
    image: Box<CommandImage>,
}

/// An uninterrupted sequence of cycles in which a net commands an arm.
#[derive(Clone, Copy, Debug)]
struct Engagement {
    row: usize,
    number: u64,
    since_cycle: u64,
    followed: bool,
    /// Logical time that the driver must have played before it follows this engagement and not the previous one, ns.
    follows_from_ns: u64,
}

/// A transition that a started or terminated row waits for.
#[derive(Clone, Copy, Debug, PartialEq)]
enum PendingTransition {
    Nothing,
    /// START was accepted; the first evaluation, in the net's next cycle, decides about it.
    Start {
        ticket: u64,
    },
    /// The net has ended, but its arms still play the last set-points.
    Settle {
        since_cycle: u64,
    },
}

/// Everything that the real-time thread owns.
#[derive(Debug)]
pub struct Engine {
    config: EngineConfig,
    dt_s: f64,
    /// Cycles between two writes of unchanged tables, at least 1.
    tables_every: u64,
    rings: RtRingEnds,
    inputs: Vec<DeviceInput>,
    devices: Vec<EngineDevice>,
    boards: Vec<Option<(u64, Box<BoardReader<Measurement>>)>>,
    nets: Box<Nets>,
    pending: [PendingTransition; COMMANDS_MAX],
    /// Bit r: row r is active or has a pending transition; all other rows have nothing to do in a cycle.
    busy: u64,
    /// Bit r: the net in row r, ready or active, subscribes to values of other nets.
    subscribers: u64,
    topics: Box<PublishedTopics>,
    /// A hand-over that waits until all nets that start are due; it is tried before the rows are evaluated.
    handover: Option<Handover>,
    status: CycleStatus,
    tables: Box<Tables>,
    tables_changed: bool,
    next_id: u64,
    next_engagement: u64,
    next_record: u64,
    time: CycleTimer,
    stopping: bool,
    recorder: Option<Box<FlightRecorder>>,
}

impl Engine {
    /// Allocates all memory of the real-time thread.
    pub fn new(config: EngineConfig, rings: RtRingEnds) -> Engine {
        let mut status = CycleStatus::zeroed();
        status.magic = MAGIC;
        status.incarnation = config.incarnation;
        status.period_ns = config.period_ns;
        status.clock = ClockStatus::OWN;
        let mut tables: Box<Tables> = bytemuck::zeroed_box();
        tables.magic = MAGIC;
        let absent = DeviceInput {
            present: false,
            measurement: Measurement::zeroed(),
        };
        let device = |model: &DeviceModel| {
            let image = CommandImage::new(config.incarnation, config.period_ns);
            let guard = Guard::new(model.limits, model.first_tolerance_rad)
                .with_impedance(model.impedance)
                .with_workspace(model.arm, model.workspace);
            EngineDevice {
                before_handover: (guard.clone(), None),
                guard,
                engagement: None,
                output: DeviceOutput::NONE,
                image: Box::new(image),
            }
        };
        Engine {
            dt_s: config.period_ns as f64 / 1e9,
            tables_every: (TABLES_EVERY_NS / config.period_ns.max(1)).max(1),
            rings,
            inputs: vec![absent; config.models.len()],
            devices: config.models.iter().take(DEVICES_MAX).map(device).collect(),
            boards: config.models.iter().map(|_| None).collect(),
            nets: Box::new([const { None }; COMMANDS_MAX]),
            pending: [PendingTransition::Nothing; COMMANDS_MAX],
            busy: 0,
            subscribers: 0,
            topics: PublishedTopics::new(),
            handover: None,
            status,
            tables,
            tables_changed: true,
            next_id: 1,
            next_engagement: 1,
            next_record: 1,
            time: CycleTimer::new(config.period_ns),
            stopping: false,
            recorder: None,
            config,
        }
    }

    /// Sets what the thread was granted, for the status (bits, see [`CycleStatus::grants`]).
    #[must_use]
    pub fn with_grants(mut self, grants: u32) -> Engine {
        self.status.grants = grants;
        self
    }

    /// Adds a flight recorder, which records everything that replay needs.
    #[must_use]
    pub fn recorded_by(mut self, recorder: FlightRecorder) -> Engine {
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

    /// The tables, as of the last cycle.
    pub fn tables(&self) -> &Tables {
        &self.tables
    }

    /// Returns true if the tables should be written in this cycle.
    pub fn tables_due(&self) -> bool {
        self.tables_changed || self.status.cycle.is_multiple_of(self.tables_every)
    }

    /// The measurement of a device that was latched for this cycle; `None` while the device is lost.
    pub fn measurement(&self, device: usize) -> Option<&Measurement> {
        let input = self.inputs.get(device)?;
        input.present.then_some(&input.measurement)
    }

    /// Sets the source of the cycles' time, for the status board.
    pub fn set_clock(&mut self, clock: ClockStatus) {
        self.status.clock = clock;
    }

    /// The command image of a device, which its driver reads.
    pub fn image(&self, device: usize) -> Option<&CommandImage> {
        self.devices.get(device).map(|device| &*device.image)
    }

    /// Returns true if no net is active.
    pub fn is_idle(&self) -> bool {
        self.status.running == 0
    }

    /// Begins to stop the engine: from now on no net is started; running nets are cancelled, or aborted if they cannot
    /// be cancelled.
    pub fn begin_stop(&mut self) {
        if !std::mem::replace(&mut self.stopping, true) {
            self.cancel_all();
        }
    }

    /// Latches all devices from their boards.
    pub fn latch_boards(&mut self, now_ns: u64) {
        for index in 0..self.boards.len() {
            let board = self.boards.get(index).and_then(Option::as_ref);
            let newest = board.map(|(incarnation, board)| (*incarnation, board.read()));
            self.latch(index, newest, now_ns);
        }
    }

    /// Runs one cycle, after the devices were latched. `now_ns` is the time at which it woke (CLOCK_MONOTONIC).
    pub fn cycle(&mut self, now_ns: u64) {
        self.status.cycle += 1;
        self.status.stamp_ns = now_ns;
        self.tables_changed = false;
        if let Some(recorder) = &mut self.recorder {
            recorder.begin(self.status.cycle, now_ns, &self.inputs);
        }
        self.time.begin(now_ns);
        for device in &mut self.devices {
            device.output = DeviceOutput::NONE;
        }
        self.take_requests();
        self.deliver(self.busy);
        let started_rows = self.try_handover(now_ns);
        for row in rows(self.busy & !started_rows) {
            self.run_row(row, now_ns);
        }
        self.select_next_timed_net();
        self.write_images(now_ns);
        self.write_tables();
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
    fn send_reply(&mut self, reply: EngineReply) {
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

    fn write_images(&mut self, now_ns: u64) {
        let sequence = self.status.cycle;
        for (device, input) in self.devices.iter_mut().zip(&self.inputs) {
            let image = &mut *device.image;
            image.head.seen = if input.present {
                input.measurement.sequence
            } else {
                0
            };
            let output = &device.output;
            let point = SetPoint {
                logical_ns: 0,
                owner: device.engagement.map_or(0, |engagement| engagement.number),
                has_position: u64::from(output.has_position),
                position: output.position,
                impedance: output.impedance,
                digital: output.digital,
                digital_commanded: output.digital_commanded,
                analog: output.analog,
            };
            image.push(sequence, now_ns, point);
        }
    }

    fn write_tables(&mut self) {
        self.tables.cycle = self.status.cycle;
        for row in rows(self.busy) {
            let entry = self.tables.commands.get(row);
            let active = entry.is_some_and(|entry| is_active(entry.state));
            if !active && self.pending.get(row) == Some(&PendingTransition::Nothing) {
                self.busy &= !(1 << row);
            }
        }
        self.status.running = self.busy.count_ones();
    }

    /// The resources that the net in `row` claims.
    fn claims(&self, row: usize) -> Option<&Resources> {
        self.nets.get(row)?.as_ref().map(|net| net.resources())
    }

    fn fault(&self, code: FaultCode) -> FaultRecord {
        FaultRecord {
            code: code as u32,
            cycle: self.status.cycle,
            ..FaultRecord::NONE
        }
    }

    /// State of a device as its driver reports it; offline if it is not present.
    fn device_state(&self, device: usize) -> DeviceState {
        match self.inputs.get(device) {
            Some(input) if input.present => DeviceState::from_number(input.measurement.state),
            _ => DeviceState::Offline,
        }
    }
}

fn is_active(state: u32) -> bool {
    CommandState::from_number(state).is_active()
}
