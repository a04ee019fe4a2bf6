//! A folder: existence, owner, permissions. Run by the main thread.

use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// A folder that may not exist.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FolderFacts {
    /// Path.
    pub path: PathBuf,
    /// Owner's user id, if it exists.
    pub owner: Option<u32>,
    /// Permission bits; 0 if it does not exist.
    pub mode: u32,
    /// True if this user can create files in it, or create it.
    pub usable: bool,
}

/// Inspects a folder; creates nothing.
#[must_use]
pub fn read(path: &Path) -> FolderFacts {
    let found = fs::metadata(path).ok().filter(fs::Metadata::is_dir);
    let nearest = path.ancestors().find(|above| above.exists());
    let access = nix::unistd::AccessFlags::W_OK | nix::unistd::AccessFlags::X_OK;
    let allowed = nearest
        .is_some_and(|nearest| nearest.is_dir() && nix::unistd::access(nearest, access).is_ok());
    FolderFacts {
        path: path.to_owned(),
        owner: found.as_ref().map(MetadataExt::uid),
        mode: found.as_ref().map_or(0, |found| found.mode() & 0o7777),
        usable: allowed,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_folder_is_judged_by_its_nearest_ancestor() {
        let path = std::env::temp_dir().join(format!("rcc-none-{}/a/b", std::process::id()));
        let folder = read(&path);
        assert!(folder.usable && folder.owner.is_none());
        let below_a_file = read(Path::new("/proc/version/x"));
        assert!(!below_a_file.usable);
    }
}
