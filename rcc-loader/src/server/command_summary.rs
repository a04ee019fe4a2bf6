//! Summary of each command that the loader keeps in memory: its name, and the facts that lists, operations and refusals
//! show. Plain data behind the lock of the store; used by the server's blocking threads and by the workers of CANCEL
//! and ABORT.

use rcc_api::bodies::{Finding, RehearsalView};
use rcc_api::command_file::CommandFile;
use rcc_language::names::Names;

/// A command without its long parts: its text and the slots of its ports are only in its file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CommandSummary {
    /// The net's name; empty if the text does not even contain a valid one.
    pub net: String,
    /// The net's description.
    pub description: String,
    /// Errors and warnings of the text.
    pub diagnostics: Vec<Finding>,
    /// Unique resources, as shown to people.
    pub uses: Vec<String>,
    /// Number of primitives.
    pub primitives: u32,
    /// Result of its rehearsal.
    pub rehearsal: Option<RehearsalView>,
    /// Time of loading, seconds since the Unix epoch.
    pub loaded_at: u64,
    /// Names of its motions, inputs, topics and outcomes; without primitives and monitors.
    pub names: Names,
    /// True if its file has the full names.
    pub is_named: bool,
}

impl CommandSummary {
    /// Returns the part of a command's file that stays in memory.
    #[must_use]
    pub fn of(file: &CommandFile) -> CommandSummary {
        let names = file.names.as_ref();
        CommandSummary {
            net: file.net.clone(),
            description: file.description.clone(),
            diagnostics: file.diagnostics.clone(),
            uses: file.uses.clone(),
            primitives: file.primitives,
            rehearsal: file.rehearsal.clone(),
            loaded_at: file.loaded_at,
            names: names.map(short).unwrap_or_default(),
            is_named: names.is_some(),
        }
    }
}

fn short(names: &Names) -> Names {
    Names {
        net: names.net.clone(),
        primitives: Vec::new(),
        monitors: Vec::new(),
        inputs: names.inputs.clone(),
        publishes: names.publishes.clone(),
        motions: names.motions.clone(),
        outcomes: names.outcomes.clone(),
    }
}
