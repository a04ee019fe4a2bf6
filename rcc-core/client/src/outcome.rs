//! How a net ended. Plain data.

use std::fmt;

/// How a command ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Outcome {
    /// The net's name.
    pub net: String,
    /// The command's id.
    pub id: u64,
    /// `finished canceled aborted fault`.
    pub reason: String,
    /// Name of the outcome of its `Termination`, if it has one.
    pub outcome: Option<String>,
    /// How it ended, in words.
    pub words: String,
    /// Number of its evaluations.
    pub cycles: u64,
}

impl fmt::Display for Outcome {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Outcome {
            net,
            id,
            reason,
            words,
            ..
        } = self;
        let words = if words.is_empty() { reason } else { words };
        write!(formatter, "{net}#{id}  {words}")
    }
}
