//! Stores one file per command, `commands/<executor incarnation>/<id>.json`, and a summary of it in memory. The
//! loader's threads write a file before the executor gets the plan; monitors and a restarted loader read it, and
//! otherwise only requests that need a text or the slots of ports.

use std::collections::BTreeMap;
use std::fs;
use std::io::{self, BufWriter, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime};

use rcc_api::bodies::{Finding, RehearsalView, TextLocation};
use rcc_api::codes;
use rcc_api::command_file::CommandFile;
use rcc_ipc::Cell;
use rcc_language::names::{InputNames, Names, TopicNames};
use serde::Deserialize;

use super::command_summary::CommandSummary;
use super::published::Published;

/// Maximum size of all command files together, bytes; they are in memory (tmpfs).
pub const KEPT_MAX: u64 = 256 << 20;
/// Number of bytes of a file that are written at once.
const WRITTEN_AT_ONCE: usize = 64 << 10;
/// Maximum size of the stored text of a rejected command, bytes.
pub const REJECTED_TEXT_MAX: usize = 64 << 10;
/// Maximum size of the stored findings of a command, bytes; beyond it only their number is stored.
pub const FINDINGS_MAX: usize = 128 << 10;

/// Drops the data that a rejected command does not need: it cannot be started, but people look at its errors.
pub fn discard_excess(file: &mut CommandFile) {
    limit_findings(&mut file.diagnostics);
    if !file.is_rejected() {
        return;
    }
    file.names = None;
    let size = file.text.len();
    if size > REJECTED_TEXT_MAX {
        let end = file.text.floor_char_boundary(REJECTED_TEXT_MAX);
        file.text.truncate(end);
        file.text.shrink_to_fit();
        file.text
            .push_str(&format!("\n# the loader stored {end} of {size} bytes\n"));
    }
}

/// Keeps as many findings as fit into [`FINDINGS_MAX`], errors first, and adds one with the total number.
fn limit_findings(findings: &mut Vec<Finding>) {
    let size = |row: &Finding| {
        let location = |location: &Option<TextLocation>| {
            location
                .as_ref()
                .map_or(0, |location| location.file.len() + location.label.len())
        };
        let help = row.help.as_ref().map_or(0, String::len);
        row.message.len()
            + row.rendered.len()
            + help
            + location(&row.place)
            + location(&row.used_at)
            + 200
    };
    let count = findings.len();
    if findings.iter().map(size).sum::<usize>() <= FINDINGS_MAX {
        return;
    }
    // Errors first, so that a rejected command remains rejected.
    findings.sort_by_key(|row| row.severity != "error");
    for row in findings.iter_mut() {
        truncate_text(&mut row.message);
        truncate_text(&mut row.rendered);
        row.help.iter_mut().for_each(truncate_text);
        for location in row.place.iter_mut().chain(&mut row.used_at) {
            truncate_text(&mut location.file);
            truncate_text(&mut location.label);
        }
    }
    let mut sum = 0;
    findings.retain(|row| {
        sum += size(row);
        sum <= FINDINGS_MAX
    });
    let (kept, message) = (findings.len(), "the loader stores only the first ones");
    if kept < count {
        findings.push(Finding {
            code: codes::NOT_KEPT.code.to_owned(),
            severity: "warning".to_owned(),
            message: format!("{count} findings, {kept} are shown: {message}"),
            help: Some("`rcc-cli check FILE` shows all".to_owned()),
            rendered: format!(
                "{count} findings, {kept} are shown; `rcc-cli check FILE` shows all\n"
            ),
            ..Finding::default()
        });
    }
}

/// Truncates a text of a finding, which may quote a text of any length.
fn truncate_text(text: &mut String) {
    const TEXT_MAX: usize = 8 << 10;
    if text.len() > TEXT_MAX {
        text.truncate(text.floor_char_boundary(TEXT_MAX));
        text.push('…');
    }
}

/// The reason why a command has no file.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The system refused to write the file.
    #[error("{path}: {source}")]
    File {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// The limit is reached, and by commands that are not rejected.
    #[error(
        "no room for {size} bytes: the loader already stores {kept} of at most {bytes_max} bytes for its commands"
    )]
    Full {
        /// Size of the file, bytes.
        size: u64,
        /// Bytes in use.
        kept: u64,
        /// The limit.
        bytes_max: u64,
    },
}

/// The commands of one incarnation of the executor.
#[derive(Debug)]
pub struct CommandStore {
    folder: PathBuf,
    bytes_max: u64,
    index: Published<StoreIndex>,
}

#[derive(Clone, Debug, Default)]
struct StoreIndex {
    kept: u64,
    rows: BTreeMap<u64, IndexRow>,
}

#[derive(Clone, Debug)]
struct IndexRow {
    summary: Arc<CommandSummary>,
    /// Size of its file, bytes; 0 if it has none.
    bytes: u64,
    is_rejected: bool,
    since: Instant,
}

/// The fields of a file that a restarted loader reads; the rest is skipped.
#[derive(Default, Deserialize)]
#[serde(default)]
struct CommandFileSummary {
    net: String,
    description: String,
    names: Option<SummaryNames>,
    diagnostics: Vec<Finding>,
    uses: Vec<String>,
    primitives: u32,
    rehearsal: Option<RehearsalView>,
    loaded_at: u64,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct SummaryNames {
    net: String,
    inputs: Vec<InputNames>,
    publishes: Vec<TopicNames>,
    motions: Vec<String>,
    outcomes: Vec<String>,
}

impl From<CommandFileSummary> for CommandSummary {
    fn from(file: CommandFileSummary) -> CommandSummary {
        let is_named = file.names.is_some();
        let names = file.names.unwrap_or_default();
        CommandSummary {
            net: file.net,
            description: file.description,
            diagnostics: file.diagnostics,
            uses: file.uses,
            primitives: file.primitives,
            rehearsal: file.rehearsal,
            loaded_at: file.loaded_at,
            names: Names {
                net: names.net,
                inputs: names.inputs,
                publishes: names.publishes,
                motions: names.motions,
                outcomes: names.outcomes,
                ..Names::default()
            },
            is_named,
        }
    }
}

impl CommandStore {
    /// Opens the folder for the commands of this incarnation of the executor, with an empty index.
    #[must_use]
    pub fn of(cell: &Cell, incarnation: u64) -> CommandStore {
        CommandStore {
            folder: cell.commands_dir().join(format!("{incarnation:016x}")),
            bytes_max: KEPT_MAX,
            index: Published::default(),
        }
    }

    /// As [`CommandStore::of`], with the commands that an earlier loader left there.
    #[must_use]
    pub fn open(cell: &Cell, incarnation: u64) -> CommandStore {
        let store = CommandStore::of(cell, incarnation);
        let mut index = StoreIndex::default();
        for path in entries(&store.folder) {
            if path.extension().is_none_or(|extension| extension != "json") {
                // Incomplete: a loader died while writing it.
                let _ = fs::remove_file(&path);
                continue;
            }
            let Some(id) = id_of(&path) else {
                continue;
            };
            if let Some((summary, bytes)) = read::<CommandFileSummary>(&path) {
                index.insert(id, summary.into(), bytes);
            }
        }
        store.index.change(|published| *published = index);
        store
    }

    fn path(&self, id: u64) -> PathBuf {
        self.folder.join(format!("{id}.json"))
    }

    /// Writes the file completely or not at all, and updates the summary in memory, which requests by name need; the
    /// latter also if there is no room for the file. The oldest files of rejected commands make room for new ones.
    ///
    /// # Errors
    /// Returns [`StoreError::File`] if the system refuses the file, and [`StoreError::Full`] if the limit is reached.
    pub fn write(&self, command: &CommandFile) -> Result<(), StoreError> {
        let summary = CommandSummary::of(command);
        let written = self.write_file(command);
        let bytes = written.as_ref().map_or(0, |bytes| *bytes);
        self.index
            .change(|index| index.insert(command.id, summary, bytes));
        written.map(|_| ())
    }

    fn write_file(&self, command: &CommandFile) -> Result<u64, StoreError> {
        let path = self.path(command.id);
        let failed = |source| StoreError::File {
            path: path.clone(),
            source,
        };
        let partial = path.with_extension("half");
        let write = || {
            fs::create_dir_all(&self.folder)?;
            let mut options = fs::OpenOptions::new();
            options.write(true).create(true).truncate(true).mode(0o600);
            let mut file = BufWriter::with_capacity(WRITTEN_AT_ONCE, options.open(&partial)?);
            serde_json::to_writer(&mut file, command)?;
            file.flush()?;
            Ok(file.get_ref().metadata()?.len())
        };
        let removed = |error| {
            // If this fails too, the next incarnation of the loader removes the incomplete file.
            let _ = fs::remove_file(&partial);
            error
        };
        let bytes = write().map_err(failed).map_err(removed)?;
        self.make_room(command.id, bytes).map_err(removed)?;
        fs::rename(&partial, &path)
            .map_err(failed)
            .map_err(removed)?;
        Ok(bytes)
    }

    /// Checks that a file of this size could be written, with rejected commands making room for it.
    ///
    /// # Errors
    /// Returns [`StoreError::Full`] if the limit would be exceeded.
    pub fn has_room(&self, bytes: u64) -> Result<(), StoreError> {
        let index = self.index.get();
        let stay = index.rows.values().filter(|row| !row.is_rejected);
        let kept: u64 = stay.map(|row| row.bytes).sum();
        if kept + bytes > self.bytes_max {
            return Err(StoreError::Full {
                size: bytes,
                kept,
                bytes_max: self.bytes_max,
            });
        }
        Ok(())
    }

    /// Removes the oldest files of rejected commands until `bytes` more fit.
    fn make_room(&self, id: u64, bytes: u64) -> Result<(), StoreError> {
        let (others, going) = self.index.change(|index| {
            let room = self.bytes_max.saturating_sub(bytes);
            index.forget_rejected(id, room)
        });
        for other in going {
            // A file that cannot be removed is no longer counted, and the next sweep does not find it: its folder is
            // removed with the executor.
            let _ = fs::remove_file(self.path(other));
        }
        if others + bytes > self.bytes_max {
            return Err(StoreError::Full {
                size: bytes,
                kept: others,
                bytes_max: self.bytes_max,
            });
        }
        Ok(())
    }

    /// Returns the summary of a command.
    #[must_use]
    pub fn summary(&self, id: u64) -> Option<Arc<CommandSummary>> {
        self.index
            .get()
            .rows
            .get(&id)
            .map(|row| Arc::clone(&row.summary))
    }

    /// Returns the ids of the commands whose net has this name.
    #[must_use]
    pub fn named(&self, net: &str) -> Vec<u64> {
        let index = self.index.get();
        let rows = index.rows.iter().filter(|(_, row)| row.summary.net == net);
        rows.map(|(id, _)| *id).collect()
    }

    /// Returns the names of the nets of all commands.
    #[must_use]
    pub fn nets(&self) -> Vec<String> {
        let index = self.index.get();
        index
            .rows
            .values()
            .map(|row| row.summary.net.clone())
            .collect()
    }

    /// Maximum size of all command files together, bytes; they are in memory (tmpfs).
    #[must_use]
    pub fn kept(&self) -> u64 {
        self.index.get().kept
    }

    /// Reads the file of a command; `None` if it is missing or damaged.
    #[must_use]
    pub fn read(&self, id: u64) -> Option<CommandFile> {
        read(&self.path(id)).map(|(file, _)| file)
    }

    /// Reads the slots of a command's ports; `None` if it has no file or was never ready.
    #[must_use]
    pub fn names(&self, id: u64) -> Option<Names> {
        #[derive(Deserialize)]
        struct Named {
            names: Option<Names>,
        }
        read::<Named>(&self.path(id)).and_then(|(file, _)| file.names)
    }

    /// Removes a command and its file, if there is one.
    pub fn remove(&self, id: u64) {
        self.index.change(|index| index.remove(id));
        // A file that cannot be removed now is removed by the next sweep.
        let _ = fs::remove_file(self.path(id));
    }

    /// Removes the files of commands that no longer exist and are older than `age`. A command is in the executor's
    /// table before its file is written, so a younger file may only be newer than the snapshot.
    pub fn sweep(&self, exists: impl Fn(u64) -> bool, age: Duration) {
        let mut gone = Vec::new();
        for path in entries(&self.folder) {
            let id = id_of(&path);
            if !id.is_some_and(&exists) && is_older(&path, age) {
                // The next sweep tries again.
                let _ = fs::remove_file(&path);
                gone.extend(id);
            }
        }
        // Commands without a file.
        let stays =
            |id: u64, row: &IndexRow| row.bytes > 0 || exists(id) || row.since.elapsed() < age;
        let is_gone = |id: u64, row: &IndexRow| gone.contains(&id) || !stays(id, row);
        let unchanged = |index: &StoreIndex| !index.rows.iter().any(|(id, row)| is_gone(*id, row));
        if unchanged(&self.index.get()) {
            return;
        }
        self.index.change(|index| {
            gone.iter().for_each(|id| index.remove(*id));
            index.rows.retain(|id, row| stays(*id, row));
        });
    }

    /// Removes the folders of dead executors.
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

impl StoreIndex {
    fn insert(&mut self, id: u64, summary: CommandSummary, bytes: u64) {
        self.remove(id);
        self.kept += bytes;
        let is_rejected = summary
            .diagnostics
            .iter()
            .any(|row| row.severity == "error");
        let summary = Arc::new(summary);
        let row = IndexRow {
            summary,
            bytes,
            is_rejected,
            since: Instant::now(),
        };
        self.rows.insert(id, row);
    }

    /// Forgets the files of the oldest rejected commands until all files but that of `id` have at most `room` bytes.
    /// Returns the bytes that they have then, and the ids.
    fn forget_rejected(&mut self, id: u64, room: u64) -> (u64, Vec<u64>) {
        let own = self.rows.get(&id).map_or(0, |row| row.bytes);
        let (mut others, mut going) = (self.kept - own, Vec::new());
        let has_rejected_file = |row: &IndexRow| row.is_rejected && row.bytes > 0;
        let rows = self.rows.iter_mut();
        for (other, row) in rows.filter(|(other, row)| **other != id && has_rejected_file(row)) {
            if others <= room {
                break;
            }
            others -= row.bytes;
            row.bytes = 0;
            going.push(*other);
        }
        self.kept = others + own;
        (others, going)
    }

    fn remove(&mut self, id: u64) {
        if let Some(row) = self.rows.remove(&id) {
            self.kept = self.kept.saturating_sub(row.bytes);
        }
    }
}

/// Returns the parsed content of a file, and its length in bytes.
fn read<T: serde::de::DeserializeOwned>(path: &Path) -> Option<(T, u64)> {
    let bytes = fs::read(path).ok()?;
    let value = serde_json::from_slice(&bytes).ok()?;
    Some((value, bytes.len() as u64))
}

fn id_of(path: &Path) -> Option<u64> {
    path.file_stem()
        .and_then(|stem| stem.to_str()?.parse().ok())
}

fn entries(folder: &Path) -> Vec<PathBuf> {
    fs::read_dir(folder)
        .map(|entries| entries.flatten().map(|summary| summary.path()).collect())
        .unwrap_or_default()
}

/// Returns true if a file was written at least `age` ago, or is dated that far in the future: then the wall clock was set
/// back since.
fn is_older(path: &Path, age: Duration) -> bool {
    let modified = fs::metadata(path).and_then(|found| found.modified());
    modified.is_ok_and(|modified| {
        let passed = SystemTime::now().duration_since(modified);
        passed.unwrap_or_else(|error| error.duration()) >= age
    })
}

#[cfg(test)]
mod tests;
