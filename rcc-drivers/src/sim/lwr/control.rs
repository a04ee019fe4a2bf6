//! Requests at the control port of the simulated controller: one JSON object per line, answered by one JSON object.
//! Parsed by the control port's threads; [`Krc::execute`] runs on the clock thread, between two ticks.
//!
//! `{"state":null}` · `{"wrench":{"force":[0,0,15],"torque":[0,0,0]}}` ·
//! `{"wall":{"point":[0,0,0.3],"normal":[0,0,1],"stiffness":5000,"damping":20}}` · `{"wall":null}` · `{"estop":null}` ·
//! `{"load":{"mass":2,"centre":[0,0,0.1]}}` · `{"load":null}` ·
//! `{"ack":null}` · `{"drives":{"on":false}}` · `{"freeze_ms":200}` · `{"drop":{"percent":10}}` ·
//! `{"network":{"to_pc":{"lost":0.1},"from_pc":{"corrupted":0.1}}}` · `{"clear":null}` ·
//! `{"set_bool":{"number":3,"value":true}}` · `{"set_real":{"number":1,"value":2.5}}` ·
//! `{"set_int":{"number":3,"value":7}}` · `{"strategy":"joint-impedance"}` ·
//! `{"wire_bool":{"from":1,"to":1}}` · `{"wire_real":{"from":1,"to":1}}` · `{"reset_statistics":null}` ·
//! `{"trace":{"path":"trace.csv"}}` · `{"trace":null}` · `{"flush":null}` · `{"quit":null}`.
//! `network` takes the probabilities of lost, late (with late_steps_max), duplicated, reordered, truncated and corrupted
//! datagrams. A trace must be below the folder of the socket, which is also the base of relative paths. `clear` ends every
//! requested fault, and acknowledges. A command without content may also be a bare name, `"state"`.
//! Answers: `{"ok":true}`, `{"error":"…"}`, or the state.

use super::krc::Krc;
use super::settings::KrlLoopback;
use super::statistics::{KrlVariables, Snapshot};
use crate::fri_lwr::wire::{KrlBlock, Quality};
use crate::sim::arm::dynamics::FlangeLoad;
use crate::sim::arm::environment::Wall;
use crate::sim::arm::impedance::ControlLaw;
use crate::sim::network::NetworkRates;
use crate::sim::requests::{
    ControlAnswer, DriveSwitch, DropRate, InjectedWrench, RequestError, TraceFile,
};
use crate::sim::robot_snapshot::RobotSnapshot;
use serde::Deserialize;

/// A request at the control port.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum KrcCommand {
    /// Returns the whole state.
    State,
    /// Injects a wrench on the flange, base axes, until the next request.
    Wrench(InjectedWrench),
    /// Replaces or removes the obstacle.
    Wall(Option<Wall>),
    /// Replaces or removes the load at the flange.
    Load(Option<FlangeLoad>),
    /// Presses the emergency stop.
    Estop,
    /// Releases the emergency stop and acknowledges the fault.
    Ack,
    /// Switches the drives on or off.
    Drives(DriveSwitch),
    /// Sends nothing for this number of milliseconds; the controller's own time continues.
    FreezeMs(u64),
    /// Drops a share of the PC's answers.
    Drop(DropRate),
    /// Loses, delays, duplicates, reorders, truncates and corrupts datagrams, from now on.
    Network(NetworkRates),
    /// Ends all faults that were requested: network, wrench, wall, load, emergency stop, drives.
    Clear,
    /// Sets `$FRI_TO_BOOL[number]`.
    SetBool(KrlVariable<bool>),
    /// Sets `$FRI_TO_REA[number]`.
    SetReal(KrlVariable<f32>),
    /// Sets `$FRI_TO_INT[number]`.
    SetInt(KrlVariable<i32>),
    /// Changes the control strategy, in monitor mode only.
    Strategy(ControlLaw),
    /// Loops `$FRI_FRM_BOOL[from]` back to `$FRI_TO_BOOL[to]`.
    WireBool(KrlLoopback),
    /// Loops `$FRI_FRM_REA[from]` back to `$FRI_TO_REA[to]`.
    WireReal(KrlLoopback),
    /// Resets counters, faults and extremes.
    ResetStatistics,
    /// Starts a trace into a file, or ends it.
    Trace(Option<TraceFile>),
    /// Waits until the trace has been written to its file.
    Flush,
    /// Ends the KRL program, and the simulator with it.
    Quit,
}

/// A KRL variable and its new value.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KrlVariable<T> {
    /// Number of the variable, 1 to 16.
    pub number: usize,
    /// New value.
    pub value: T,
}

/// Why a command was refused.
#[derive(Debug, thiserror::Error)]
pub enum ControlError {
    /// A reason that all simulated robots have.
    #[error(transparent)]
    Request(#[from] RequestError),
    /// No KRL variable has this number.
    #[error("KRL variable {0} does not exist: write a number from 1 to 16")]
    Number(usize),
    /// The control strategy cannot be changed.
    #[error("the strategy may change only in monitor mode, while the arm is at rest")]
    Strategy,
}

impl Krc {
    /// Executes a command. Commands about the trace are handled elsewhere and ignored here.
    ///
    /// # Errors
    /// Returns an error for values out of range, or an acknowledgement while the arm moves; nothing has changed then.
    pub fn execute(
        &mut self,
        command: KrcCommand,
    ) -> Result<ControlAnswer<Snapshot>, ControlError> {
        match command {
            KrcCommand::State => return Ok(ControlAnswer::State(Box::new(self.snapshot()))),
            KrcCommand::Wrench(wrench) => self.robot.environment.injected = wrench.elements(),
            KrcCommand::Wall(wall) => self.robot.set_wall(wall)?,
            KrcCommand::Load(load) => self.robot.set_load(load)?,
            KrcCommand::Estop => self.press_emergency_stop(),
            KrcCommand::Ack if !self.acknowledge() => return Err(RequestError::Moving.into()),
            KrcCommand::Ack => {}
            KrcCommand::Drives(DriveSwitch { on }) => self.switch_drives(on),
            KrcCommand::FreezeMs(time_ms) => {
                self.robot
                    .withhold(time_ms as f64 * 1e-3, self.settings.period_s);
            }
            KrcCommand::Drop(rate) => self.robot.drop_percent = rate.checked()?,
            KrcCommand::Network(rates) => self.robot.set_network(rates)?,
            KrcCommand::Clear => {
                self.robot.clear(&self.settings.robot);
                self.switch_drives(true);
                if !self.acknowledge() {
                    return Err(RequestError::Moving.into());
                }
            }
            KrcCommand::SetBool(KrlVariable { number, value }) => {
                checked(number)?;
                self.to_pc.set_boolean(number, value);
            }
            KrcCommand::SetReal(KrlVariable { number, value }) => {
                self.to_pc.reals[checked(number)? - 1] = value
            }
            KrcCommand::SetInt(KrlVariable { number, value }) => {
                self.to_pc.integers[checked(number)? - 1] = value
            }
            KrcCommand::Strategy(strategy) if !self.choose_strategy(strategy) => {
                return Err(ControlError::Strategy);
            }
            KrcCommand::Strategy(_) => {}
            KrcCommand::WireBool(wire) => self.settings.boolean_wires.push(checked_wire(wire)?),
            KrcCommand::WireReal(wire) => self.settings.real_wires.push(checked_wire(wire)?),
            KrcCommand::ResetStatistics => self.reset_statistics(),
            KrcCommand::Trace(_) | KrcCommand::Flush => {}
            KrcCommand::Quit => self.close(),
        }
        Ok(ControlAnswer::Done)
    }

    /// Returns the whole state.
    pub fn snapshot(&self) -> Snapshot {
        Snapshot {
            robot: RobotSnapshot {
                waiting_for: self.monitor_reason.map(|waiting| waiting.to_string()),
                fault: self.fault.map(|fault| fault.to_string()),
                last_refusal: self.last_refusal.map(|refusal| refusal.to_string()),
                drives_on: self.drives_on(),
                at_rest: self.is_at_rest(),
                ..self.robot.snapshot(self.quality.figures())
            },
            strategy: self.settings.strategy,
            fri_state: if self.in_command_state() {
                "command"
            } else {
                "monitor"
            },
            quality: match self.quality.quality() {
                Quality::Unacceptable => "unacceptable",
                Quality::Bad => "bad",
                Quality::Ok => "ok",
                Quality::Perfect => "perfect",
            },
            counts: self.counts,
            krl_to_pc: variables(&self.to_pc),
            krl_from_pc: variables(&self.from_pc),
        }
    }
}

/// Checks the number of a KRL variable, 1 to 16.
fn checked(number: usize) -> Result<usize, ControlError> {
    if (1..=16).contains(&number) {
        Ok(number)
    } else {
        Err(ControlError::Number(number))
    }
}

fn checked_wire(wire: KrlLoopback) -> Result<KrlLoopback, ControlError> {
    checked(wire.from)?;
    checked(wire.to)?;
    Ok(wire)
}

fn variables(block: &KrlBlock) -> KrlVariables {
    KrlVariables {
        booleans: std::array::from_fn(|i| block.boolean(i + 1) == Some(true)),
        reals: block.reals,
        integers: block.integers,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::arm::environment::WallError;
    use crate::sim::requests::to_line;

    fn parse(line: &str) -> KrcCommand {
        serde_json::from_str(line).unwrap()
    }

    #[test]
    fn every_documented_line_is_a_command() {
        let text = include_str!("control.rs");
        let lines: Vec<&str> = text
            .lines()
            .filter_map(|line| line.strip_prefix("//! "))
            .take_while(|line| !line.starts_with("`network` takes"))
            .flat_map(|line| line.split('`'))
            .filter(|part| part.starts_with('{'))
            .collect();
        assert_eq!(lines.len(), 24, "{lines:?}");
        for line in lines {
            let command: Result<KrcCommand, _> = serde_json::from_str(line);
            assert!(command.is_ok(), "{line}: {command:?}");
        }
    }

    #[test]
    fn a_command_without_content_may_be_a_bare_name() {
        assert_eq!(parse("\"state\""), KrcCommand::State);
        assert_eq!(parse(r#"{"state":null}"#), KrcCommand::State);
        assert_eq!(parse(r#"{"wall":null}"#), KrcCommand::Wall(None));
    }

    #[test]
    fn a_value_out_of_range_is_refused_and_changes_nothing() {
        let mut krc = Krc::new(super::super::settings::Settings::default());
        assert!(matches!(
            krc.execute(parse(r#"{"drop":{"percent":101}}"#)),
            Err(ControlError::Request(RequestError::Percent(_)))
        ));
        assert!(matches!(
            krc.execute(parse(r#"{"set_bool":{"number":17,"value":true}}"#)),
            Err(ControlError::Number(17))
        ));
        assert!(matches!(
            krc.execute(parse(
                r#"{"wall":{"point":[0,0,0],"normal":[0,0,0],"stiffness":1}}"#
            )),
            Err(ControlError::Request(RequestError::Wall(WallError::Normal)))
        ));
        assert!(krc.robot.environment.wall.is_none() && krc.to_pc.booleans == 0);
    }

    #[test]
    fn an_answer_is_one_line() {
        let krc = Krc::new(super::super::settings::Settings::default());
        let state = ControlAnswer::State(Box::new(krc.snapshot()));
        let line = to_line(Ok::<_, ControlError>(state));
        assert!(!line.contains('\n') && line.contains("\"fri_state\":\"monitor\""));
    }
}
