//! The control port's language: one JSON object a line, one JSON object as the answer.
//! Text is read and written by the control port's threads; [`Krc::execute`] runs on the clock thread, between two ticks.
//!
//! `{"state":null}` · `{"wrench":{"force":[0,0,15],"torque":[0,0,0]}}` ·
//! `{"wall":{"point":[0,0,0.3],"normal":[0,0,1],"stiffness":5000,"damping":20}}` · `{"wall":null}` · `{"estop":null}` ·
//! `{"ack":null}` · `{"drives":{"on":false}}` · `{"freeze_ms":200}` · `{"drop":{"percent":10}}` ·
//! `{"network":{"to_pc":{"lost":0.1},"from_pc":{"corrupted":0.1}}}` · `{"clear":null}` ·
//! `{"set_bool":{"number":3,"value":true}}` · `{"set_real":{"number":1,"value":2.5}}` ·
//! `{"wire_bool":{"from":1,"to":1}}` · `{"wire_real":{"from":1,"to":1}}` · `{"reset_statistics":null}` ·
//! `{"trace":{"path":"trace.csv"}}` · `{"trace":null}` · `{"flush":null}` · `{"quit":null}`.
//! `network` takes the probabilities of lost, late (with late_steps_max), duplicated, reordered, truncated and corrupted
//! datagrams; a trace lies below the folder of the socket, where a relative path begins; `clear` ends every fault that was asked for, and acknowledges.
//! A command without content may also be a bare name, `"state"`. Answers: `{"ok":true}`, `{"error":"…"}`, or the state.

use super::environment::{Wall, WallError};
use super::krc::Krc;
use super::network::{NetworkRates, impossible};
use super::settings::KrlLoopback;
use super::statistics::{KrlVariables, Snapshot};
use crate::fri_lwr::wire::{KrlBlock, Quality};
use crate::sim::control_socket::PathError;
use serde::Deserialize;
use std::path::PathBuf;

/// A line of the control port.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum KrcCommand {
    /// Everything at this moment.
    State,
    /// Injects a wrench on the flange, base axes; it stays until the next.
    Wrench(InjectedWrench),
    /// Puts an obstacle in place of the last, or takes it away.
    Wall(Option<Wall>),
    /// Presses the emergency stop.
    Estop,
    /// Releases the emergency stop and acknowledges the fault.
    Ack,
    /// Switches the drives.
    Drives(DriveSwitch),
    /// Sends nothing for this many milliseconds; the controller's own time goes on.
    FreezeMs(u64),
    /// Drops a part of the PC's answers.
    Drop(DropRate),
    /// Loses, delays, doubles, swaps, cuts and corrupts datagrams, from now on.
    Network(NetworkRates),
    /// Ends all faults that were asked for: network, wrench, wall, emergency stop, drives.
    Clear,
    /// Sets `$FRI_TO_BOOL[number]`.
    SetBool(KrlVariable<bool>),
    /// Sets `$FRI_TO_REA[number]`.
    SetReal(KrlVariable<f32>),
    /// Wires `$FRI_FRM_BOOL[from]` to `$FRI_TO_BOOL[to]`.
    WireBool(KrlLoopback),
    /// Wires `$FRI_FRM_REA[from]` to `$FRI_TO_REA[to]`.
    WireReal(KrlLoopback),
    /// Counters, faults and extremes begin anew.
    ResetStatistics,
    /// Traces into a file, or ends the trace.
    Trace(Option<TraceFile>),
    /// Waits until the trace is in its file.
    Flush,
    /// The KRL program ends, and the simulator with it.
    Quit,
}

/// Force (N) and torque (Nm) on the flange, base axes.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InjectedWrench {
    /// N.
    #[serde(default)]
    pub force: [f64; 3],
    /// Nm.
    #[serde(default)]
    pub torque: [f64; 3],
}

/// On or off.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DriveSwitch {
    /// On.
    pub on: bool,
}

/// A part of all.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DropRate {
    /// 0 to 100.
    pub percent: f64,
}

/// A KRL variable and its new value.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KrlVariable<T> {
    /// 1 to 16.
    pub number: usize,
    /// New value.
    pub value: T,
}

/// Where to trace.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TraceFile {
    /// The file, below the folder of the control socket; it is appended to.
    pub path: PathBuf,
}

/// Why a command was refused.
#[derive(Debug, thiserror::Error)]
pub enum ControlError {
    /// Not a command.
    #[error("not a command: {0}")]
    Syntax(#[from] serde_json::Error),
    /// The wall is impossible.
    #[error(transparent)]
    Wall(#[from] WallError),
    /// There is no such KRL variable.
    #[error("KRL variables are numbered from 1 to 16, there is no number {0}")]
    Number(usize),
    /// Not a percentage.
    #[error("{0} is no percentage: 0 to 100")]
    Percent(f64),
    /// Not a probability.
    #[error("{0} is no probability: 0 to 1")]
    Probability(f64),
    /// Acknowledged too early.
    #[error("the arm still moves: ask for `ack` again when `at_rest` is true")]
    Moving,
    /// The file is not one that requests may name.
    #[error(transparent)]
    Path(#[from] PathError),
    /// The trace cannot be written.
    #[error(transparent)]
    Trace(#[from] super::trace::TraceError),
    /// The clock thread does not answer.
    #[error("the controller's clock does not answer within 5 s")]
    NoAnswer,
}

/// What a command brought.
#[derive(Clone, Debug)]
pub enum ControlAnswer {
    /// Done.
    Done,
    /// Everything at this moment.
    State(Box<Snapshot>),
}

impl Krc {
    /// Does what a command says. Commands about the trace and its file mean nothing here.
    ///
    /// # Errors
    /// Numbers out of range, or an acknowledgement while the arm moves; nothing has changed then.
    pub fn execute(&mut self, command: KrcCommand) -> Result<ControlAnswer, ControlError> {
        match command {
            KrcCommand::State => return Ok(ControlAnswer::State(Box::new(self.snapshot()))),
            KrcCommand::Wrench(InjectedWrench {
                force: [fx, fy, fz],
                torque: [tx, ty, tz],
            }) => {
                self.environment.injected = [fx, fy, fz, tx, ty, tz];
            }
            KrcCommand::Wall(wall) => {
                self.environment.wall = wall.map(Wall::checked).transpose()?
            }
            KrcCommand::Estop => self.press_emergency_stop(),
            KrcCommand::Ack if !self.acknowledge() => return Err(ControlError::Moving),
            KrcCommand::Ack => {}
            KrcCommand::Drives(DriveSwitch { on }) => self.switch_drives(on),
            KrcCommand::FreezeMs(time_ms) => self.withhold(time_ms as f64 * 1e-3),
            KrcCommand::Drop(DropRate { percent }) if (0.0..=100.0).contains(&percent) => {
                self.drop_answers(percent)
            }
            KrcCommand::Drop(DropRate { percent }) => return Err(ControlError::Percent(percent)),
            KrcCommand::Network(rates) => {
                if let Some(rate) = impossible(&rates) {
                    return Err(ControlError::Probability(rate));
                }
                self.network.set(rates);
            }
            KrcCommand::Clear => {
                self.network.set(NetworkRates::default());
                self.drop_answers(0.0);
                self.withhold(0.0);
                self.environment.injected = [0.0; 6];
                self.environment.wall = self.settings.wall;
                self.switch_drives(true);
                if !self.acknowledge() {
                    return Err(ControlError::Moving);
                }
            }
            KrcCommand::SetBool(KrlVariable { number, value }) => {
                checked(number)?;
                self.to_pc.set_boolean(number, value);
            }
            KrcCommand::SetReal(KrlVariable { number, value }) => {
                self.to_pc.reals[checked(number)? - 1] = value
            }
            KrcCommand::WireBool(wire) => self.settings.boolean_wires.push(checked_wire(wire)?),
            KrcCommand::WireReal(wire) => self.settings.real_wires.push(checked_wire(wire)?),
            KrcCommand::ResetStatistics => self.reset_statistics(),
            KrcCommand::Trace(_) | KrcCommand::Flush => {}
            KrcCommand::Quit => self.close(),
        }
        Ok(ControlAnswer::Done)
    }

    /// Everything at this moment.
    pub fn snapshot(&self) -> Snapshot {
        let figures = self.quality.figures();
        Snapshot {
            tick: self.tick,
            time_s: self.time_s,
            strategy: self.settings.strategy,
            fri_state: if self.command_state {
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
            waiting_for: self.monitor_reason.map(|waiting| waiting.to_string()),
            fault: self.fault.map(|fault| fault.to_string()),
            faults: self.faults.clone(),
            drives_on: self.drives_on(),
            emergency_stop: self.emergency_stop,
            q: self.arm.position,
            velocity: self.arm.velocity,
            q_cmd: self.desired,
            velocity_max: self.arm.velocity_max,
            acceleration_max: self.arm.acceleration_max,
            commanded_velocity_max: self.last_stream.velocity_max,
            commanded_acceleration_max: self.last_stream.acceleration_max,
            at_rest: self.is_at_rest(),
            at_rest_for_s: self.at_rest_for_s,
            flange_position: self.geometry.position,
            flange_rotation: self.geometry.rotation,
            wrench: self.wrench,
            wall: self.environment.wall,
            answer_rate: figures.answered as f64 / super::quality::WINDOW as f64,
            latency_s: figures.latency_s,
            jitter_s: figures.jitter_s,
            counts: self.counts,
            network: self.network.counts(),
            krl_to_pc: variables(&self.to_pc),
            krl_from_pc: variables(&self.from_pc),
        }
    }
}

/// A KRL number, 1 to 16.
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

/// The answer as one line of JSON.
pub fn to_line(answer: Result<ControlAnswer, ControlError>) -> String {
    let value = match answer {
        Ok(ControlAnswer::Done) => serde_json::json!({ "ok": true }),
        Ok(ControlAnswer::State(snapshot)) => match serde_json::to_value(&*snapshot) {
            Ok(value) => value,
            Err(error) => serde_json::json!({ "error": error.to_string() }),
        },
        Err(error) => serde_json::json!({ "error": error.to_string() }),
    };
    value.to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

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
        assert_eq!(lines.len(), 20, "{lines:?}");
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
    fn what_is_out_of_range_is_refused_and_changes_nothing() {
        let mut krc = Krc::new(super::super::settings::Settings::default());
        assert!(matches!(
            krc.execute(parse(r#"{"drop":{"percent":101}}"#)),
            Err(ControlError::Percent(_))
        ));
        assert!(matches!(
            krc.execute(parse(r#"{"set_bool":{"number":17,"value":true}}"#)),
            Err(ControlError::Number(17))
        ));
        assert!(matches!(
            krc.execute(parse(
                r#"{"wall":{"point":[0,0,0],"normal":[0,0,0],"stiffness":1}}"#
            )),
            Err(ControlError::Wall(WallError::Normal))
        ));
        assert!(krc.environment.wall.is_none() && krc.to_pc.booleans == 0);
    }

    #[test]
    fn an_answer_is_one_line() {
        let krc = Krc::new(super::super::settings::Settings::default());
        let line = to_line(Ok(ControlAnswer::State(Box::new(krc.snapshot()))));
        assert!(!line.contains('\n') && line.contains("\"fri_state\":\"monitor\""));
    }
}
