//! The names of monitored values, from the files that the loader writes beside each command.
//! Read when a record of an unknown command comes; the loader wrote them before the executor had the plan.

use std::collections::HashMap;
use std::path::PathBuf;

use rcc_ipc::Cell;
use rcc_os::file;
use serde::Deserialize;

/// Longest file of a command that is read, bytes.
const COMMAND_FILE_MAX: u64 = 64 << 20;

/// One monitor of a net. What the loader writes besides is left alone.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
pub struct MonitorInfo {
    /// Id of the `Monitor` primitive.
    #[serde(default)]
    pub primitive: String,
    /// The port it watches, `primitive.port`.
    #[serde(default)]
    pub source: String,
    /// The value's type.
    #[serde(default, rename = "type")]
    pub ty: String,
    /// Its unit, if it has one that its type does not tell.
    #[serde(default)]
    pub unit: Option<String>,
}

/// What is known of a command.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CommandNames {
    /// The net's name.
    pub net: String,
    /// Its monitors, by index.
    pub monitors: Vec<MonitorInfo>,
}

#[derive(Deserialize)]
struct CommandFileNames {
    net: String,
    #[serde(default)]
    names: NetNames,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct NetNames {
    monitors: Vec<MonitorInfo>,
}

/// The names of the commands of one executor.
#[derive(Debug)]
pub struct CommandDirectory {
    folder: PathBuf,
    known: HashMap<u64, CommandNames>,
}

impl CommandDirectory {
    /// The commands of that life of the executor.
    #[must_use]
    pub fn of(cell: &Cell, incarnation: u64) -> CommandDirectory {
        CommandDirectory {
            folder: cell.commands_dir().join(format!("{incarnation:016x}")),
            known: HashMap::new(),
        }
    }

    /// A command; one without a file is named by its id.
    pub fn command(&mut self, id: u64) -> &CommandNames {
        let folder = &self.folder;
        self.known.entry(id).or_insert_with(|| {
            let bytes = file::read(&folder.join(format!("{id}.json")), COMMAND_FILE_MAX);
            let file = bytes
                .ok()
                .and_then(|bytes| serde_json::from_slice::<CommandFileNames>(&bytes).ok());
            file.map_or_else(
                || CommandNames {
                    net: format!("#{id}"),
                    monitors: Vec::new(),
                },
                |file| CommandNames {
                    net: file.net,
                    monitors: file.names.monitors,
                },
            )
        })
    }
}
