//! Who has a cell: it is taken and given back in one act each, of which only one of many at once succeeds. What another
//! one has is never touched. Run by supervisors, by whoever removes dead cells, and never by a real-time thread.

use std::fs::{self, File};
use std::io;
use std::thread;
use std::time::{Duration, Instant};

use nix::fcntl::Flock;

use crate::announce::{AnnounceError, Announced, Announcement};
use crate::cell::Cell;
use crate::clean::{WipeError, WipeReport, remove_rest, wipe_locked};
use crate::lock::{self, LockError};
use crate::session::Role;

/// A killed process counts as dead before the system has closed its files, and a janitor is in the cell for a moment; so
/// long the lock of the cell is waited for.
const PATIENCE: Duration = Duration::from_secs(2);
/// How often it is tried.
const RETRY: Duration = Duration::from_millis(2);
/// What the supervisor of a cell announces itself as: there is one of this role and label.
const SUPERVISOR: (Role, &str) = (Role::Cli, "up");

impl Announcement {
    /// The announcement of this process as the supervisor of a cell.
    ///
    /// # Errors
    /// The system does not tell when this process began.
    pub fn supervisor() -> io::Result<Announcement> {
        let life = crate::ProcessInstance::current()?;
        Ok(Announcement {
            role: SUPERVISOR.0,
            label: SUPERVISOR.1.to_owned(),
            incarnation: life.incarnation(),
            pid: life.pid,
            start_time_ticks: life.start_time_ticks,
            services: Default::default(),
            note: "supervisor".to_owned(),
            configuration: None,
            build: Some(crate::Build::own()),
        })
    }

    /// True if whoever announced this supervises the cell.
    #[must_use]
    pub fn is_supervisor(&self) -> bool {
        (self.role, self.label.as_str()) == SUPERVISOR
    }
}

/// Takes a cell for the process of `announcement`: removes what a dead cell left and announces the process, both under
/// the lock of the cell. Of many that do it at once one succeeds; the others, and all that come later, are refused
/// before they have touched anything.
///
/// # Errors
/// The cell is alive (then somebody has it), or files cannot be removed or written.
pub fn acquire(cell: &Cell, announcement: &Announcement) -> Result<Announced, WipeError> {
    let alone = lock_exclusively(cell, None)?;
    wipe_locked(cell, &alone)?;
    cell.make_folders()?;
    Ok(cell.announce(announcement)?)
}

/// Gives a cell back that was taken: removes everything of it, with the folder, unless that holds foreign files. Until
/// then the cell is announced as taken; from then on it can be taken again.
///
/// # Errors
/// Another process is still in the cell, or a file cannot be removed; then what is left is for whoever takes it next.
pub fn release(cell: &Cell, announced: &Announced) -> Result<WipeReport, WipeError> {
    let alone = lock_exclusively(cell, Some(announced.announcement()))?;
    let report = wipe_locked(cell, &alone)?;
    remove_rest(cell, &alone)?;
    Ok(report)
}

/// Proof that no other process is in the cell, and that none comes in.
#[derive(Debug)]
pub(crate) struct ExclusiveAccess {
    /// Everybody who is announced, all dead but perhaps the caller.
    pub(crate) announced: Vec<Announcement>,
    _lock: Flock<File>,
}

/// Waits for the lock of the cell, as long as nobody who is announced lives but `own`.
pub(crate) fn lock_exclusively(
    cell: &Cell,
    own: Option<&Announcement>,
) -> Result<ExclusiveAccess, WipeError> {
    let limit = Instant::now() + PATIENCE;
    loop {
        match attempt(cell, own) {
            // Another one just removed the folder, or somebody is about to leave.
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
    // Whoever was announced in between is in, or was, and nobody is from now on.
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

/// Everybody who is announced, if nobody of them but `own` lives; the supervisor is named first, as the others are its
/// children.
fn refuse_living(cell: &Cell, own: Option<&Announcement>) -> Result<Vec<Announcement>, WipeError> {
    let announced = cell.announced_all()?;
    let other = |one: &&Announcement| own.is_none_or(|own| own.incarnation != one.incarnation);
    // Whoever may live counts as living.
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

/// True if `path` names the file that is locked, and not one that somebody made in its place.
pub(crate) fn is_locked_file(path: &std::path::Path, locked: &File) -> bool {
    use std::os::unix::fs::MetadataExt;
    let of = |found: io::Result<fs::Metadata>| found.ok().map(|found| (found.dev(), found.ino()));
    let named = of(fs::metadata(path));
    named.is_some() && named == of(locked.metadata())
}
