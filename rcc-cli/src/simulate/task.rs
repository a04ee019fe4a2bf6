//! Runs the nets and rules of a task in virtual time, as [`super::run`] does for one net. Runs on the caller's thread.

use rcc_config::CellConfig;
use rcc_core::message::CommandState;
use rcc_engine::net::Net;
use rcc_engine::queue::{EngineEvent, EngineRequest};
use rcc_protocol::control::{Answer, PlanData, Refusal, SWITCH_MAX};
use rcc_protocol::rules::{Rule, RuleStatus};

use super::{SimulateError, SimulationOptions, VirtualCell, apply};

/// Nets of a task with numbers in place of names: the id of a command is its place in the list, counted from 1.
#[derive(Clone, Debug, Default)]
pub struct SimulatedTask {
    /// The nets.
    pub plans: Vec<PlanData>,
    /// Rules between them; ids of rules are their places in the list, counted from 1.
    pub rules: Vec<Rule>,
    /// Ids of the commands that start first.
    pub start: Vec<u64>,
}

/// Something that happened in a task.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TaskEvent {
    /// A command changed its state.
    Command {
        /// Its id.
        id: u64,
        /// The state.
        state: CommandState,
        /// `EndReason` as a number.
        reason: u32,
        /// Its outcome, counted from 1; 0: none.
        outcome: u32,
    },
    /// A rule can no longer fire.
    Rule(RuleStatus),
}

/// Result of a simulated task.
#[derive(Debug)]
pub struct TaskResult {
    /// Events, each with its logical time since START, s.
    pub events: Vec<(f64, TaskEvent)>,
    /// Duration, s.
    pub time_s: f64,
    /// A command was still active when the time was over.
    pub unfinished: bool,
}

/// Why a task cannot be simulated.
#[derive(Debug, thiserror::Error)]
pub enum TaskError {
    /// A net, a rule or the start was refused; the id of the command concerned, 0: none.
    #[error("command {0} is refused: {1:?}")]
    Refused(u64, Refusal),
    /// The engine did not answer.
    #[error(transparent)]
    Engine(#[from] SimulateError),
}

/// Tickets of the installation of the rules and of the start; see `TICKETS`.
const RULES: u64 = 1;
const START: u64 = 2;

/// Runs a task until no command is active and no rule is due, or until the time is over.
///
/// # Errors
/// Fails if a net, a rule or the start is refused.
pub fn run(
    config: &CellConfig,
    task: SimulatedTask,
    options: &SimulationOptions,
) -> Result<TaskResult, TaskError> {
    let mut cell = VirtualCell::new(config);
    cell.keeps_events = true;
    apply(&options.steps, 0, 0, &mut cell.devices);
    cell.step();
    let count = load(&mut cell, config, task.plans)?;
    cell.events.clear();
    let zero_ns = cell.now_ns;
    if !task.rules.is_empty() {
        let (ticket, rules) = (RULES, task.rules);
        cell.order(EngineRequest::InstallRules { ticket, rules })?;
    }
    if !task.start.is_empty() {
        let mut start = [0; SWITCH_MAX];
        start
            .iter_mut()
            .zip(task.start)
            .for_each(|(place, id)| *place = id);
        cell.order(EngineRequest::Handover {
            ticket: START,
            stop: [0; SWITCH_MAX],
            start,
            lease: 0,
        })?;
    }
    let mut events = Vec::new();
    let mut canceled = false;
    let mut past_ns = 0;
    loop {
        cell.step();
        refused(&cell)?;
        let time_s = (cell.now_ns - zero_ns - config.period_ns) as f64 / 1e9;
        let seen = cell.events.drain(..).filter_map(of_engine);
        events.extend(seen.map(|event| (time_s, event)));
        let next_ns = past_ns + config.period_ns;
        let active = (1..=count).any(|id| is_active(&cell, id));
        // A command that ended in this cycle may make a rule fire in the next one.
        let quiet = events.last().is_none_or(|(at_s, _)| *at_s < time_s);
        if !active && quiet || next_ns >= options.limit_ns {
            let unfinished = active;
            return Ok(TaskResult {
                events,
                time_s,
                unfinished,
            });
        }
        if !canceled && options.cancel_at_ns.is_some_and(|at_ns| next_ns >= at_ns) {
            canceled = true;
            cancel_all(&mut cell, count)?;
        }
        apply(&options.steps, past_ns + 1, next_ns, &mut cell.devices);
        past_ns = next_ns;
    }
}

/// Makes all nets ready; returns their number.
fn load(
    cell: &mut VirtualCell,
    config: &CellConfig,
    plans: Vec<PlanData>,
) -> Result<u64, TaskError> {
    let (models, dt_s) = (config.models(), config.period_ns as f64 / 1e9);
    let mut count = 0;
    for (plan, id) in plans.into_iter().zip(1..) {
        let refused = |refusal| TaskError::Refused(id, refusal);
        let holds = cell.holds();
        let net = Net::build(plan, &models, config.fingerprint(), &holds, dt_s);
        let mut net = net.map_err(refused)?;
        cell.rehearse(&mut net, &models).map_err(refused)?;
        cell.order(EngineRequest::Reserve { ticket: u64::MAX })?;
        cell.order(EngineRequest::Install {
            ticket: u64::MAX,
            id,
            net,
        })?;
        cell.step();
        count = id;
    }
    Ok(count)
}

fn refused(cell: &VirtualCell) -> Result<(), TaskError> {
    let mut answers = cell.answers.iter().flatten();
    let refused = answers.find_map(|answer| match answer {
        Answer::Refused(refusal) => Some((0, *refusal)),
        Answer::RefusedFor { id, refusal } => Some((*id, *refusal)),
        _ => None,
    });
    match refused {
        None => Ok(()),
        Some((id, refusal)) => Err(TaskError::Refused(id, refusal)),
    }
}

fn is_active(cell: &VirtualCell, id: u64) -> bool {
    let row = cell.engine.command(id);
    row.is_some_and(|row| CommandState::from_number(row.state).is_active())
}

/// Cancels every active command as a person does, or aborts it.
fn cancel_all(cell: &mut VirtualCell, count: u64) -> Result<(), SimulateError> {
    let ticket = u64::MAX;
    for id in 1..=count {
        if !is_active(cell, id) {
            continue;
        }
        let row = cell.engine.command(id);
        let order = match row.is_some_and(|row| row.can_cancel == 1) {
            true => EngineRequest::Cancel { ticket, id },
            false => EngineRequest::Abort { ticket, id },
        };
        cell.order(order)?;
    }
    Ok(())
}

fn of_engine(event: EngineEvent) -> Option<TaskEvent> {
    match event {
        EngineEvent::Command {
            id,
            state,
            reason,
            outcome,
            ..
        } => Some(TaskEvent::Command {
            id,
            state: CommandState::from_number(state),
            reason,
            outcome,
        }),
        EngineEvent::Rule(status) => Some(TaskEvent::Rule(status)),
        _ => None,
    }
}
