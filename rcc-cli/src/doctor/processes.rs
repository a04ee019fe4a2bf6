//! The processes of this machine, as far as `/proc` is readable. Run by the main thread.

use std::fs;
use std::path::{Path, PathBuf};

/// Returns the folders of all processes in `/proc`, without `self` and `thread-self`.
pub fn all() -> impl Iterator<Item = PathBuf> {
    let entries = fs::read_dir("/proc").into_iter().flatten().flatten();
    entries
        .filter(|entry| {
            let name = entry.file_name();
            name.as_encoded_bytes().iter().all(u8::is_ascii_digit)
        })
        .map(|entry| entry.path())
}

/// Returns the open files of a process of [`all`]; empty for other users' processes.
pub fn open_files(process: &Path) -> impl Iterator<Item = PathBuf> {
    let entries = fs::read_dir(process.join("fd"));
    let entries = entries.into_iter().flatten().flatten();
    entries.filter_map(|file| fs::read_link(file.path()).ok())
}
