//! Ownership of a cell: acquiring and releasing it are atomic, so that of several concurrent attempts only one
//! succeeds, and a cell owned by another process is never touched. Run by supervisors and by programs that remove dead
//! cells, never by a real-time thread.

use std::fs::{self, File};
use std::io;
use std::thread;
use std::time::{Duration, Instant};

use nix::fcntl::Flock;
use rcc_protocol::Announcement;

use crate::announce::{AnnounceError, Announced};
use crate::cell::Cell;
use crate::clean::{WipeError, WipeReport, remove_rest, wipe_locked};
use crate::lock::{self, LockError};

/// Time limit for the lock of the cell: a killed process counts as dead before the system has closed its files, and a
/// janitor is in the cell for a moment.
const PATIENCE: Duration = Duration::from_secs(2);
/// Interval between attempts.
const RETRY: Duration = Duration::from_millis(2);

/// Acquires a cell for the process of `announcement`: removes what a dead cell left behind and announces the process,
/// both under the lock of the cell. Of several concurrent attempts one succeeds; all others are refused before they
/// have touched anything.
///
/// # Errors
/// Returns an error if the cell is alive (then another process owns it), or if files cannot be removed or written.
pub fn acquire(cell: &Cell, announcement: &Announcement) -> Result<Announced, WipeError> {
    let access = lock_exclusively(cell, None)?;
    wipe_locked(cell, &access)?;
    cell.make_folders()?;
    Ok(cell.announce(announcement)?)
}

/// Releases an acquired cell: removes all its files and its folder, unless the folder holds foreign files. Until then
/// the cell is announced as owned; afterwards it can be acquired again.
///
/// # Errors
/// Returns an error if another process is still in the cell, or if a file cannot be removed; the next owner of the cell
/// removes the rest.
pub fn release(cell: &Cell, announced: &Announced) -> Result<WipeReport, WipeError> {
    let access = lock_exclusively(cell, Some(announced.announcement()))?;
    let report = wipe_locked(cell, &access)?;
    remove_rest(cell, &access)?;
    Ok(report)
}

/// Proof that no other process is in the cell and that none can join.
#[derive(Debug)]
pub(crate) struct ExclusiveAccess {
    /// All announced processes; all are dead except possibly the caller.
    pub(crate) announced: Vec<Announcement>,
    _lock: Flock<File>,
}

/// Waits for the exclusive lock of the cell, unless an announced process other than `own` is alive.
pub(crate) fn lock_exclusively(
    cell: &Cell,
    own: Option<&Announcement>,
) -> Result<ExclusiveAccess, WipeError> {
    let limit = Instant::now() + PATIENCE;
    loop {
        match attempt(cell, own) {
            // Another process just removed the folder, or is about to leave.
            Err(error) if is_passing(&error) && Instant::now() < limit => thread::sleep(RETRY),
            result => return result,
        }
    }
}

fn attempt(cell: &Cell, own: Option<&Announcement>) -> Result<ExclusiveAccess, WipeError> {
    cell.make_folders()?;
    refuse_living(cell, own)?;
    let lock = lock::exclusive(&cell.lock_file()).map_err(|error| match error {
        LockError::Held { path } => WipeError::InUse {
            cell: cell.name().to_owned(),
            lock: path,
        },
        other => WipeError::Lock(other),
    })?;
    // A process that announced itself in between is found here; none can from now on.
    let announced = refuse_living(cell, own)?;
    Ok(ExclusiveAccess {
        announced,
        _lock: lock,
    })
}

fn is_passing(error: &WipeError) -> bool {
    let gone = |error: &io::Error| error.kind() == io::ErrorKind::NotFound;
    match error {
        WipeError::InUse { .. } => true,
        WipeError::Cell(error) => error.is_passing(),
        WipeError::Lock(LockError::File { source, .. })
        | WipeError::Announce(AnnounceError::File { source, .. }) => gone(source),
        _ => false,
    }
}

/// Returns all announcements, or an error if a process other than `own` is alive. The error names the supervisor if
/// possible, because the others are its children.
fn refuse_living(cell: &Cell, own: Option<&Announcement>) -> Result<Vec<Announcement>, WipeError> {
    let announced = cell.announced_all()?;
    let other = |one: &&Announcement| own.is_none_or(|own| own.incarnation != one.incarnation);
    // A process that may be alive counts as alive.
    let living = announced
        .iter()
        .filter(other)
        .filter(|one| !one.liveness().is_dead());
    match living.max_by_key(|one| one.is_supervisor()) {
        None => Ok(announced),
        Some(living) => Err(WipeError::Living {
            cell: cell.name().to_owned(),
            role: living.role,
            label: living.label.clone(),
            pid: living.pid,
        }),
    }
}

/// Returns true if `path` is the locked file, and not a new file in its place.
pub(crate) fn is_locked_file(path: &std::path::Path, locked: &File) -> bool {
    use std::os::unix::fs::MetadataExt;
    let of = |found: io::Result<fs::Metadata>| found.ok().map(|found| (found.dev(), found.ino()));
    let named = of(fs::metadata(path));
    named.is_some() && named == of(locked.metadata())
}
