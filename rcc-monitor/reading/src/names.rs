//! The names of monitored values, from the files that the loader writes for each command. A file is read when a record
//! of an unknown command arrives; the loader wrote it before the executor had the plan.

use std::collections::HashMap;
use std::path::PathBuf;

use rcc_ipc::Cell;
use rcc_os::file;
use serde::Deserialize;

/// Maximum size of a command file, bytes.
const COMMAND_FILE_MAX: u64 = 64 << 20;

/// One monitor of a net. Other fields of the file are ignored.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
pub struct MonitorInfo {
    /// Id of the `Monitor` primitive.
    #[serde(default)]
    pub primitive: String,
    /// The observed port, `primitive.port`.
    #[serde(default)]
    pub source: String,
    /// The value's type.
    #[serde(default, rename = "type")]
    pub ty: String,
    /// Its unit, if there is one that the type does not imply.
    #[serde(default)]
    pub unit: Option<String>,
    /// Number of elements.
    #[serde(default)]
    pub width: u32,
    /// Number of evaluations of the net between two values.
    #[serde(default)]
    pub every: u32,
    /// The value is never null.
    #[serde(default)]
    pub never_null: bool,
}

/// The names of a command.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CommandNames {
    /// The net's name.
    pub net: String,
    /// Its monitors, by index.
    pub monitors: Vec<MonitorInfo>,
    /// The text that was loaded.
    pub text: String,
}

#[derive(Deserialize)]
struct CommandFileNames {
    net: String,
    #[serde(default)]
    text: String,
    #[serde(default)]
    names: NetNames,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct NetNames {
    monitors: Vec<MonitorInfo>,
}

/// Caches the names of the commands of one executor.
#[derive(Debug)]
pub struct CommandDirectory {
    folder: PathBuf,
    known: HashMap<u64, CommandNames>,
}

impl CommandDirectory {
    /// Creates an empty cache for this incarnation of the executor.
    #[must_use]
    pub fn of(cell: &Cell, incarnation: u64) -> CommandDirectory {
        CommandDirectory {
            folder: cell.commands_dir().join(format!("{incarnation:016x}")),
            known: HashMap::new(),
        }
    }

    /// Forgets what was read: a program that runs for weeks would keep the text of every command.
    pub fn forget(&mut self) {
        self.known.clear();
    }

    /// Returns the names of a command; one without a file is named by its id.
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
                    ..CommandNames::default()
                },
                |file| CommandNames {
                    net: file.net,
                    monitors: file.names.monitors,
                    text: file.text,
                },
            )
        })
    }
}
