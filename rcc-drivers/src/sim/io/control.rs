//! The control port's language of the simulated I/O station: one JSON object a line, one JSON object as the answer.
//! The control port's threads run it.
//!
//! `{"state":null}` · `{"set":{"discrete":{"address":3,"value":true}}}` · `{"set":{"input":{"address":0,"value":512}}}` ·
//! `{"freeze_ms":200}` · `{"exception":6}` · `{"delay_ms":30}` · `{"drop":10}` · `{"clear":null}` · `{"quit":null}`.
//! The four before the last are faults, and `clear` ends them all. Addresses count from 0. Answers: `{"ok":true}`, `{"error":"…"}`, or the state.

use super::process_image::{POINTS, ProcessImage};
use serde::Deserialize;

/// A line of the control port.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum IoCommand {
    /// All points and counters.
    State,
    /// Sets an input; a wired one keeps the value until the next write of any output.
    Set(Input),
    /// Answers no Modbus request for this many milliseconds.
    FreezeMs(u64),
    /// Answers every request with this exception; 0 ends it.
    Exception(u8),
    /// Answers every request later by this many milliseconds; 0 ends it.
    DelayMs(u64),
    /// Gives the next requests, so many, no answer.
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
    /// Digital.
    Discrete(PointValue<bool>),
    /// Analog.
    Input(PointValue<u16>),
}

/// An address from 0 and a value.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PointValue<T> {
    /// 0 to 63.
    pub address: usize,
    /// New value.
    pub value: T,
}

/// Why a command was refused.
#[derive(Debug, thiserror::Error)]
pub enum ControlError {
    /// Not a command.
    #[error("not a command: {0}")]
    Syntax(#[from] serde_json::Error),
    /// No such input.
    #[error("inputs have the addresses 0 to {last}, there is no {0}", last = POINTS - 1)]
    Address(usize),
    /// No such exception.
    #[error("Modbus has the exceptions 1 to 6, 8, 10 and 11, there is no {0}")]
    Exception(u8),
}

impl ProcessImage {
    /// Sets an input.
    ///
    /// # Errors
    /// There is no such input; nothing has changed then.
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
