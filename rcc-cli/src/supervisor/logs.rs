//! Folders of the processes' logs: one for each run of the cell, in its state folder. Used by the supervisor's thread.

use std::path::{Path, PathBuf};

use rcc_engine::incident::EXTENSION;
use rcc_ipc::StateFolder;
use rcc_protocol::events::wall_time;

use super::private_folder;
use crate::failure::Failure;
use crate::output::print_note;

/// Maximum number of runs whose logs are kept.
const RUNS_MAX: usize = 16;

/// Creates the folder of a new run, named after the time, and returns it. Removes the oldest files of the state folder beyond
/// `keep` bytes.
///
/// # Errors
/// Fails if the folder cannot be created.
pub fn begin_run(state: &StateFolder, keep: u64) -> Result<PathBuf, Failure> {
    let folder = state.logs_dir().join(wall_time().replace(':', "-"));
    private_folder(&folder)
        .map_err(|error| Failure::unreadable(&folder.display().to_string(), &error))?;
    let is_incident = |path: &Path| path.extension().is_some_and(|is| is == EXTENSION);
    let removed = remove_runs(&state.logs_dir())
        .and_then(|()| state.remove_oldest(keep, is_incident).map(drop));
    if let Err(error) = removed {
        let path = state.path().display();
        print_note(&format!(
            "{path}: the oldest files cannot be removed: {error}"
        ));
    }
    Ok(folder)
}

/// Removes the logs of the oldest runs.
fn remove_runs(logs: &Path) -> std::io::Result<()> {
    let mut runs = Vec::new();
    for entry in std::fs::read_dir(logs)? {
        let path = entry?.path();
        // Files that `up` did not create stay.
        if path.is_dir() {
            runs.push(path);
        }
    }
    runs.sort();
    let many = runs.len().saturating_sub(RUNS_MAX);
    runs.iter().take(many).try_for_each(std::fs::remove_dir_all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_logs_of_a_bounded_number_of_runs_are_kept() {
        let temporary = rcc_testing::folder();
        let logs = temporary.path();
        for run in 0..RUNS_MAX + 3 {
            std::fs::create_dir(logs.join(format!("{run:02}"))).unwrap();
        }
        std::fs::write(logs.join("00-notes"), "").unwrap();
        remove_runs(logs).unwrap();
        let mut left: Vec<_> = std::fs::read_dir(logs).unwrap().flatten().collect();
        left.sort_by_key(std::fs::DirEntry::file_name);
        assert_eq!(left.len(), RUNS_MAX + 1);
        assert_eq!(left[0].file_name(), "00-notes");
        assert_eq!(left[1].file_name(), "03");
    }
}
