//! One process under supervision: started in its own process group, watched, ended.
//! Started by the supervisor's thread, and by no other: its children die with that thread.

use std::fs::{File, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom};
use std::os::unix::fs::OpenOptionsExt;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child as Process, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use rcc_config::cell::SupervisionConfig;
use rcc_process::signals::PARENT;
use rcc_process::{exit, oom};

use super::processes::{LOADER_ENVIRONMENT, ReadySignal, ProcessSpec, ProcessKind};
use super::notify::NotifySocket;
use super::policy::RestartPolicy;

/// A log longer than this is emptied.
const LOG_MAX: u64 = 8 << 20;
/// Lines of a log that are shown after a death.
const LINES_SHOWN: usize = 6;

/// Where a process is in its life.
#[derive(Debug)]
pub enum ProcessState {
    /// Not started, or started again at that time since the supervisor's start.
    Down(Duration),
    /// Runs, not yet ready.
    Starting(Process),
    /// Runs.
    Up(Process),
    /// Ended for good: it is not started again, whatever happens.
    Failed,
}

/// One process under supervision.
#[derive(Debug)]
pub struct Child {
    /// What it is.
    pub spec: ProcessSpec,
    /// Where it is in its life.
    pub state: ProcessState,
    /// Its deaths.
    pub restarts: RestartPolicy,
    /// What it tells; `None` while it does not run, and for programs that tell nothing.
    pub notices: Option<NotifySocket>,
    /// It hung for so long and has been asked to abort; when.
    pub hung: Option<(Duration, Instant)>,
    watchdog: Duration,
    log: PathBuf,
    output: PathBuf,
    notify_path: PathBuf,
}

impl Child {
    /// A process that is not started yet; its output goes to files in `logs`.
    #[must_use]
    pub fn new(spec: ProcessSpec, number: usize, supervision: &SupervisionConfig, logs: &Path) -> Child {
        let file = spec.name.replace('/', "-");
        Child {
            log: logs.join(format!("{file}.log")),
            output: logs.join(format!("{file}.out")),
            // Shorter than the cell's own socket, whose length has been checked.
            notify_path: logs.join(format!("n{number}")),
            state: ProcessState::Down(Duration::ZERO),
            restarts: RestartPolicy::new(supervision),
            notices: None,
            hung: None,
            watchdog: Duration::from_nanos(supervision.watchdog_ns),
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
        let mut command = Command::new(&self.spec.program);
        // Of a supervisor of ours they are not meant for our children.
        for name in ["NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"] {
            command.env_remove(name);
        }
        if self.spec.kind == ProcessKind::Loader {
            command.envs(LOADER_ENVIRONMENT);
        }
        // One that starts while we die must not outlive us.
        command.env(PARENT, std::process::id().to_string());
        self.hung = None;
        if self.spec.ready == ReadySignal::Notified {
            let notices = NotifySocket::listen(&self.notify_path).map_err(|error| named(&self.notify_path, error))?;
            self.notices = Some(notices);
            command.env("NOTIFY_SOCKET", &self.notify_path);
            command.env("WATCHDOG_USEC", self.watchdog.as_micros().to_string());
        }
        let process = command
            .args(&self.spec.arguments)
            .stdin(Stdio::null())
            .stdout(create(&self.output)?)
            .stderr(create(&self.log)?)
            .process_group(0)
            .spawn()
            .map_err(|error| named(&self.spec.program, error))?;
        // An ordinary user may only raise it: then the loader and the simulators go first, which is what counts.
        let _ = oom::set(process.id(), self.spec.kind.oom_score());
        self.state = ProcessState::Starting(process);
        Ok(())
    }

    /// Its process id while it runs.
    #[must_use]
    pub fn pid(&self) -> Option<u32> {
        match &self.state {
            ProcessState::Starting(process) | ProcessState::Up(process) => Some(process.id()),
            ProcessState::Down(_) | ProcessState::Failed => None,
        }
    }

    /// How it ended, if it just did.
    pub fn ended(&mut self) -> Option<ExitStatus> {
        match &mut self.state {
            ProcessState::Starting(process) | ProcessState::Up(process) => process.try_wait().ok().flatten(),
            ProcessState::Down(_) | ProcessState::Failed => None,
        }
    }

    /// True if it runs and is ready.
    #[must_use]
    pub fn is_ready(&self) -> bool {
        match &self.spec.ready {
            ReadySignal::Notified => self.notices.as_ref().is_some_and(NotifySocket::is_ready),
            ReadySignal::Line => tail(&self.output).contains('\n'),
        }
    }

    /// Looks for a hang: no READY within `start`, or no heartbeat within the watchdog's time. Such a process is asked to
    /// abort, as systemd does, and killed if it does not within `patience`. How long it hung, when it was just found.
    pub fn watch(&mut self, start: Duration, patience: Duration) -> Option<Duration> {
        self.pid()?;
        if let Some((_, since)) = self.hung {
            if since.elapsed() > patience {
                self.signal(Signal::SIGKILL);
            }
            return None;
        }
        let notices = self.notices.as_mut()?;
        notices.take();
        let silence = notices.hung_for(start, self.watchdog)?;
        self.hung = Some((silence, Instant::now()));
        self.signal(Signal::SIGABRT);
        // A process that was stopped aborts only when it goes on.
        self.signal(Signal::SIGCONT);
        Some(silence)
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
    pub fn last_log_lines(&self) -> Vec<String> {
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
    remedy(status).is_some()
}

/// What to do about a process that ended for good.
#[must_use]
pub fn remedy(status: ExitStatus) -> Option<&'static str> {
    final_ending(status).map(|(_, _, remedy)| *remedy)
}

fn final_ending(status: ExitStatus) -> Option<&'static (u8, &'static str, &'static str)> {
    let code = status.code()?;
    exit::FINAL
        .iter()
        .find(|(row, ..)| i32::from(*row) == code)
}

/// How a process ended, in words.
#[must_use]
pub fn describe(status: ExitStatus) -> String {
    if let Some((code, meaning, _)) = final_ending(status) {
        return format!("{meaning} (exit {code})");
    }
    match (status.code(), status.signal()) {
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
