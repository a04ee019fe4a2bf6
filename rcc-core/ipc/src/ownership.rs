//! Ownership of a cell: acquiring and releasing it are atomic, so that of several concurrent attempts only one
//! succeeds, and a cell owned by another process is never touched. Run by supervisors and by programs that remove dead
//! cells, never by a real-time thread.

use rcc_protocol::Announcement;

use crate::announce::Announced;
use crate::cell::Cell;
use crate::wipe::{WipeError, WipeReport, lock_exclusively, remove_rest, wipe_locked};

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
