//! Removes leftovers of dead cells and nothing else: the lock of a cell with a living process refuses. Run by the main
//! thread.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use rcc_core::counted::Counted;
use rcc_ipc::Cell;
use rcc_ipc::clean::remove_cell;
use serde::Serialize;

use super::facts::cells::{self, CellFacts, StrayMemory};

/// Removed items, and items that could not be removed.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Cleaned {
    /// Removed items, one line each.
    pub removed: Vec<String>,
    /// Items that could not be removed, with the reason, one line each.
    pub refused: Vec<String>,
}

/// Removes dead cells below `base`. With `shm`, also removes unused shared memory there that belongs to no cell below
/// `base` and is owned by this user (as root: by anybody).
#[must_use]
pub fn clean(base: &Path, shm: Option<&Path>) -> Cleaned {
    let mut cleaned = Cleaned::default();
    let dead = |cell: &CellFacts| cell.living.is_empty() && cell.refused.is_none();
    for cell in cells::read(base).into_iter().filter(dead) {
        match remove(&cell) {
            Ok(Some(line)) => cleaned.removed.push(line),
            Ok(None) => {}
            Err(reason) => cleaned.refused.push(reason),
        }
    }
    let Some(shm) = shm else { return cleaned };
    let uid = nix::unistd::getuid();
    let ours = |stray: &StrayMemory| !stray.used && (uid.is_root() || stray.owner == uid.as_raw());
    for stray in cells::strays(shm, base).into_iter().filter(ours) {
        match remove_all(&stray.paths) {
            Ok(()) => cleaned.removed.push(format!(
                "shared memory {}*: {}",
                stray.prefix,
                Counted::of(stray.paths.len(), "file")
            )),
            Err((path, error)) => cleaned.refused.push(format!("{}: {error}", path.display())),
        }
    }
    cleaned
}

fn remove(facts: &CellFacts) -> Result<Option<String>, String> {
    let message = |error: &dyn std::fmt::Display| format!("cell {}: {error}", facts.name);
    let Some(cell) = Cell::find(&facts.name).map_err(|error| message(&error))? else {
        return Ok(None);
    };
    let report = remove_cell(&cell).map_err(|error| message(&error))?;
    if report.shared_memory + report.announcements == 0 {
        return Ok(None);
    }
    Ok(Some(format!(
        "cell {}: {} in shared memory, {}, its folder",
        facts.name,
        Counted::of(report.shared_memory, "file"),
        Counted::of(report.announcements, "announcement")
    )))
}

fn remove_all(paths: &[PathBuf]) -> Result<(), (PathBuf, io::Error)> {
    for path in paths {
        let is_folder = fs::symlink_metadata(path).is_ok_and(|found| found.is_dir());
        let removed = if is_folder {
            fs::remove_dir_all(path)
        } else {
            fs::remove_file(path)
        };
        match removed {
            Err(error) if error.kind() != io::ErrorKind::NotFound => {
                return Err((path.clone(), error));
            }
            _ => {}
        }
    }
    Ok(())
}
