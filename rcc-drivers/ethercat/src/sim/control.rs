//! Requests at the control port of the simulated line: one JSON object per line, answered by one JSON object.
//! Run by the control port's threads.
//!
//! `{"state":null}` · `{"set":{"terminal":1,"channel":3,"value":1}}` · `{"pull":2}` · `{"plug":null}` · `{"kill":3}` ·
//! `{"start":3}` · `{"drop":10}` · `{"miss":{"terminal":2,"frames":10}}` · `{"quit":null}`; of a drive
//! `{"fault":{"terminal":5,"code":8976}}` · `{"block":{"terminal":5,"on":true}}` ·
//! `{"torque_off":{"terminal":5,"on":true}}`.
//! Terminals and channels start at 1. The value of a digital input is 0 or 1, that of an analog input the raw number;
//! one beyond 16 bits is an over- or underrange. `pull` pulls the cable in front of a terminal, `plug` puts it back;
//! `kill` takes the power of a terminal, and frames turn back in front of it; `start` gives it back; `drop` leaves this
//! number of frames without an answer; `miss` lets a terminal take no part in this number of exchanges of process data, so
//! that the working counter is too low; `fault` raises a fault with an error code at a drive, `block` blocks its motor, and
//! `torque_off` switches its safe torque off on and off. Answers: `{"ok":true}`, `{"error":"…"}`, or the state.

use serde::Deserialize;
use serde_json::{Value, json};

use super::drive::Drive;
use super::line::{Line, Station};
use super::sub_device::SubDevice;

/// A request at the control port.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LineCommand {
    /// Returns all terminals and counters.
    State,
    /// Sets an input.
    Set(Input),
    /// Pulls the cable in front of this terminal.
    Pull(usize),
    /// Puts the cable back.
    Plug,
    /// Takes the power of this terminal.
    Kill(usize),
    /// Gives the power back: the terminal starts in INIT.
    Start(usize),
    /// Leaves this number of further frames without an answer.
    Drop(u64),
    /// Lets a terminal take no part in the exchange of process data.
    Miss(Miss),
    /// Raises a fault at a drive.
    Fault(DriveFault),
    /// Blocks the motor of a drive, or frees it.
    Block(DriveSwitch),
    /// Switches safe torque off of a drive on or off.
    TorqueOff(DriveSwitch),
    /// Ends the simulator.
    Quit,
}

/// A drive and an error code.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DriveFault {
    /// Terminal, from 1.
    pub terminal: usize,
    /// Error code, as in object 0x603F.
    pub code: u16,
}

/// A drive and a switch.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DriveSwitch {
    /// Terminal, from 1.
    pub terminal: usize,
    /// On or off.
    pub on: bool,
}

/// A terminal and a number of frames.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Miss {
    /// Terminal, from 1.
    pub terminal: usize,
    /// Number of exchanges.
    pub frames: u64,
}

/// An input and its new value.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Input {
    /// Terminal, from 1.
    pub terminal: usize,
    /// Channel, from 1.
    pub channel: usize,
    /// New value.
    pub value: i32,
}

/// Why a command was refused.
#[derive(Debug, thiserror::Error)]
pub enum ControlError {
    /// The line is not a command.
    #[error("not a command: {0}")]
    Syntax(#[from] serde_json::Error),
    /// There is no such terminal.
    #[error("terminal {terminal} does not exist: write a number from 1 to {last}")]
    Terminal {
        /// Number in the request.
        terminal: usize,
        /// Number of the last terminal.
        last: usize,
    },
    /// The terminal is no drive.
    #[error("terminal {terminal} ({name}) is no drive")]
    NoDrive {
        /// Number of the terminal.
        terminal: usize,
        /// Its type.
        name: &'static str,
    },
    /// The terminal has no such input.
    #[error("terminal {terminal} ({name}) has no input {channel}; it has {count} inputs")]
    Channel {
        /// Number of the terminal.
        terminal: usize,
        /// Its type.
        name: &'static str,
        /// Number in the request.
        channel: usize,
        /// Number of its inputs.
        count: usize,
    },
}

impl Line {
    /// Carries out a request and returns the answer.
    ///
    /// # Errors
    /// Returns an error if there is no such terminal or input; nothing has changed then.
    pub fn execute(&mut self, command: &LineCommand) -> Result<Value, ControlError> {
        match command {
            LineCommand::State => return Ok(self.state()),
            LineCommand::Set(input) => self.set(input)?,
            LineCommand::Pull(terminal) => {
                self.station(*terminal)?;
                self.pull(terminal - 1);
            }
            LineCommand::Plug => self.pulled = None,
            LineCommand::Kill(terminal) => {
                let station = self.station(*terminal)?;
                station.powered = false;
                station.device.restart();
            }
            LineCommand::Start(terminal) => self.station(*terminal)?.powered = true,
            LineCommand::Drop(count) => self.drop = *count,
            LineCommand::Miss(miss) => self.station(miss.terminal)?.miss = miss.frames,
            LineCommand::Fault(fault) => self.drive(fault.terminal)?.fail(fault.code),
            LineCommand::Block(block) => self.drive(block.terminal)?.blocked = block.on,
            LineCommand::TorqueOff(off) => self.drive(off.terminal)?.set_torque_off(off.on),
            LineCommand::Quit => {}
        }
        self.connect();
        Ok(json!({ "ok": true }))
    }

    fn station(&mut self, terminal: usize) -> Result<&mut Station, ControlError> {
        let last = self.stations.len();
        let found = terminal
            .checked_sub(1)
            .and_then(|position| self.stations.get_mut(position));
        found.ok_or(ControlError::Terminal { terminal, last })
    }

    fn drive(&mut self, terminal: usize) -> Result<&mut Drive, ControlError> {
        let device = &mut self.station(terminal)?.device;
        let name = device.model().name;
        let missing = ControlError::NoDrive { terminal, name };
        device.drive_mut().ok_or(missing)
    }

    fn set(&mut self, input: &Input) -> Result<(), ControlError> {
        let device = &mut self.station(input.terminal)?.device;
        let channel = input.channel.checked_sub(1);
        if channel.is_some_and(|channel| device.set_input(channel, input.value)) {
            return Ok(());
        }
        Err(ControlError::Channel {
            terminal: input.terminal,
            name: device.model().name,
            channel: input.channel,
            count: device.inputs().len(),
        })
    }

    fn state(&self) -> Value {
        let terminals: Vec<Value> = self.stations.iter().map(describe).collect();
        json!({
            "frames": self.frames,
            "reached": self.reach(),
            "pulled": self.pulled.map(|position| position + 1),
            "terminals": terminals,
        })
    }
}

fn describe(station: &Station) -> Value {
    let device: &SubDevice = &station.device;
    let status = device.status();
    let drive = device.drive().map(|drive| {
        json!({
            "state": drive.state(),
            "position": drive.position(),
            "target": drive.target(),
            "error": drive.error(),
        })
    });
    json!({
        "name": device.model().name,
        "powered": station.powered,
        "state": status.state,
        "code": status.code,
        "station": device.station(),
        "inputs": device.inputs(),
        "outputs": station.outputs(),
        "watchdog_trips": device.trips(),
        "drive": drive,
        "clock": device.clock().map(|clock| json!({
            "difference_ns": clock.difference_ns(),
            "sync0_ns": device.sync0().map(|period| period.as_nanos() as u64),
        })),
    })
}

#[cfg(test)]
mod tests {
    use super::super::model::MODELS;
    use super::*;

    fn line() -> Line {
        Line::new(&MODELS.iter().collect::<Vec<_>>())
    }

    fn ask(line: &mut Line, text: &str) -> Result<Value, ControlError> {
        line.execute(&serde_json::from_str(text)?)
    }

    #[test]
    fn every_documented_line_is_a_command() {
        let text = include_str!("control.rs");
        let documented = text.lines().take_while(|line| line.starts_with("//!"));
        let lines: Vec<&str> = documented
            .flat_map(|line| line.split('`'))
            .filter(|part| part.starts_with('{') && !part.contains("ok") && !part.contains("error"))
            .collect();
        assert_eq!(lines.len(), 12);
        for text in lines {
            assert!(ask(&mut line(), text).is_ok(), "{text}");
        }
    }

    #[test]
    fn what_does_not_exist_is_told_with_what_does() {
        let mut line = line();
        let error = ask(&mut line, r#"{"kill":6}"#).unwrap_err();
        let words = "terminal 6 does not exist: write a number from 1 to 5";
        assert_eq!(error.to_string(), words);
        let error = ask(&mut line, r#"{"set":{"terminal":2,"channel":1,"value":1}}"#);
        let words = "terminal 2 (EL2008) has no input 1; it has 0 inputs";
        assert_eq!(error.unwrap_err().to_string(), words);
        let error = ask(&mut line, r#"{"block":{"terminal":2,"on":true}}"#).unwrap_err();
        assert_eq!(error.to_string(), "terminal 2 (EL2008) is no drive");
        assert!(ask(&mut line, r#"{"pull":0}"#).is_err());
        assert_eq!(line.reach(), 5);
    }

    #[test]
    fn the_state_shows_inputs_power_and_reach() {
        let mut line = line();
        for text in [
            r#"{"set":{"terminal":1,"channel":8,"value":1}}"#,
            r#"{"kill":3}"#,
        ] {
            ask(&mut line, text).unwrap();
        }
        let state = ask(&mut line, r#"{"state":null}"#).unwrap();
        assert_eq!(state["reached"], 2);
        assert_eq!(state["terminals"][0]["inputs"][7], 1);
        assert_eq!(state["terminals"][0]["state"], "INIT");
        assert_eq!(state["terminals"][2]["powered"], false);
        ask(&mut line, r#"{"start":3}"#).unwrap();
        assert_eq!(line.reach(), 5);
    }

    #[test]
    fn a_fault_on_purpose_is_that_of_the_drive() {
        let mut line = line();
        ask(&mut line, r#"{"fault":{"terminal":5,"code":8976}}"#).unwrap();
        let drive = &ask(&mut line, r#"{"state":null}"#).unwrap()["terminals"][4]["drive"];
        assert_eq!(
            (&drive["state"], &drive["error"]),
            (&json!("fault"), &json!(8976))
        );
    }
}
