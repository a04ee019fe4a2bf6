//! The processes of this machine, as far as `/proc` lets us look.
//! Run by the main thread.

use std::fs;
use std::path::{Path, PathBuf};

/// Their folders in `/proc`; not `self` and `thread-self`.
pub fn all() -> impl Iterator<Item = PathBuf> {
    let entries = fs::read_dir("/proc").into_iter().flatten().flatten();
    entries
        .filter(|entry| {
            let name = entry.file_name();
            name.as_encoded_bytes().iter().all(u8::is_ascii_digit)
        })
        .map(|entry| entry.path())
}

/// What a process of [`all`] has open; nothing of another user's.
pub fn open_files(process: &Path) -> impl Iterator<Item = PathBuf> {
    let entries = fs::read_dir(process.join("fd"));
    let entries = entries.into_iter().flatten().flatten();
    entries.filter_map(|file| fs::read_link(file.path()).ok())
}
