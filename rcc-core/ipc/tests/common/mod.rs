//! Common parts of the cross-process tests: a cell that leaves nothing behind, and child processes. Run by the tests'
//! threads; a child process is this test program again, started with a role.
#![allow(dead_code)] // Each test program uses a part of it.

use std::fmt::Debug;
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use rcc_ipc::{Cell, clean};
use rcc_protocol::{Announcement, Role};
use rcc_testing::TempDir;

/// Far longer than any operation takes; only a broken test reaches it.
pub const LIMIT: Duration = Duration::from_secs(60);

const PART: &str = "RCC_IPC_TEST_PART";
const FOLDER: &str = "RCC_IPC_TEST_FOLDER";
const LABEL: &str = "RCC_IPC_TEST_LABEL";

/// The cell of one test; dropping it, also on a panic, leaves no file.
pub struct TestCell {
    cell: Cell,
    _folder: TempDir,
}

impl TestCell {
    pub fn new() -> TestCell {
        let folder = rcc_testing::folder();
        TestCell {
            cell: Cell::at("test", folder.path()).unwrap(),
            _folder: folder,
        }
    }

    /// Its current shared-memory files.
    pub fn files(&self) -> Vec<PathBuf> {
        let root = self.cell.iox_root();
        let mut files = self.cell.leftovers().unwrap();
        files.retain(|path| !path.starts_with(&root));
        files
    }
}

impl Deref for TestCell {
    type Target = Cell;
    fn deref(&self) -> &Cell {
        &self.cell
    }
}

impl Drop for TestCell {
    fn drop(&mut self) {
        // Without the code under test, so that it works after any failure.
        for path in self.cell.leftovers().unwrap_or_default() {
            let _ = std::fs::remove_file(path);
        }
        let _ = std::fs::remove_dir_all(self.cell.iox_root());
    }
}

/// A child process; dropping it, also on a panic, kills it and waits for it.
pub struct Peer {
    child: Child,
    label: String,
}

impl Peer {
    /// Starts this test program again as `part`, in the same cell.
    pub fn start(cell: &Cell, part: &str, label: &str) -> Peer {
        let child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "peer", "--test-threads", "1"])
            .env(PART, part)
            .env(FOLDER, cell.runtime_dir())
            .env(LABEL, label)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        Peer {
            child,
            label: label.to_owned(),
        }
    }

    /// Like `start`, and waits until the process has announced itself as a driver.
    pub fn announced(cell: &Cell, part: &str, label: &str) -> (Peer, Announcement) {
        let peer = Peer::start(cell, part, label);
        let found = wait_for(|| {
            let found = cell.announced(Role::Driver, label).unwrap();
            found.filter(|found| found.pid == peer.child.id())
        });
        (peer, found)
    }

    /// Sends SIGKILL and waits until the process is gone.
    pub fn kill(mut self) {
        self.end();
    }

    pub fn id(&self) -> u32 {
        self.child.id()
    }

    fn end(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        self.end();
    }
}

/// Polls until `look` returns a value.
pub fn wait_for<T>(mut look: impl FnMut() -> Option<T>) -> T {
    let limit = Instant::now() + LIMIT;
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(Instant::now() < limit, "nothing came within {LIMIT:?}");
        std::thread::yield_now();
    }
}

/// Returns role, cell and label in a child process; `None` in the test program itself.
pub fn part() -> Option<(String, Cell, String)> {
    let part = std::env::var(PART).ok()?;
    // Whatever happens to the test program, no child process stays.
    nix::sys::prctl::set_pdeathsig(nix::sys::signal::Signal::SIGKILL).unwrap();
    let cell = Cell::at("test", &PathBuf::from(std::env::var_os(FOLDER).unwrap())).unwrap();
    Some((part, cell, std::env::var(LABEL).unwrap()))
}

/// Waits for the file that an unannounced child process writes once it is in the cell.
pub fn wait_until_started(cell: &Cell) -> PathBuf {
    let path = cell.runtime_dir().join("started");
    wait_for(|| path.exists().then_some(()));
    path
}

/// Runs the janitor of this build.
pub fn run_janitor(cell: &Cell) -> Result<clean::CleanReport, clean::CleanError> {
    clean::run_janitor(cell, LIMIT)
}

/// Returns the error of a call that must fail.
pub fn refused<T: Debug, E>(result: Result<T, E>) -> E {
    match result {
        Ok(value) => panic!("{value:?} should have been refused"),
        Err(error) => error,
    }
}

/// Returns all files and folders below a folder, sorted.
pub fn paths_below(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap().flatten() {
        found.push(entry.path());
        if entry.path().is_dir() {
            found.extend(paths_below(&entry.path()));
        }
    }
    found.sort();
    found
}
