//! The file that the loader writes for each command, `commands/<executor incarnation>/<id>.json`. Plain data; incident
//! files contain copies.

use rcc_language::names::Names;
use serde::{Deserialize, Serialize};

use crate::bodies::{Finding, RehearsalView};

/// Everything that the loader knows about a command and the executor does not.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CommandFile {
    /// The command's id.
    pub id: u64,
    /// The net's name; empty if the text does not even contain a valid one.
    pub net: String,
    /// The net's description.
    #[serde(default)]
    pub description: String,
    /// The text that was loaded; only the beginning for a rejected command.
    #[serde(default)]
    pub text: String,
    /// Slots of every port and monitor in the plan; `None` if the command was never ready.
    #[serde(default)]
    pub names: Option<Names>,
    /// Errors and warnings of the text.
    #[serde(default)]
    pub diagnostics: Vec<Finding>,
    /// Unique resources, as shown to people.
    #[serde(default)]
    pub uses: Vec<String>,
    /// Number of primitives.
    #[serde(default)]
    pub primitives: u32,
    /// Result of its rehearsal.
    #[serde(default)]
    pub rehearsal: Option<RehearsalView>,
    /// Time of loading, seconds since the Unix epoch.
    #[serde(default)]
    pub loaded_at: u64,
}

impl CommandFile {
    /// Returns true if the diagnostics contain an error.
    #[must_use]
    pub fn is_rejected(&self) -> bool {
        self.diagnostics.iter().any(|row| row.severity == "error")
    }
}
