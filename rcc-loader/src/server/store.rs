//! The files that give commands their names: `commands/<executor incarnation>/<id>.json`, one a command.
//! Written by the loader's threads before the executor gets a plan; read by monitors and by a restarted loader.

use std::fs;
use std::io::{self, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use rcc_ipc::Cell;
use serde::{Deserialize, Serialize};

use super::api::{Finding, RehearsalView};

/// Everything the loader knows about a command and the executor does not.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CommandFile {
    /// The command's id.
    pub id: u64,
    /// The net's name; empty when the text does not even tell that.
    pub net: String,
    /// The net's description.
    #[serde(default)]
    pub description: String,
    /// The text that was loaded.
    pub text: String,
    /// Where every port and monitor lies in the plan.
    #[serde(default)]
    pub names: serde_json::Value,
    /// Faults and warnings of the text.
    #[serde(default)]
    pub diagnostics: Vec<Finding>,
    /// Unique resources, for people.
    #[serde(default)]
    pub uses: Vec<String>,
    /// Number of primitives.
    #[serde(default)]
    pub primitives: u32,
    /// What its rehearsal came to.
    #[serde(default)]
    pub rehearsal: Option<RehearsalView>,
    /// Seconds since the epoch at which it was loaded.
    #[serde(default)]
    pub loaded_at: u64,
}

/// The folder of one executor's commands.
#[derive(Clone, Debug)]
pub struct Store {
    folder: PathBuf,
}

impl Store {
    /// The folder for the commands of that life of the executor.
    #[must_use]
    pub fn of(cell: &Cell, incarnation: u64) -> Store {
        Store {
            folder: cell.commands_dir().join(format!("{incarnation:016x}")),
        }
    }

    fn path(&self, id: u64) -> PathBuf {
        self.folder.join(format!("{id}.json"))
    }

    /// Writes the file whole or not at all.
    ///
    /// # Errors
    /// What the system says, with the path.
    pub fn write(&self, command: &CommandFile) -> io::Result<()> {
        let path = self.path(command.id);
        let named =
            |error: io::Error| io::Error::new(error.kind(), format!("{}: {error}", path.display()));
        fs::create_dir_all(&self.folder).map_err(named)?;
        let bytes = serde_json::to_vec(command).map_err(io::Error::other)?;
        let half = path.with_extension("half");
        let mut options = fs::OpenOptions::new();
        options.write(true).create(true).truncate(true).mode(0o600);
        let mut file = options.open(&half).map_err(named)?;
        file.write_all(&bytes).map_err(named)?;
        fs::rename(&half, &path).map_err(named)
    }

    /// The file of a command; `None` if there is none or it is not one.
    #[must_use]
    pub fn read(&self, id: u64) -> Option<CommandFile> {
        let bytes = fs::read(self.path(id)).ok()?;
        serde_json::from_slice(&bytes).ok()
    }

    /// Forgets a command. A file that is not there is no error.
    pub fn remove(&self, id: u64) {
        // What cannot be removed now is removed by the next sweep.
        let _ = fs::remove_file(self.path(id));
    }

    /// Removes the files of commands that do not exist any more and are older than `age`: a command is in the
    /// executor's table before its file is written, so a young one may only be newer than the snapshot.
    pub fn sweep(&self, exists: impl Fn(u64) -> bool, age: Duration) {
        for path in entries(&self.folder) {
            let id = path
                .file_stem()
                .and_then(|stem| stem.to_str()?.parse().ok());
            if !id.is_some_and(&exists) && is_older(&path, age) {
                // The next sweep tries again.
                let _ = fs::remove_file(&path);
            }
        }
    }

    /// Removes the folders of executors that are dead.
    pub fn remove_others(&self) {
        let Some(parent) = self.folder.parent() else {
            return;
        };
        for path in entries(parent) {
            if path != self.folder {
                // The next new executor tries again.
                let _ = fs::remove_dir_all(&path);
            }
        }
    }
}

fn entries(folder: &Path) -> Vec<PathBuf> {
    fs::read_dir(folder)
        .map(|entries| entries.flatten().map(|entry| entry.path()).collect())
        .unwrap_or_default()
}

fn is_older(path: &Path, age: Duration) -> bool {
    let modified = fs::metadata(path).and_then(|found| found.modified());
    modified.is_ok_and(|modified| {
        SystemTime::now()
            .duration_since(modified)
            .is_ok_and(|passed| passed >= age)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Folder(Store);

    impl Folder {
        fn new(name: &str) -> Folder {
            let base =
                std::env::temp_dir().join(format!("rcc-store-{}-{name}", std::process::id()));
            Folder(Store {
                folder: base.join("00000000000000aa"),
            })
        }
    }

    impl Drop for Folder {
        fn drop(&mut self) {
            if let Some(base) = self.0.folder.parent() {
                let _ = fs::remove_dir_all(base);
            }
        }
    }

    fn command(id: u64) -> CommandFile {
        CommandFile {
            id,
            net: "line".into(),
            ..CommandFile::default()
        }
    }

    #[test]
    fn what_is_written_is_read_back() -> io::Result<()> {
        let folder = Folder::new("back");
        folder.0.write(&command(7))?;
        assert_eq!(folder.0.read(7), Some(command(7)));
        assert_eq!(folder.0.read(8), None);
        Ok(())
    }

    #[test]
    fn a_sweep_removes_what_does_not_exist_and_nothing_young() -> io::Result<()> {
        let folder = Folder::new("sweep");
        for id in [1, 2] {
            folder.0.write(&command(id))?;
        }
        folder.0.sweep(|id| id == 1, Duration::from_secs(3600));
        assert!(folder.0.read(2).is_some());
        folder.0.sweep(|id| id == 1, Duration::ZERO);
        assert!(folder.0.read(1).is_some() && folder.0.read(2).is_none());
        Ok(())
    }

    #[test]
    fn folders_of_dead_executors_go() -> io::Result<()> {
        let folder = Folder::new("others");
        folder.0.write(&command(1))?;
        let other = folder.0.folder.with_file_name("00000000000000bb");
        fs::create_dir_all(&other)?;
        folder.0.remove_others();
        assert!(!other.exists() && folder.0.read(1).is_some());
        Ok(())
    }
}
