//! Runs a net in virtual time without a cell: the executor's own engine against simple device models. One cycle is one
//! step, so the same net and inputs give the same values, as fast as the machine computes. Runs on the caller's thread.

use std::io::{self, Write};

use rcc_config::CellConfig;
use rcc_core::frame::{DeviceInput, DeviceModel};
use rcc_core::message::{CommandEntry, CommandState, Joints, MonitorRecord};
use rcc_engine::engine::{Engine, EngineConfig};
use rcc_engine::net::Net;
use rcc_engine::queue::{EngineEvent, EngineReply, EngineRequest, HelperRingEnds, rings};
use rcc_engine::rehearsal::{RehearsalScene, rehearse};
use rcc_language::names::Names;
use rcc_protocol::control::{Answer, InputValue, PlanData, Refusal};
use rcc_protocol::rehearsal::RehearsalReport;
use thiserror::Error;

mod arguments;
pub mod arm;
pub mod contact;
pub mod device;
pub mod dynamics;
pub mod reading;
pub mod script;
pub mod settings;
pub mod task;
pub mod trace;
pub mod tracks;
pub mod wall;

use device::SimulatedDevice;
use script::ScriptStep;
use trace::MonitorTrace;

/// Id of the only command; the engine counts from 1.
const ID: u64 = 1;
/// Tickets of LOAD's second half and of START.
const INSTALL: u64 = 1;
const START: u64 = 2;
const SET: u64 = 3;
/// Number of tickets whose answers are read.
const TICKETS: usize = 4;

/// Events and limits of a simulation.
#[derive(Clone, Debug, Default)]
pub struct SimulationOptions {
    /// Longest logical time, ns.
    pub limit_ns: u64,
    /// Logical time of CANCEL (ABORT for a net without Cancel), ns.
    pub cancel_at_ns: Option<u64>,
    /// Events of devices.
    pub steps: Vec<ScriptStep>,
    /// Values of the net's inputs, and the logical times at which they are set, ns.
    pub values: Vec<(u64, InputValue)>,
    /// Run the net even if its rehearsal breaks a limit, to show how.
    pub despite_refusal: bool,
}

/// Result of a simulation.
#[derive(Debug)]
pub struct SimulationResult {
    /// Final row of the command.
    pub command: CommandEntry,
    /// Cycles since START.
    pub cycles: u64,
    /// Period, ns.
    pub period_ns: u64,
    /// Values recorded by monitors.
    pub trace: MonitorTrace,
    /// Result of the rehearsal; `None` if the net commands no arm.
    pub rehearsed: Option<RehearsalReport>,
    /// The limit broken in the rehearsal, if the net was run regardless.
    pub foreseen: Option<Refusal>,
}

/// Called with the time since START (s), the engine and the devices after each cycle.
pub type CycleObserver<'w> = &'w mut dyn FnMut(f64, &Engine, &[SimulatedDevice]);

/// Reason why a net cannot be simulated.
#[derive(Debug, Error)]
pub enum SimulateError {
    /// Refused as by an executor.
    #[error("the net is refused: {0:?}")]
    Refused(Refusal),
    /// The table of values cannot be written.
    #[error("cannot write the values: {0}")]
    Write(#[from] io::Error),
    /// The engine did not answer; this never happens.
    #[error("the engine did not answer")]
    Silent,
}

/// The engine and its devices in a common virtual time.
struct VirtualCell {
    engine: Engine,
    ends: HelperRingEnds,
    devices: Vec<SimulatedDevice>,
    now_ns: u64,
    period_ns: u64,
    answers: [Option<Answer>; TICKETS],
    /// Events since the last time that they were taken, if they are kept.
    events: Vec<EngineEvent>,
    keeps_events: bool,
}

impl VirtualCell {
    fn new(config: &CellConfig) -> VirtualCell {
        let (rt, ends) = rings();
        let period_ns = config.period_ns;
        let engine = EngineConfig {
            incarnation: 1,
            first_id: 1,
            period_ns,
            stale_after_ns: config.stale_after_ns.max(2 * period_ns),
            late_in_a_row_max: 0,
            models: config.models(),
        };
        let devices = config
            .devices
            .iter()
            .map(|device| SimulatedDevice::new(device, &config.simulators, period_ns));
        VirtualCell {
            engine: Engine::new(engine, rt),
            ends,
            devices: devices.collect(),
            now_ns: 0,
            period_ns,
            answers: [const { None }; TICKETS],
            events: Vec::new(),
            keeps_events: false,
        }
    }

    /// Runs one cycle: first every device exchanges, then the engine.
    fn step(&mut self) {
        self.now_ns += self.period_ns;
        let started = self.engine.status().cycle > 0;
        for (index, device) in self.devices.iter_mut().enumerate() {
            let image = self.engine.image(index).filter(|_| started);
            device.exchange(image, self.now_ns);
            let newest = Some((1, *device.measurement()));
            self.engine.latch(index, newest, self.now_ns);
        }
        self.engine.cycle(self.now_ns);
        self.engine.account(0, 0, 0);
        while let Ok(outcome) = self.ends.replies.pop() {
            if let EngineReply::Answer { ticket, answer } = outcome
                && let Some(slot) = self.answers.get_mut(ticket as usize)
            {
                *slot = Some(answer);
            }
        }
        while let Ok(event) = self.ends.events.pop() {
            if self.keeps_events {
                self.events.push(event);
            }
        }
    }

    fn order(&mut self, order: EngineRequest) -> Result<(), SimulateError> {
        // The ring is empty before each step; only orders made here take space.
        self.ends
            .requests
            .push(order)
            .map_err(|_| SimulateError::Silent)
    }

    fn holds(&self) -> Vec<Option<Joints>> {
        self.devices.iter().map(SimulatedDevice::hold).collect()
    }

    fn command(&self) -> Option<&CommandEntry> {
        self.engine.command(ID)
    }

    fn state(&self) -> CommandState {
        self.command().map_or(CommandState::None, |row| {
            CommandState::from_number(row.state)
        })
    }

    /// Returns the refusal of LOAD, START or SET, if any.
    fn refusal(&self) -> Option<Refusal> {
        self.answers.iter().find_map(|answer| match answer {
            Some(Answer::Refused(refusal)) => Some(*refusal),
            _ => None,
        })
    }
}

/// Returns the hold set-points (rad, by device) of arms at rest where they are simulated.
#[must_use]
pub fn holds(config: &CellConfig) -> Vec<Option<Joints>> {
    let mut cell = VirtualCell::new(config);
    // One cycle without a net, so that the engine has seen the devices.
    cell.step();
    cell.holds()
}

/// Runs a net until it is terminated or the time is over. `table` receives the monitored values, one line per cycle in
/// which a monitor is due.
///
/// # Errors
/// Fails if the net is refused or if the table cannot be written.
pub fn run(
    config: &CellConfig,
    plan: PlanData,
    names: &Names,
    options: &SimulationOptions,
    mut table: Option<&mut dyn Write>,
    watch: CycleObserver<'_>,
) -> Result<SimulationResult, SimulateError> {
    let mut cell = VirtualCell::new(config);
    apply(&options.steps, 0, 0, &mut cell.devices);
    // One cycle without a net, so that the engine has seen the devices.
    cell.step();
    let dt_s = config.period_ns as f64 / 1e9;
    let holds = cell.holds();
    let net = Net::build(plan, &config.models(), config.fingerprint(), &holds, dt_s);
    let mut net = net.map_err(SimulateError::Refused)?;
    let (rehearsed, foreseen) = match cell.rehearse(&mut net, &config.models()) {
        Ok(rehearsed) => (rehearsed, None),
        Err(foreseen) if options.despite_refusal => (None, Some(foreseen)),
        Err(foreseen) => return Err(SimulateError::Refused(foreseen)),
    };
    cell.order(EngineRequest::Reserve { ticket: 0 })?;
    cell.order(EngineRequest::Install {
        ticket: INSTALL,
        id: ID,
        net,
    })?;
    cell.set(&options.values, 0, 0)?;
    cell.order(EngineRequest::Start {
        ticket: START,
        id: ID,
        lease: 0,
    })?;
    let mut trace = MonitorTrace::new(names);
    if let Some(out) = &mut table {
        trace.write_head(out)?;
    }
    let started = cell.engine.status().cycle + 1;
    let mut records: Vec<MonitorRecord> = Vec::new();
    let mut canceled = false;
    let mut past_ns = 0;
    loop {
        cell.step();
        if let Some(refusal) = cell.refusal() {
            return Err(SimulateError::Refused(refusal));
        }
        records.clear();
        records.extend(std::iter::from_fn(|| cell.ends.records.pop().ok()));
        let time_s = past_ns as f64 / 1e9;
        watch(time_s, &cell.engine, &cell.devices);
        if trace.record(time_s, &records)
            && let Some(out) = &mut table
        {
            trace.write_line(out, time_s, &records)?;
        }
        let next_ns = past_ns + config.period_ns;
        if cell.state() == CommandState::Terminated || next_ns >= options.limit_ns {
            break;
        }
        if !canceled && options.cancel_at_ns.is_some_and(|at_ns| next_ns >= at_ns) {
            canceled = true;
            cell.cancel()?;
        }
        apply(&options.steps, past_ns + 1, next_ns, &mut cell.devices);
        cell.set(&options.values, past_ns + 1, next_ns)?;
        past_ns = next_ns;
    }
    if let Some(out) = &mut table {
        out.flush()?;
    }
    let command = *cell.command().ok_or(SimulateError::Silent)?;
    Ok(SimulationResult {
        command,
        cycles: cell.engine.status().cycle + 1 - started,
        period_ns: config.period_ns,
        trace,
        rehearsed,
        foreseen,
    })
}

/// Builds a net at the start positions of the cell's simulators and rehearses it, as an executor does at LOAD.
///
/// # Errors
/// Fails if its start values cannot be computed there, or if it would break a limit.
pub fn rehearse_at_start(
    config: &CellConfig,
    plan: PlanData,
) -> Result<Option<RehearsalReport>, Refusal> {
    let mut cell = VirtualCell::new(config);
    cell.step();
    let (models, dt_s) = (config.models(), config.period_ns as f64 / 1e9);
    let mut net = Net::build(plan, &models, config.fingerprint(), &cell.holds(), dt_s)?;
    cell.rehearse(&mut net, &models)
}

impl VirtualCell {
    /// Rehearses a net, as an executor does before it becomes ready.
    fn rehearse(
        &self,
        net: &mut Net,
        models: &[DeviceModel],
    ) -> Result<Option<RehearsalReport>, Refusal> {
        let inputs = self.devices.iter().map(|device| DeviceInput {
            present: true,
            measurement: *device.measurement(),
        });
        let scene = RehearsalScene {
            models,
            devices: &inputs.collect::<Vec<_>>(),
            holds: &self.holds(),
            values: &[],
            dt_s: self.period_ns as f64 / 1e9,
        };
        rehearse(net, &scene)
    }

    /// Sets the inputs of the net whose time is in the closed range `from_ns` to `to_ns`; the last value of an input
    /// applies.
    fn set(
        &mut self,
        values: &[(u64, InputValue)],
        from_ns: u64,
        to_ns: u64,
    ) -> Result<(), SimulateError> {
        let due = values
            .iter()
            .filter(|(at_ns, _)| (from_ns..=to_ns).contains(at_ns));
        let mut values: Vec<InputValue> = Vec::new();
        for (_, value) in due {
            values.retain(|known| known.input != value.input);
            values.push(value.clone());
        }
        if values.is_empty() {
            return Ok(());
        }
        let (ticket, id) = (SET, ID);
        self.order(EngineRequest::Set { ticket, id, values })
    }

    fn cancel(&mut self) -> Result<(), SimulateError> {
        let (ticket, id) = (u64::MAX, ID);
        let can_cancel = self.command().is_some_and(|row| row.can_cancel == 1);
        self.order(if can_cancel {
            EngineRequest::Cancel { ticket, id }
        } else {
            EngineRequest::Abort { ticket, id }
        })
    }
}

/// Sets the inputs whose time is in the closed range `from_ns` to `to_ns`, in the order given.
fn apply(steps: &[ScriptStep], from_ns: u64, to_ns: u64, devices: &mut [SimulatedDevice]) {
    for step in steps
        .iter()
        .filter(|step| (from_ns..=to_ns).contains(&step.at_ns))
    {
        step.apply(devices);
    }
}
