//! What the loader knows of every command without opening its file: its name, and what lists, operations and refusals
//! tell. Plain data behind the lock of the store; used by the server's blocking threads and by the lane of CANCEL.

use rcc_language::names::Names;

use super::api::{Finding, RehearsalView};
use super::store::CommandFile;

/// A command without what is long: its text, and where its ports lie, are in its file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CommandSummary {
    /// The net's name; empty when the text does not even tell that.
    pub net: String,
    /// The net's description.
    pub description: String,
    /// Faults and warnings of the text.
    pub diagnostics: Vec<Finding>,
    /// Unique resources, for people.
    pub uses: Vec<String>,
    /// Number of primitives.
    pub primitives: u32,
    /// What its rehearsal came to.
    pub rehearsal: Option<RehearsalView>,
    /// Seconds since the epoch at which it was loaded.
    pub loaded_at: u64,
    /// Its names without primitives and monitors: motions, inputs and topics.
    pub names: Names,
    /// It has names in full, in its file.
    pub is_named: bool,
}

impl CommandSummary {
    /// What of a command's file stays in memory.
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
    }
}
