//! One process of a cell that a test program starts, kills and restarts.
//! Used by one thread: the process has `--parent-death` and ends with the thread that started it.

use std::fs::File;
use std::process::{Child, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use nix::sys::signal::Signal;

use crate::cell_fixture::CellFixture;
use crate::processes::signal;
use crate::waiting::LIMIT;

/// A process with the command line that starts it.
#[derive(Debug)]
pub struct Process {
    name: String,
    program: &'static str,
    arguments: Vec<String>,
    child: Option<Child>,
}

impl Process {
    /// Describes a program that takes `--cell` and `--config`, without starting it. Its log is `NAME.log`.
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

    /// Describes the driver of a device, at the priority that a supervisor gives it: 10 below the executor's
    /// `priority`.
    pub fn driver(place: &CellFixture, device: &str, priority: u8) -> Process {
        let priority = priority.saturating_sub(10).max(1).to_string();
        let further = ["--device", device, "--priority", &priority];
        Process::of_cell(place, device, "rcc-driver", &further)
    }

    /// Returns the name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Starts the process and returns its process id. There is no `pre_exec` hook, so that the standard library need
    /// not fork: copy-on-write after a fork would cause page faults in the reference thread.
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

    /// Returns the process id; 0 before `start` and after `end`.
    pub fn pid(&self) -> u32 {
        self.child.as_ref().map_or(0, Child::id)
    }

    /// Returns the exit status if the process has exited.
    pub fn ended(&mut self) -> Option<ExitStatus> {
        self.child
            .as_mut()?
            .try_wait()
            .expect("the child can be asked")
    }

    /// Sends a signal and waits for the exit status; `None` if the process was not running, or had to be killed because
    /// it did not exit within [`LIMIT`].
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
        child.kill().expect("the process is a child of this one");
        child.wait().expect("the process is a child of this one");
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
