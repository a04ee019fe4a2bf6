//! Makes nets of goals and starts them. A thread for each arm, since loading and rehearsing take time during which a running
//! goal must be cancellable. What it has started ends with this process: it is bound to its lease.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use rcc_client::{Cell, ClientError, Command, OnClientLoss};
use rcc_config::CellConfig;
use rcc_recording::table::field_name;

use crate::cell::ArmStates;
use crate::names::GOAL_NETS;
use crate::trajectory::goals::CancelFlag;
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

    /// Checks, rehearses and starts a goal; it replaces the one that runs. A goal that is canceled before START is not
    /// started, and leaves the one that runs alone if that was not stopped yet.
    ///
    /// # Errors
    /// Refuses what no net can follow, and what was canceled. A goal that runs goes on then, unless the arm had to be stopped
    /// before the new one could begin.
    pub fn start(&mut self, goal: &Goal, canceled: &CancelFlag) -> Result<StartedGoal, Refusal> {
        // It may have waited behind others.
        refuse_canceled(canceled)?;
        let cell = match self.cell.take() {
            Some(cell) => cell,
            None => Cell::local(&self.cell_name).map_err(refused)?,
        };
        let started = self.start_at(&cell, goal, canceled);
        self.cell = Some(cell);
        let started = started?;
        self.last = Some(started.command);
        Ok(started)
    }

    fn start_at(
        &self,
        cell: &Cell,
        goal: &Goal,
        canceled: &CancelFlag,
    ) -> Result<StartedGoal, Refusal> {
        let arm = self.arm(cell)?;
        let motion = GoalMotion::of(goal, &arm)?;
        let name = format!("{GOAL_NETS}{}", field_name(&self.device).replace('_', "-"));
        // Without a first point at 0 s the path is known when the arm rests.
        let planned = match motion.begins_at_rest_position() {
            true => None,
            false => Some(motion.net(&arm, &name, None)?),
        };
        let mut running = self.last.and_then(|id| self.runs(cell, id));
        let net = match planned {
            Some(net) => net,
            None => {
                if let Some(old) = running.take() {
                    refuse_canceled(canceled)?;
                    stop(cell, old)?;
                }
                let rest = self.states.of(&self.device).ok_or_else(|| {
                    Refusal::invalid(format!("the driver of `{}` does not answer", self.device))
                })?;
                motion.net(&arm, &name, Some(&rest.commanded))?
            }
        };
        Ok(StartedGoal {
            command: self.load_and_start(cell, running, &net, canceled)?,
            joints: arm.joints,
            motion,
            end: net.end,
        })
    }

    /// LOAD, which rehearses, and START, or the hand-over from a net that runs.
    fn load_and_start(
        &self,
        cell: &Cell,
        running: Option<u64>,
        net: &GoalNet,
        canceled: &CancelFlag,
    ) -> Result<u64, Refusal> {
        let running = match running {
            Some(old) => Some(cell.command(&old.to_string()).map_err(refused)?),
            None => None,
        };
        let new = cell.load(&net.text).map_err(refused)?;
        let started = match running {
            Some(old) => replace(cell, &old, &new, canceled),
            None => begin(&new, canceled),
        };
        if let Err(refusal) = started {
            // A request whose answer was lost may have been carried out: what is refused must not move the arm.
            if self.runs(cell, new.id()).is_some() {
                stop(cell, new.id())?;
            }
            // The error that led here is the one to tell.
            let _ = new.unload();
            return Err(refusal);
        }
        Ok(new.id())
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

/// Refuses a goal that was canceled.
fn refuse_canceled(canceled: &CancelFlag) -> Result<(), Refusal> {
    match canceled.is_set() {
        true => Err(Refusal::invalid("canceled before it was started")),
        false => Ok(()),
    }
}

/// START.
fn begin(new: &Command<'_>, canceled: &CancelFlag) -> Result<(), Refusal> {
    // While the net was rehearsed, or the arm came to rest.
    refuse_canceled(canceled)?;
    new.start_with(OnClientLoss::Cancel)
        .map(drop)
        .map_err(refused)
}

/// Hands the arm over if the new motion continues the old one; else the old one stops first.
fn replace(
    cell: &Cell,
    old: &Command<'_>,
    new: &Command<'_>,
    canceled: &CancelFlag,
) -> Result<(), Refusal> {
    refuse_canceled(canceled)?;
    let Err(error) = cell.switch_with(&[old], &[new], OnClientLoss::Cancel) else {
        return Ok(());
    };
    tracing::info!(%error, "no hand-over: the running goal is canceled first");
    refuse_canceled(canceled)?;
    stop(cell, old.id())?;
    begin(new, canceled)
}

/// CANCEL, and waits for the end.
fn stop(cell: &Cell, id: u64) -> Result<(), Refusal> {
    let command = cell.command(&id.to_string()).map_err(refused)?;
    // It may have ended, or somebody may have canceled it.
    if let Err(error) = command.cancel() {
        tracing::info!(%error, "the running goal is not canceled");
    }
    command.wait(Some(REST_MAX)).map(drop).map_err(refused)
}

#[cfg(test)]
mod tests;
