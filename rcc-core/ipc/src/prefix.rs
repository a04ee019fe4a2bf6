//! The prefix of a cell's shared memory. By default it is derived from the user and the runtime folder, so that
//! leftovers are found even if the folder is gone. `/dev/shm` is world-writable: if another user has created files
//! under the default prefix, the cell takes a random one and stores it in its runtime folder. Runs on any thread that
//! is not real-time.

use std::fs::{self, File};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::os::unix::ffi::OsStrExt;
use std::path::Path;
use std::time::Duration;

use rcc_core::fnv;

use crate::cell_error::CellError;
use crate::lock::{self, LockError};
use crate::shm_space::below_prefix;

/// Length of a prefix: `rcc_` + 10 hexadecimal digits + `_`.
const LENGTH: usize = 15;
/// How long to wait for a process that is writing the file; that takes microseconds.
const WRITING: Duration = Duration::from_secs(2);

/// Returns the prefix of the cell in `folder`.
///
/// # Errors
/// Returns an error if the file that stores the prefix cannot be read or written.
pub(crate) fn of(
    uid: u32,
    folder: &Path,
    file: &Path,
    cell_lock: &Path,
) -> Result<String, CellError> {
    let prefix = current(uid, folder, file)?;
    let is_blocked = |prefix: &str| {
        // An unreadable folder is reported by the code that needs it.
        below_prefix(prefix).is_ok_and(|(_, foreign)| !foreign.is_empty())
    };
    if !is_blocked(&prefix) {
        return Ok(prefix);
    }
    // Processes in the cell use the prefix, so it stays until they are gone. Take the lock against new ones, and check
    // again.
    let Ok(_alone) = lock::exclusive(cell_lock) else {
        return Ok(prefix);
    };
    let prefix = current(uid, folder, file)?;
    if !is_blocked(&prefix) {
        return Ok(prefix);
    }
    remove_ours(&prefix);
    let other = random_prefix().map_err(failed(Path::new("/dev/urandom")))?;
    write(file, &other)?;
    Ok(other)
}

/// Returns the prefix that is in force, without checking for foreign files.
///
/// # Errors
/// Returns an error if the file that stores the prefix cannot be read.
pub(crate) fn current(uid: u32, folder: &Path, file: &Path) -> Result<String, CellError> {
    match rcc_os::file::read_text(file, 64) {
        Ok(text) if is_prefix(text.trim_end()) => Ok(text.trim_end().to_owned()),
        // Its writer died: treat the file as missing.
        Ok(_) => Ok(default_prefix(uid, folder)),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(default_prefix(uid, folder)),
        Err(error) => Err(failed(file)(error)),
    }
}

/// Returns a hash of user id and folder.
fn default_prefix(uid: u32, folder: &Path) -> String {
    let hash = fnv::add(fnv::EMPTY, &uid.to_le_bytes());
    let hash = fnv::add(hash, folder.as_os_str().as_bytes());
    of_number(hash ^ (hash >> 40))
}

fn random_prefix() -> io::Result<String> {
    let mut bytes = [0; 8];
    File::open("/dev/urandom")?.read_exact(&mut bytes)?;
    Ok(of_number(u64::from_le_bytes(bytes)))
}

fn of_number(number: u64) -> String {
    format!("rcc_{:010x}_", number & 0xff_ffff_ffff)
}

fn is_prefix(text: &str) -> bool {
    let digits = text
        .strip_prefix("rcc_")
        .and_then(|rest| rest.strip_suffix('_'));
    text.len() == LENGTH
        && digits.is_some_and(|digits| digits.bytes().all(|byte| byte.is_ascii_hexdigit()))
}

/// Removes our files under a prefix that is given up: no process is in the cell, and nobody will look for them again.
fn remove_ours(prefix: &str) {
    for path in below_prefix(prefix)
        .map(|(ours, _)| ours)
        .unwrap_or_default()
    {
        let is_folder = fs::symlink_metadata(&path).is_ok_and(|found| found.is_dir());
        // `rcc-cli doctor` finds what remains.
        let _ = match is_folder {
            true => fs::remove_dir_all(&path),
            false => fs::remove_file(&path),
        };
    }
}

/// Writes the prefix. Readers take no lock; they ignore a half-written file.
fn write(path: &Path, prefix: &str) -> Result<(), CellError> {
    let mut file = lock::exclusive_within(path, WRITING).map_err(|error| match error {
        LockError::File { path, source } => CellError::Folder { path, source },
        LockError::Held { path } => CellError::Folder {
            path,
            source: io::ErrorKind::WouldBlock.into(),
        },
    })?;
    file.set_len(0)
        .and_then(|()| file.seek(SeekFrom::Start(0)))
        .and_then(|_| file.write_all(format!("{prefix}\n").as_bytes()))
        .map_err(failed(path))
}

fn failed(path: &Path) -> impl Fn(io::Error) -> CellError {
    move |source| CellError::Folder {
        path: path.to_owned(),
        source,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shm_space::SHM;

    #[test]
    fn the_default_prefix_depends_on_user_and_folder() {
        let demo = default_prefix(1000, Path::new("/run/rcc/demo"));
        assert_eq!(demo, default_prefix(1000, Path::new("/run/rcc/demo")));
        assert_ne!(demo, default_prefix(1001, Path::new("/run/rcc/demo")));
        assert_ne!(demo, default_prefix(1000, Path::new("/run/rcc/demo2")));
        assert!(is_prefix(&demo), "{demo}");
        assert!(random_prefix().is_ok_and(|one| is_prefix(&one) && one != demo));
    }

    #[test]
    fn an_invalid_prefix_file_is_ignored() -> Result<(), CellError> {
        let temporary = rcc_testing::folder();
        let (file, folder) = (temporary.path().join("prefix"), Path::new("/run/rcc/demo"));
        for text in [
            "",
            "rcc_",
            "rcc_012345678x_",
            "rcc_0123456789",
            "../../etc/passwd",
            "\u{e9}\u{e9}\u{e9}\u{e9}\u{e9}\u{e9}\u{e9}_",
        ] {
            fs::write(&file, text).map_err(failed(&file))?;
            assert_eq!(
                current(7, folder, &file)?,
                default_prefix(7, folder),
                "{text}"
            );
        }
        write(&file, "rcc_0123456789_")?;
        assert_eq!(current(7, folder, &file)?, "rcc_0123456789_");
        fs::remove_file(&file).map_err(failed(&file))?;
        assert_eq!(current(7, folder, &file)?, default_prefix(7, folder));
        Ok(())
    }

    /// Only root can create files of another user.
    #[test]
    fn files_of_another_user_under_the_prefix_do_not_block_the_cell()
    -> Result<(), Box<dyn std::error::Error>> {
        if !nix::unistd::getuid().is_root() {
            println!("skipped: files of another user need root");
            return Ok(());
        }
        let temporary = rcc_testing::folder();
        let folder = temporary.path();
        let (file, cell_lock) = (folder.join("prefix"), folder.join("cell.lock"));
        let usual = default_prefix(0, folder);
        let (foreign, ours) = (
            Path::new(SHM).join(format!("{usual}node.0_10_0.global_mgmt")),
            Path::new(SHM).join(format!("{usual}left.dynamic")),
        );
        fs::write(&foreign, "")?;
        fs::write(&ours, "")?;
        std::os::unix::fs::chown(&foreign, Some(65534), None)?;
        let look = || of(0, folder, &file, &cell_lock);
        let living = lock::shared_within(&cell_lock, Duration::ZERO)?;
        let while_it_lives = look()?;
        let kept = ours.exists();
        drop(living);
        let (other, again) = (look()?, look()?);
        let (foreign_stays, ours_stays) = (foreign.exists(), ours.exists());
        fs::remove_file(foreign)?;
        assert_eq!((while_it_lives, kept), (usual.clone(), true));
        assert_ne!(other, usual);
        assert_eq!(other, again, "the prefix is stored");
        assert_eq!((foreign_stays, ours_stays), (true, false));
        Ok(())
    }
}
