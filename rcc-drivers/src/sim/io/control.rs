//! Requests at the control port of the simulated I/O station: one JSON object per line, answered by one JSON object.
//! Run by the control port's threads.
//!
//! `{"state":null}` · `{"set":{"discrete":{"address":3,"value":true}}}` · `{"set":{"input":{"address":0,"value":512}}}` ·
//! `{"freeze_ms":200}` · `{"exception":6}` · `{"delay_ms":30}` · `{"drop":10}` · `{"clear":null}` · `{"quit":null}`.
//! The requests with `freeze_ms`, `exception`, `delay_ms` and `drop` set faults, and `clear` ends them all. Addresses
//! start at 0. Answers: `{"ok":true}`, `{"error":"…"}`, or the state.

use super::process_image::{POINTS, ProcessImage};
use serde::Deserialize;

/// A request at the control port.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum IoCommand {
    /// Returns all points and counters.
    State,
    /// Sets an input; a looped-back input keeps this value until the next write of any output.
    Set(Input),
    /// Answers no Modbus request for this number of milliseconds.
    FreezeMs(u64),
    /// Answers every request with this exception; 0 ends it.
    Exception(u8),
    /// Delays every answer by this number of milliseconds; 0 ends it.
    DelayMs(u64),
    /// Leaves this number of further requests without an answer.
    Drop(u64),
    /// Ends all faults.
    Clear,
    /// Ends the simulator.
    Quit,
}

/// An input and its new value.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Input {
    /// A discrete input (digital).
    Discrete(PointValue<bool>),
    /// An input register (analog).
    Input(PointValue<u16>),
}

/// The address of a point, from 0, and its value.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PointValue<T> {
    /// Address, 0 to 63.
    pub address: usize,
    /// New value.
    pub value: T,
}

/// Why a command was refused.
#[derive(Debug, thiserror::Error)]
pub enum ControlError {
    /// The line is not a command.
    #[error("not a command: {0}")]
    Syntax(#[from] serde_json::Error),
    /// No input has this address.
    #[error("input {0} does not exist: write an address from 0 to {last}", last = POINTS - 1)]
    Address(usize),
    /// No Modbus exception has this code.
    #[error("Modbus exception {0} does not exist: write 1 to 6, 8, 10 or 11")]
    Exception(u8),
}

impl ProcessImage {
    /// Sets an input.
    ///
    /// # Errors
    /// Returns an error if no input has this address; nothing has changed then.
    pub fn set(&mut self, input: &Input) -> Result<(), ControlError> {
        match input {
            Input::Discrete(point) => put(&mut self.discrete, point),
            Input::Input(point) => put(&mut self.input, point),
        }
    }
}

fn put<T: Copy>(points: &mut [T], point: &PointValue<T>) -> Result<(), ControlError> {
    *points
        .get_mut(point.address)
        .ok_or(ControlError::Address(point.address))? = point.value;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_documented_line_is_a_command() {
        let text = include_str!("control.rs");
        let documented = text.lines().take_while(|line| line.starts_with("//!"));
        let lines: Vec<&str> = documented
            .flat_map(|line| line.split('`'))
            .filter(|part| part.starts_with('{') && !part.contains("ok") && !part.contains("error"))
            .collect();
        assert_eq!(lines.len(), 9);
        for line in lines {
            let command: Result<IoCommand, _> = serde_json::from_str(line);
            assert!(command.is_ok(), "{line}: {command:?}");
        }
    }

    #[test]
    fn an_input_beyond_the_last_is_refused() {
        let mut image = ProcessImage::new(Vec::new());
        let beyond = Input::Discrete(PointValue {
            address: 64,
            value: true,
        });
        assert!(matches!(image.set(&beyond), Err(ControlError::Address(64))));
        image
            .set(&Input::Input(PointValue {
                address: 63,
                value: 9,
            }))
            .unwrap();
        assert_eq!(image.input[63], 9);
    }
}
