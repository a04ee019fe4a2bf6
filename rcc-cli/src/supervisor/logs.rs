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
/// `keep` bytes. The new folder stays whatever the wall clock says: folders with a later date were made before it was
/// set back.
///
/// # Errors
/// Fails if the folder cannot be created.
pub fn begin_run(state: &StateFolder, keep: u64) -> Result<PathBuf, Failure> {
    let folder = state.logs_dir().join(wall_time().replace(':', "-"));
    private_folder(&folder)
        .map_err(|error| Failure::unreadable(&folder.display().to_string(), &error))?;
    let is_incident = |path: &Path| path.extension().is_some_and(|is| is == EXTENSION);
    let removed = remove_runs(&state.logs_dir(), &folder)
        .and_then(|()| state.remove_oldest(keep, &[&folder], is_incident).map(drop));
    if let Err(error) = removed {
        let path = state.path().display();
        print_note(&format!(
            "{path}: the oldest files cannot be removed: {error}"
        ));
    }
    Ok(folder)
}

/// Removes the logs of the oldest runs, but never `newest`, the folder of the run that begins. Folders with a later date
/// than it has count as the oldest.
fn remove_runs(logs: &Path, newest: &Path) -> std::io::Result<()> {
    let mut runs = Vec::new();
    for entry in std::fs::read_dir(logs)? {
        let path = entry?.path();
        // Files that `up` did not create stay.
        if path != newest && path.is_dir() {
            runs.push((path.as_path() < newest, path));
        }
    }
    runs.sort();
    let many = runs.len().saturating_sub(RUNS_MAX - 1);
    runs.iter()
        .take(many)
        .try_for_each(|(_, path)| std::fs::remove_dir_all(path))
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
        let newest = logs.join(format!("{:02}", RUNS_MAX + 2));
        remove_runs(logs, &newest).unwrap();
        let mut left: Vec<_> = std::fs::read_dir(logs).unwrap().flatten().collect();
        left.sort_by_key(std::fs::DirEntry::file_name);
        assert_eq!(left.len(), RUNS_MAX + 1);
        assert_eq!(left[0].file_name(), "00-notes");
        assert_eq!(left[1].file_name(), "03");
    }

    #[test]
    fn the_logs_of_a_new_run_stay_after_the_clock_was_set_back() {
        let temporary = rcc_testing::folder();
        let cell = rcc_ipc::Cell::at("demo", temporary.path()).unwrap();
        let logs = cell.state().logs_dir();
        for run in 0..RUNS_MAX {
            let path = logs.join(format!("2099-01-01T00-00-{run:02}.000Z"));
            std::fs::create_dir_all(&path).unwrap();
            std::fs::write(path.join("executor.log"), "x").unwrap();
        }
        let begin = |keep| {
            let run = begin_run(&cell.state(), keep).unwrap();
            std::fs::write(run.join("executor.log"), "x").unwrap();
            run
        };
        let first = begin(u64::MAX);
        assert_eq!(std::fs::read_dir(&logs).unwrap().count(), RUNS_MAX);
        let second = begin(u64::MAX);
        assert!(first.is_dir() && second.is_dir() && first != second);
        // Nothing fits into `keep`.
        let third = begin(0);
        let left = std::fs::read_dir(&logs).unwrap().flatten();
        assert_eq!(left.map(|run| run.path()).collect::<Vec<_>>(), [third]);
    }
}
