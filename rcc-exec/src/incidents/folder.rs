//! The folder of the incident files: who wrote a file, and which ones make room. Run by the thread `incidents`.

use std::fs;
use std::io;
use std::path::Path;
use std::time::SystemTime;

use rcc_engine::incident::EXTENSION;
use rcc_os::process_instance::ProcessInstance;
use tracing::warn;

/// Extension of a file that is still being written.
pub(super) const PARTIAL_EXTENSION: &str = "half";

/// Returns the life of the executor that wrote the incident file `path`, and whether the file is incomplete. Returns
/// `None` for files that no executor wrote.
pub(super) fn writer_of(path: &Path) -> Option<(ProcessInstance, bool)> {
    let partial = match path.extension()?.to_str()? {
        EXTENSION => false,
        PARTIAL_EXTENSION => true,
        _ => return None,
    };
    // `IncidentWriter::write` names files EXECUTOR-CYCLE-REASON.
    let mut parts = path.file_stem()?.to_str()?.splitn(3, '-');
    let (executor, cycle, reason) = (parts.next()?, parts.next()?, parts.next()?);
    let digits = executor.len() == 16 && cycle.parse::<u64>().is_ok();
    let known = digits && ["fault", "late", "request", "trigger"].contains(&reason);
    let executor = u64::from_str_radix(executor, 16).ok().filter(|_| known)?;
    Some((ProcessInstance::from_incarnation(executor), partial))
}

/// Removes incomplete files whose writer is dead: an executor that was killed while writing.
pub(super) fn remove_partial_files(folder: &Path) {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    for path in entries.map(|entry| entry.path()) {
        let dead =
            writer_of(&path).is_some_and(|(life, partial)| partial && life.liveness().is_dead());
        if dead && let Err(error) = fs::remove_file(&path) {
            warn!(
                "{}: cannot remove the incomplete file: {error}; it counts towards the maximum number of incidents",
                path.display()
            );
        }
    }
}

/// Removes the oldest incident files, complete or not, until there is room for one more: at
/// most `files_max - 1` stay. Files of this executor are newer than all others, in the order of their cycles: the wall clock may have been set. Of
/// the others, those dated in the future count as the oldest.
pub(super) fn make_room(folder: &Path, files_max: usize, incarnation: u64) -> io::Result<()> {
    let (own, now) = (
        ProcessInstance::from_incarnation(incarnation),
        SystemTime::now(),
    );
    let mut files = Vec::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        let Some((writer, _)) = writer_of(&path) else {
            continue;
        };
        let date = fs::metadata(&path).and_then(|file| file.modified()).ok();
        let cycle = cycle_of(&path).filter(|_| writer == own);
        files.push((cycle, date.is_some_and(|date| date <= now), date, path));
    }
    files.sort();
    let many = files.len().saturating_sub(files_max.saturating_sub(1));
    for (.., path) in files.into_iter().take(many) {
        fs::remove_file(&path)?;
    }
    Ok(())
}

/// Returns the cycle in the name of a file for which [`writer_of`] is known.
fn cycle_of(path: &Path) -> Option<u64> {
    path.file_stem()?.to_str()?.split('-').nth(1)?.parse().ok()
}

#[cfg(test)]
mod tests {
    use std::fs::File;
    use std::time::Duration;

    use rcc_protocol::events::hex_digits;

    use super::*;

    #[test]
    fn incidents_of_the_future_make_room_for_those_of_this_executor() {
        let folder = tempfile::tempdir().unwrap();
        let future = SystemTime::now() + Duration::from_secs(9000);
        let write = |executor: u64, cycle: u64, date: SystemTime| {
            let name = format!("{}-{cycle}-fault", hex_digits(executor));
            let path = folder.path().join(name).with_extension(EXTENSION);
            File::create(&path).unwrap().set_modified(date).unwrap();
            path
        };
        let past = SystemTime::now() - Duration::from_secs(60);
        let earlier = write(1, 500, past);
        let others: Vec<_> = (1..=3).map(|cycle| write(1, cycle, future)).collect();
        // Cycle 9 was written before the clock was set back, cycle 10 after it.
        let (first, second) = (write(7, 9, future), write(7, 10, past));
        make_room(folder.path(), 5, 7).unwrap();
        assert_eq!(others.iter().filter(|path| path.exists()).count(), 1);
        make_room(folder.path(), 4, 7).unwrap();
        assert!(!others.iter().any(|path| path.exists()));
        assert!(earlier.exists() && first.exists() && second.exists());
        make_room(folder.path(), 2, 7).unwrap();
        assert!(!earlier.exists() && !first.exists() && second.exists());
    }
}
