//! Makes nets of goals and starts them. A thread for each arm, since loading and rehearsing take time during which a running
//! goal must be cancellable. What it has started ends with this process: it is bound to its lease.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use rcc_client::{Cell, ClientError, OnClientLoss};
use rcc_config::CellConfig;
use rcc_recording::table::field_name;

use crate::cell::ArmStates;
use crate::names::GOAL_NETS;
use crate::trajectory::messages::Goal;
use crate::trajectory::motion::{GoalArm, GoalMotion, GoalNet, Refusal};

/// Longest wait for an arm that another goal stops.
const REST_MAX: Duration = Duration::from_secs(60);

/// A goal that moves its arm.
#[derive(Clone, Debug, PartialEq)]
pub struct StartedGoal {
    /// Id of its command.
    pub command: u64,
    /// Names of the joints.
    pub joints: Vec<String>,
    /// The requested motion.
    pub motion: GoalMotion,
    /// Positions at the end, rad.
    pub end: Vec<f64>,
}

/// Starts the goals of one arm.
pub struct GoalStarter {
    cell_name: String,
    device: String,
    joints: Vec<String>,
    states: Arc<ArmStates>,
    /// The connection whose lease the nets are bound to.
    cell: Option<Cell>,
    /// Command of the last goal.
    last: Option<u64>,
}

impl GoalStarter {
    /// Starts goals of the arm `device`, whose joints have these names in `/joint_states`.
    #[must_use]
    pub fn new(
        cell: &str,
        device: &str,
        joints: Vec<String>,
        states: Arc<ArmStates>,
    ) -> GoalStarter {
        GoalStarter {
            cell_name: cell.to_owned(),
            device: device.to_owned(),
            joints,
            states,
            cell: None,
            last: None,
        }
    }

    /// Checks, rehearses and starts a goal; it replaces the one that runs.
    ///
    /// # Errors
    /// Refuses what no net can follow. A goal that runs goes on then, unless the arm had to be stopped before the new one
    /// could begin.
    pub fn start(&mut self, goal: &Goal) -> Result<StartedGoal, Refusal> {
        let cell = match self.cell.take() {
            Some(cell) => cell,
            None => Cell::local(&self.cell_name).map_err(refused)?,
        };
        let started = self.start_at(&cell, goal);
        self.cell = Some(cell);
        let started = started?;
        self.last = Some(started.command);
        Ok(started)
    }

    fn start_at(&self, cell: &Cell, goal: &Goal) -> Result<StartedGoal, Refusal> {
        let arm = self.arm(cell)?;
        let motion = GoalMotion::of(goal, &arm)?;
        let name = format!("{GOAL_NETS}{}", field_name(&self.device).replace('_', "-"));
        // Without a first point at 0 s the path is known when the arm rests.
        let planned = match motion.begins_at_rest_position() {
            true => None,
            false => Some(motion.net(&arm, &name, None)?),
        };
        let running = self.last.and_then(|id| self.runs(cell, id));
        let (command, net) = match (running, planned) {
            (None, Some(net)) => (start(cell, &net)?, net),
            (Some(old), Some(net)) => (self.replace(cell, old, &net)?, net),
            (running, None) => {
                if let Some(old) = running {
                    stop(cell, old)?;
                }
                let rest = self.states.of(&self.device).ok_or_else(|| {
                    Refusal::invalid(format!("the driver of `{}` does not answer", self.device))
                })?;
                let net = motion.net(&arm, &name, Some(&rest.commanded))?;
                (start(cell, &net)?, net)
            }
        };
        Ok(StartedGoal {
            command,
            joints: arm.joints,
            motion,
            end: net.end,
        })
    }

    /// Hands the arm over if the new motion continues the old one; else the old one stops first.
    fn replace(&self, cell: &Cell, old: u64, net: &GoalNet) -> Result<u64, Refusal> {
        let running = cell.command(&old.to_string()).map_err(refused)?;
        let new = cell.load(&net.text).map_err(refused)?;
        let handed_over = cell.switch_with(&[&running], &[&new], OnClientLoss::Cancel);
        let started = match handed_over {
            Ok(_) => return Ok(new.id()),
            Err(error) => {
                tracing::info!(%error, "no hand-over: the running goal is cancelled first");
                let started = stop(cell, old)
                    .and_then(|()| new.start_with(OnClientLoss::Cancel).map_err(refused));
                started.map(|_| new.id())
            }
        };
        if started.is_err() {
            // A request whose answer was lost may have been carried out: what is refused must not move the arm.
            if self.runs(cell, new.id()).is_some() {
                stop(cell, new.id())?;
            }
            // The error that led here is the one to tell.
            let _ = new.unload();
        }
        started
    }

    fn runs(&self, cell: &Cell, id: u64) -> Option<u64> {
        // A command that is gone does not run.
        let view = cell
            .command(&id.to_string())
            .and_then(|one| one.state())
            .ok()?;
        (view.is_active() && view.net.starts_with(GOAL_NETS)).then_some(id)
    }

    /// Reads the arm from the configuration that the cell runs with.
    fn arm(&self, cell: &Cell) -> Result<GoalArm, Refusal> {
        let status = cell.status().map_err(refused)?;
        let config = CellConfig::load_offline(Path::new(&status.config));
        let config = config.map_err(|faults| {
            Refusal::invalid(format!("{} cannot be read: {faults}", status.config))
        })?;
        let mut devices = config.devices.into_iter();
        let device = devices.find(|device| device.name == self.device);
        let robot = device.and_then(|device| device.robot);
        let robot = robot.ok_or_else(|| {
            Refusal::invalid(format!("the cell has no arm `{}` any more", self.device))
        })?;
        Ok(GoalArm {
            device: self.device.clone(),
            joints: self.joints.clone(),
            robot,
            period_s: status.executor.period_ns as f64 * 1e-9,
        })
    }
}

fn refused(error: ClientError) -> Refusal {
    Refusal::invalid(error.to_string())
}

/// LOAD, which rehearses, and START.
fn start(cell: &Cell, net: &GoalNet) -> Result<u64, Refusal> {
    let command = cell.start(&net.text).map_err(refused)?;
    Ok(command.id())
}

/// CANCEL, and waits for the end.
fn stop(cell: &Cell, id: u64) -> Result<(), Refusal> {
    let command = cell.command(&id.to_string()).map_err(refused)?;
    // It may have ended, or somebody may have cancelled it.
    if let Err(error) = command.cancel() {
        tracing::info!(%error, "the running goal is not cancelled");
    }
    command.wait(Some(REST_MAX)).map(drop).map_err(refused)
}
