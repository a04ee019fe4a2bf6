//! A folder for the control port of a simulator in a test.
//! Runs in the test harness.

use std::fs::{self, DirBuilder};
use std::os::unix::fs::DirBuilderExt;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU32, Ordering};

/// A new folder, mode 0700; removed when dropped.
pub struct Folder(pub PathBuf);

impl Folder {
    pub fn new() -> Folder {
        static NUMBER: AtomicU32 = AtomicU32::new(0);
        // Relaxed: only distinct numbers are needed.
        let number = NUMBER.fetch_add(1, Ordering::Relaxed);
        let name = format!("rcc-sim-test-{}-{number}", std::process::id());
        let path = std::env::temp_dir().join(name);
        DirBuilder::new().mode(0o700).create(&path).unwrap();
        Folder(path.canonicalize().unwrap())
    }

    /// Returns the path of the control socket.
    pub fn socket(&self) -> PathBuf {
        self.0.join("sim.sock")
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}
