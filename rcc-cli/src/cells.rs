//! The running cells of this machine, of all users, found by the command lines of their executors: a cell's own files
//! are hidden from other users. Run by the main thread; changes nothing.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use rcc_api::codes;
use rcc_ipc::cell::{base_dir, person};

use crate::failure::Failure;

/// Name of the executor's program; every running cell has one.
const EXECUTOR: &str = "rcc-exec";
/// Most cells that a message lists.
const LISTED_MAX: usize = 8;

/// A running cell.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MachineCell {
    /// Name.
    pub name: String,
    /// User id of its owner.
    pub owner: u32,
    /// Runtime folder; `None` if it is hidden from this user.
    pub folder: Option<PathBuf>,
    /// Process id of its executor.
    pub pid: u32,
}

impl MachineCell {
    /// Formats name, owner and place: `lab (user rcc (uid 998), /run/rcc/lab)`.
    #[must_use]
    pub fn describe(&self) -> String {
        let owner = match self.owner == uid() {
            true => "yours".to_owned(),
            false => person(self.owner),
        };
        let place = match &self.folder {
            Some(folder) => folder.display().to_string(),
            None => format!("process {}", self.pid),
        };
        format!("{} ({owner}, {place})", self.name)
    }
}

/// Returns the running cells of all users, by name and owner.
#[must_use]
pub fn running() -> Vec<MachineCell> {
    let entries = fs::read_dir("/proc").into_iter().flatten().flatten();
    let pids = entries.filter_map(|entry| entry.file_name().to_str()?.parse().ok());
    let mut cells: Vec<MachineCell> = pids.filter_map(of_process).collect();
    cells.sort_by(|a, b| (&a.name, a.owner, a.pid).cmp(&(&b.name, b.owner, b.pid)));
    cells
}

/// Returns the cell of an executor; `None` for every other process.
fn of_process(pid: u32) -> Option<MachineCell> {
    let process = PathBuf::from(format!("/proc/{pid}"));
    let line = fs::read(process.join("cmdline")).ok()?;
    let name = cell_of(&line)?;
    let owner = fs::metadata(&process).ok()?.uid();
    let environment = fs::read(process.join("environ")).unwrap_or_default();
    let folder = bases(owner, &variables(&environment))
        .into_iter()
        .map(|base| base.join(&name))
        .find(|folder| folder.is_dir());
    Some(MachineCell {
        name,
        owner,
        folder,
        pid,
    })
}

/// Returns the cell that the command line of an executor names.
fn cell_of(line: &[u8]) -> Option<String> {
    let mut words = line.split(|byte| *byte == 0);
    let program = std::str::from_utf8(words.next()?).ok()?;
    if Path::new(program).file_name()? != EXECUTOR {
        return None;
    }
    words.find(|word| *word == b"--cell")?;
    let name = std::str::from_utf8(words.next()?).ok()?;
    Some(name.to_owned()).filter(|name| !name.is_empty())
}

fn variables(environment: &[u8]) -> BTreeMap<String, String> {
    let rows = environment.split(|byte| *byte == 0);
    let rows = rows.filter_map(|row| std::str::from_utf8(row).ok()?.split_once('='));
    rows.filter(|(_, value)| !value.is_empty())
        .map(|(name, value)| (name.to_owned(), value.to_owned()))
        .collect()
}

/// Returns the folders in which a user's cells may be, the most likely one first; see [`base_dir`].
fn bases(owner: u32, environment: &BTreeMap<String, String>) -> Vec<PathBuf> {
    let named = environment.get("RCC_RUNTIME_DIR").map(PathBuf::from);
    let session = environment.get("XDG_RUNTIME_DIR");
    let session = session.map(|session| Path::new(session).join("rcc"));
    let root = (owner == 0).then(|| PathBuf::from("/run/rcc"));
    let own = (owner == uid()).then(base_dir);
    let usual = [
        PathBuf::from("/run/rcc"),
        PathBuf::from(format!("/run/user/{owner}/rcc")),
        PathBuf::from(format!("/tmp/rcc-{owner}")),
    ];
    let all = named.into_iter().chain(root).chain(session).chain(own);
    all.chain(usual).collect()
}

/// Returns the failure for a cell that does not run in this user's folder: says which cells run, whose and where.
#[must_use]
pub fn not_found(name: &str) -> Failure {
    not_found_among(name, &running())
}

fn not_found_among(name: &str, cells: &[MachineCell]) -> Failure {
    let (own, message) = (
        uid(),
        format!("cell `{name}` not found in {}", base_dir().display()),
    );
    let same = cells.iter().find(|cell| cell.name == name);
    if let Some(cell) = same.filter(|cell| cell.owner != own) {
        let help = "work as that user; or give the cell `access: {group: …}` or `access: {tcp: …}` (docs/security.md), and use RCC_RUNTIME_DIR or --url";
        let message = format!("{message}; it belongs to another user: {}", cell.describe());
        return Failure::new(codes::NO_LOADER, message, help);
    }
    if let Some((cell, folder)) = same.and_then(|cell| Some((cell, cell.folder.as_ref()?))) {
        let base = folder.parent().unwrap_or(folder).display().to_string();
        let message = format!("{message}; it runs elsewhere: {}", cell.describe());
        return Failure::new(
            codes::NO_LOADER,
            message,
            format!("set RCC_RUNTIME_DIR={base}"),
        );
    }
    let message = match list(cells) {
        none if none.is_empty() => format!("{message}; no cell is running on this machine"),
        list => format!("{message}; running cells: {list}"),
    };
    let help = "start the cell with `rcc-cli up FILE`, or name another cell with --cell (RCC_CELL)";
    Failure::new(codes::NO_LOADER, message, help)
}

/// Lists running cells, at most [`LISTED_MAX`].
fn list(cells: &[MachineCell]) -> String {
    let mut words: Vec<String> = cells
        .iter()
        .take(LISTED_MAX)
        .map(MachineCell::describe)
        .collect();
    if let Some(more) = cells.len().checked_sub(LISTED_MAX).filter(|more| *more > 0) {
        words.push(format!("and {more} more"));
    }
    words.join(", ")
}

fn uid() -> u32 {
    nix::unistd::getuid().as_raw()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cell(name: &str, owner: u32, folder: Option<&str>) -> MachineCell {
        MachineCell {
            name: name.to_owned(),
            owner,
            folder: folder.map(PathBuf::from),
            pid: 4711,
        }
    }

    #[test]
    fn an_executor_names_its_cell() {
        let line = |words: &[&str]| cell_of(words.join("\0").as_bytes());
        let executor = [
            "/usr/bin/rcc-exec",
            "--cell",
            "lab",
            "--config",
            "/etc/rcc/lab.yaml",
        ];
        assert_eq!(line(&executor).as_deref(), Some("lab"));
        assert_eq!(line(&["/usr/bin/rcc-loader", "--cell", "lab"]), None);
        assert_eq!(line(&["rcc-exec", "--cell"]), None);
        assert_eq!(line(&[""]), None);
    }

    #[test]
    fn the_message_says_which_cells_run_whose_and_where() {
        let (own, other) = (uid(), uid() + 7);
        let cells = [
            cell("lab", other, None),
            cell("line", own, Some("/tmp/x/line")),
        ];
        let message = |name: &str| not_found_among(name, &cells).body;
        let of_other = message("lab");
        assert!(
            of_other.message.contains("belongs to another user"),
            "{of_other:?}"
        );
        assert!(
            of_other.message.contains(&format!("uid {other}")),
            "{of_other:?}"
        );
        assert!(of_other.message.contains("process 4711"), "{of_other:?}");
        let elsewhere = message("line");
        assert!(
            elsewhere.message.contains("line (yours, /tmp/x/line)"),
            "{elsewhere:?}"
        );
        assert_eq!(
            elsewhere.help.as_deref(),
            Some("set RCC_RUNTIME_DIR=/tmp/x")
        );
        let unknown = message("demo");
        assert!(
            unknown.message.contains("running cells: lab (")
                && unknown.message.contains("line (yours")
        );
        let none = not_found_among("demo", &[]).body;
        assert!(none.message.contains("no cell is running"), "{none:?}");
    }
}
