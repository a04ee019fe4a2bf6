//! One process under supervision: started in its own process group, watched, ended.
//! Started by the supervisor's thread, and by no other: its children die with that thread.

use std::fs::{File, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom};
use std::os::unix::fs::OpenOptionsExt;
use std::os::unix::net::UnixStream;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child as Process, Command, ExitStatus, Stdio};
use std::time::Duration;

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use rcc_ipc::{Announcement, Cell, Role};

use super::launch::{Ready, Spec};
use super::policy::Restarts;

/// Exit codes with which starting again does not help: wrong arguments, a configuration error (sysexits.h EX_CONFIG).
const EXIT_USAGE: i32 = 2;
const EXIT_CONFIG: i32 = 78;
/// A log longer than this is emptied.
const LOG_MAX: u64 = 8 << 20;
/// Lines of a log that are shown after a death.
const LINES_SHOWN: usize = 6;

/// Where a process is in its life.
#[derive(Debug)]
pub enum Life {
    /// Not started, or started again at that time since the supervisor's start.
    Down(Duration),
    /// Runs, not yet ready.
    Starting(Process),
    /// Runs.
    Up(Process),
    /// Ended for good.
    Failed,
}

/// One process under supervision.
#[derive(Debug)]
pub struct Child {
    /// What it is.
    pub spec: Spec,
    /// Where it is in its life.
    pub life: Life,
    /// Its deaths.
    pub restarts: Restarts,
    log: PathBuf,
    output: PathBuf,
}

impl Child {
    /// A process that is not started yet; its output goes to files in `logs`.
    #[must_use]
    pub fn new(spec: Spec, logs: &Path) -> Child {
        let file = spec.name.replace('/', "-");
        Child {
            log: logs.join(format!("{file}.log")),
            output: logs.join(format!("{file}.out")),
            life: Life::Down(Duration::ZERO),
            restarts: Restarts::default(),
            spec,
        }
    }

    /// Starts it.
    ///
    /// # Errors
    /// What the system says, with the program or file.
    pub fn start(&mut self) -> io::Result<()> {
        let named = |path: &Path, error: io::Error| {
            io::Error::new(error.kind(), format!("{}: {error}", path.display()))
        };
        let create = |path: &Path| {
            // Appending, so that emptying the file leaves no hole.
            let mut options = OpenOptions::new();
            let options = options.create(true).append(true).mode(0o600).open(path);
            let file = options.map_err(|error| named(path, error))?;
            file.set_len(0).map_err(|error| named(path, error))?;
            Ok::<File, io::Error>(file)
        };
        let process = Command::new(&self.spec.program)
            .args(&self.spec.arguments)
            .stdin(Stdio::null())
            .stdout(create(&self.output)?)
            .stderr(create(&self.log)?)
            .process_group(0)
            .spawn()
            .map_err(|error| named(&self.spec.program, error))?;
        self.life = Life::Starting(process);
        Ok(())
    }

    /// Its process id while it runs.
    #[must_use]
    pub fn pid(&self) -> Option<u32> {
        match &self.life {
            Life::Starting(process) | Life::Up(process) => Some(process.id()),
            Life::Down(_) | Life::Failed => None,
        }
    }

    /// How it ended, if it just did.
    pub fn ended(&mut self) -> Option<ExitStatus> {
        match &mut self.life {
            Life::Starting(process) | Life::Up(process) => process.try_wait().ok().flatten(),
            Life::Down(_) | Life::Failed => None,
        }
    }

    /// True if it runs and is ready.
    #[must_use]
    pub fn is_ready(&self, cell: &Cell) -> bool {
        let Some(pid) = self.pid() else { return false };
        let announced = |role: Role, label: &str| {
            let found = cell.announced(role, label).ok().flatten();
            found.is_some_and(|found: Announcement| found.pid == pid)
        };
        match &self.spec.ready {
            Ready::Announced(role, label) => announced(*role, label),
            Ready::Serving => {
                announced(Role::Loader, "loader") && UnixStream::connect(cell.socket()).is_ok()
            }
            Ready::Line => tail(&self.output).contains('\n'),
        }
    }

    /// Asks it to end, or kills it. One that ended meanwhile is no error.
    pub fn signal(&self, signal: Signal) {
        if let Some(pid) = self.pid().and_then(|pid| i32::try_from(pid).ok()) {
            // It is our child and not yet waited for: the id is still its own.
            let _ = kill(Pid::from_raw(pid), signal);
        }
    }

    /// The last lines that it wrote to stderr.
    #[must_use]
    pub fn last_words(&self) -> Vec<String> {
        let text = tail(&self.log);
        let lines: Vec<&str> = text.lines().filter(|line| !line.is_empty()).collect();
        let skipped = lines.len().saturating_sub(LINES_SHOWN);
        lines[skipped..]
            .iter()
            .map(|line| (*line).to_owned())
            .collect()
    }

    /// Empties a log that has grown too long.
    pub fn trim_log(&self) {
        for path in [&self.log, &self.output] {
            if std::fs::metadata(path).is_ok_and(|found| found.len() > LOG_MAX) {
                // Not being able to leaves a long log.
                let _ = OpenOptions::new().write(true).truncate(true).open(path);
            }
        }
    }
}

/// True if starting again cannot help.
#[must_use]
pub fn is_final(status: ExitStatus) -> bool {
    matches!(status.code(), Some(EXIT_USAGE | EXIT_CONFIG))
}

/// How a process ended, in words.
#[must_use]
pub fn words(status: ExitStatus) -> String {
    match (status.code(), status.signal()) {
        (Some(EXIT_USAGE), _) => "wrong arguments (exit 2)".to_owned(),
        (Some(EXIT_CONFIG), _) => "configuration error (exit 78)".to_owned(),
        (Some(code), _) => format!("exit {code}"),
        (None, Some(number)) => match Signal::try_from(number) {
            Ok(signal) => signal.as_str().to_owned(),
            Err(_) => format!("signal {number}"),
        },
        (None, None) => "ended".to_owned(),
    }
}

/// The end of a file, at most 8 KiB; empty when it cannot be read.
fn tail(path: &Path) -> String {
    let read = || -> io::Result<Vec<u8>> {
        let mut file = File::open(path)?;
        let length = file.metadata()?.len();
        file.seek(SeekFrom::Start(length.saturating_sub(8192)))?;
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes)?;
        Ok(bytes)
    };
    read().map_or_else(
        |_| String::new(),
        |bytes| String::from_utf8_lossy(&bytes).into_owned(),
    )
}
