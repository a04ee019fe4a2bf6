//! Contents, refusals and answers that requests at the control ports of all simulated robots have in common.
//! Parsed by the control port's threads; carried out by the clock thread.

use super::arm::dynamics::LoadError;
use super::arm::environment::WallError;
use super::control_socket::PathError;
use super::trace::TraceError;
use serde::{Deserialize, Serialize};
use std::fmt::Display;
use std::path::PathBuf;

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

impl InjectedWrench {
    /// Returns fx fy fz tx ty tz.
    pub fn elements(self) -> [f64; 6] {
        let ([fx, fy, fz], [tx, ty, tz]) = (self.force, self.torque);
        [fx, fy, fz, tx, ty, tz]
    }
}

/// State of the drives.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DriveSwitch {
    /// The drives are on.
    pub on: bool,
}

/// Share of answers to drop.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DropRate {
    /// Percentage, 0 to 100.
    pub percent: f64,
}

/// File of a trace.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TraceFile {
    /// The file, below the folder of the control socket; records are appended.
    pub path: PathBuf,
}

/// A request about the trace, which the control port's threads carry out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum TraceRequest {
    /// Starts a trace into a file.
    Open(PathBuf),
    /// Ends the trace.
    Close,
    /// Waits until the trace has been written to its file.
    Flush,
}

impl TraceRequest {
    /// Returns the request to start a trace into a file, or to end it.
    pub fn of(file: Option<TraceFile>) -> Self {
        file.map_or(Self::Close, |file| Self::Open(file.path))
    }
}

/// Why a request was refused, for reasons that all simulated robots have.
#[derive(Debug, thiserror::Error)]
pub enum RequestError {
    /// The line is not a command.
    #[error("not a command: {0}")]
    Syntax(#[from] serde_json::Error),
    /// The wall is invalid.
    #[error(transparent)]
    Wall(#[from] WallError),
    /// The load is invalid.
    #[error(transparent)]
    Load(#[from] LoadError),
    /// Not a percentage.
    #[error("invalid percentage {0}: write 0 to 100")]
    Percent(f64),
    /// Not a probability.
    #[error("invalid probability {0}: write 0 to 1")]
    Probability(f64),
    /// The arm still moves, so the fault cannot be acknowledged.
    #[error("the arm is still moving: send `ack` again when `at_rest` is true")]
    Moving,
    /// Requests may not name this file.
    #[error(transparent)]
    Path(#[from] PathError),
    /// The trace cannot be written.
    #[error(transparent)]
    Trace(#[from] TraceError),
    /// The clock thread does not answer.
    #[error("the controller's clock does not answer within 5 s")]
    NoAnswer,
}

impl DropRate {
    /// Returns the percentage.
    ///
    /// # Errors
    /// Returns an error for a number outside of 0 to 100.
    pub fn checked(self) -> Result<f64, RequestError> {
        match (0.0..=100.0).contains(&self.percent) {
            true => Ok(self.percent),
            false => Err(RequestError::Percent(self.percent)),
        }
    }
}

/// Result of a command.
#[derive(Clone, Debug)]
pub enum ControlAnswer<State> {
    /// The command was executed.
    Done,
    /// The whole state.
    State(Box<State>),
}

/// Formats the answer as one line of JSON.
pub fn to_line<State: Serialize, Refusal: Display>(
    answer: Result<ControlAnswer<State>, Refusal>,
) -> String {
    let value = match answer {
        Ok(ControlAnswer::Done) => serde_json::json!({ "ok": true }),
        Ok(ControlAnswer::State(state)) => match serde_json::to_value(&*state) {
            Ok(value) => value,
            Err(error) => serde_json::json!({ "error": error.to_string() }),
        },
        Err(error) => serde_json::json!({ "error": error.to_string() }),
    };
    value.to_string()
}

/// SplitMix64: the random numbers of a simulator, which its seed determines.
#[derive(Clone, Copy, Debug)]
pub struct Chance(pub u64);

impl Chance {
    /// Returns the next number in [0, 1).
    pub fn draw(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }
}
