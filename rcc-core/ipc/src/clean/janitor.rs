//! Work of the janitor's process: frees what nobody uses before it creates anything itself, lets iceoryx2 clean up, and
//! removes what that leaves. It may hang in iceoryx2 forever, so it is a separate process that its parent kills.

use std::fs::File;
use std::io::{self, Write};
use std::os::fd::AsRawFd;
use std::path::PathBuf;
use std::thread;
use std::time::Duration;

use iceoryx2::prelude::{Config, FilePath, SemanticString};
use nix::sys::memfd::{MFdFlags, memfd_create};

use super::half_created::{EmptyFileWatch, remove_half_created};
use super::{CleanError, CleanReport, JANITOR_TIMEOUT};
use crate::cell::Cell;
use crate::lock;
use crate::reap;
use crate::session::{self, SessionError};
use crate::shm_space;

/// Interval at which the janitor looks for half-created files while it cleans.
const SWEEP_STEP: Duration = Duration::from_millis(50);
/// Shared memory needed to join a cell, with a margin: a few files of one page each.
const JOIN_ROOM: u64 = 256 << 10;

/// Cleans up as the janitor's process. It may hang forever in iceoryx2, so no other process calls it.
///
/// # Errors
/// Returns an error if the cell cannot be joined, if files cannot be removed, or if `/dev/shm` is full of files that
/// are not ours to remove.
pub fn clean_as_janitor(cell: &Cell) -> Result<CleanReport, CleanError> {
    let half_created = remove_half_created(cell)?;
    let freed = make_room(cell)?;
    let beside = cell.clone();
    // Removes files that become half-created from now on; the thread ends with the process.
    let sweeping = thread::Builder::new().name("sweep".into()).spawn(move || {
        let mut watch = EmptyFileWatch::default();
        loop {
            thread::sleep(SWEEP_STEP);
            // A file that cannot be removed now is tried again.
            let _ = watch.sweep(&beside);
        }
    });
    sweeping.map_err(CleanError::Thread)?;
    cell.make_iox_root().map_err(SessionError::from)?;
    use_as_global_configuration(cell)?;
    let (_membership, node) = session::enter(cell)?;
    // One janitor at a time: a second one would fail on files that the first removes.
    let _alone =
        lock::exclusive_within(&cell.janitor_lock_file(), JANITOR_TIMEOUT).map_err(|source| {
            SessionError::Lock {
                cell: cell.name().to_owned(),
                source,
            }
        })?;
    // iceoryx2 first: it also removes the dead from what they shared with the living. Then remove what it left.
    let dead = reap::DeadProcesses::of(cell).map_err(failed)?;
    let dead_nodes = node.try_cleanup_dead_nodes().cleanups;
    let reaped = freed + reap::reap(cell, &dead).map_err(failed)?;
    Ok(CleanReport {
        half_created,
        dead_nodes,
        reaped,
    })
}

fn failed((path, source): (PathBuf, io::Error)) -> CleanError {
    CleanError::File { path, source }
}

/// On a full `/dev/shm` no node can be created, so nothing would ever be cleaned: first remove files of dead processes,
/// by name, that no process has mapped. Their nodes stay, so that iceoryx2 can unregister them. Returns the number of
/// removed files.
fn make_room(cell: &Cell) -> Result<usize, CleanError> {
    if shm_space::free().is_none_or(|free| free >= JOIN_ROOM) {
        return Ok(0);
    }
    let dead = reap::DeadProcesses::of(cell).map_err(failed)?;
    let freed = reap::free(cell, &dead).map_err(failed)?;
    match shm_space::free() {
        Some(have) if have < JOIN_ROOM => Err(CleanError::Full {
            freed,
            have,
            need: JOIN_ROOM,
        }),
        _ => Ok(freed),
    }
}

/// For dead nodes without details iceoryx2 falls back to its process-wide configuration; without this it would look for
/// them under its defaults. It only accepts a file; this one is a memfd of this process.
fn use_as_global_configuration(cell: &Cell) -> Result<(), CleanError> {
    let quoted = |text: &str| serde_json::Value::from(text).to_string();
    let text = format!(
        "[global]\nroot-path = {}\nprefix = {}\n[global.node]\ncleanup-dead-nodes-on-creation = false\n\
         cleanup-dead-nodes-on-destruction = false\n[global.service]\ncleanup-dead-nodes-on-open = false\n",
        quoted(&cell.iox_root().display().to_string()),
        quoted(cell.prefix()),
    );
    let failed = |source| failed((PathBuf::from("memfd:rcc-janitor"), source));
    let memory = memfd_create(c"rcc-janitor", MFdFlags::MFD_CLOEXEC);
    let mut file = File::from(memory.map_err(|error| failed(error.into()))?);
    file.write_all(text.as_bytes()).map_err(failed)?;
    let path = format!("/proc/self/fd/{}", file.as_raw_fd());
    let taken = FilePath::new(path.as_bytes())
        .ok()
        .and_then(|file| Config::setup_global_config_from_file(&file).ok());
    match taken {
        Some(_) => Ok(()),
        None => Err(failed(io::Error::other(
            "iceoryx2 rejects this configuration",
        ))),
    }
}
