//! One process of a cell that a program of ours starts, kills and starts again.
//! Run by the thread that starts it: the process is asked to end with that thread.

use std::fs::File;
use std::process::{Child, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use nix::sys::signal::Signal;

use crate::cell_fixture::{CellFixture, LIMIT};
use crate::processes::signal;

/// A process and how it is started.
#[derive(Debug)]
pub struct Process {
    name: String,
    program: &'static str,
    arguments: Vec<String>,
    child: Option<Child>,
}

impl Process {
    /// A program of the cell that takes `--cell` and `--config`; it is not started yet. `name` is that of its log.
    pub fn of_cell(
        place: &CellFixture,
        name: &str,
        program: &'static str,
        further: &[&str],
    ) -> Process {
        let config = place.config().display().to_string();
        let mut arguments = vec!["--config".to_owned(), config, "--parent-death".to_owned()];
        arguments.extend(further.iter().map(|&word| word.to_owned()));
        Process {
            name: name.to_owned(),
            program,
            arguments,
            child: None,
        }
    }

    /// The driver of a device, with the priority that a supervisor gives it below an executor's `priority`.
    pub fn driver(place: &CellFixture, device: &str, priority: u8) -> Process {
        let priority = priority.saturating_sub(10).max(1).to_string();
        let further = ["--device", device, "--priority", &priority];
        Process::of_cell(place, device, "rcc-driver", &further)
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Starts it; returns its process id. Nothing is run between fork and exec, so that this process is not copied:
    /// a copy would make the pages of the reference thread fault.
    pub fn start(&mut self, place: &CellFixture) -> u32 {
        let path = place.folder().join(format!("{}.log", self.name));
        let log = File::options().create(true).append(true).open(path);
        let child = place
            .program(self.program)
            .args(&self.arguments)
            .stdout(Stdio::null())
            .stderr(log.expect("a log can be written"))
            .spawn();
        let child = child.unwrap_or_else(|error| panic!("{}: {error}", self.program));
        let pid = child.id();
        self.child = Some(child);
        pid
    }

    /// Its process id; 0 while it does not run.
    pub fn pid(&self) -> u32 {
        self.child.as_ref().map_or(0, Child::id)
    }

    /// How it ended, if it did.
    pub fn ended(&mut self) -> Option<ExitStatus> {
        self.child
            .as_mut()?
            .try_wait()
            .expect("the child can be asked")
    }

    /// Sends a signal and waits until it is dead; `None` if it had to be killed because it did not obey.
    pub fn end(&mut self, with: Signal) -> Option<ExitStatus> {
        let mut child = self.child.take()?;
        signal(child.id(), with);
        let begun = Instant::now();
        while begun.elapsed() < LIMIT {
            if let Some(status) = child.try_wait().expect("the child can be asked") {
                return Some(status);
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        child.kill().expect("the child is ours");
        child.wait().expect("the child is ours");
        None
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        if let Some(child) = &mut self.child {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}
