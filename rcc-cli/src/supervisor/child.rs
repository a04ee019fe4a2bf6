//! One supervised process: started in its own process group, watched, ended. Always started by the supervisor's thread,
//! because children die with the thread that started them.

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

use super::notify::NotifySocket;
use super::policy::{RestartDecision, RestartPolicy};
use super::processes::{ProcessSpec, ReadySignal};
use super::start_error::StartError;

/// Length from which a log is emptied, bytes.
const LOG_MAX: u64 = 8 << 20;
/// Lines of the log shown after a death.
const LOG_LINES_SHOWN: usize = 6;

/// State of a supervised process.
#[derive(Debug)]
pub enum ProcessState {
    /// Not running; to be started at this time since the supervisor's start.
    Down(Duration),
    /// RunningCell, not ready yet.
    Starting(Process),
    /// RunningCell and ready.
    Up(Process),
    /// Failed permanently: it is not restarted.
    Failed,
}

/// A supervised process.
#[derive(Debug)]
pub struct Child {
    /// Program, arguments and kind.
    pub spec: ProcessSpec,
    /// State.
    pub state: ProcessState,
    /// Restart policy, with its previous deaths.
    pub restarts: RestartPolicy,
    /// Notifications; `None` while it does not run, and for programs that send none.
    pub notifications: Option<NotifySocket>,
    /// Set when it hung: length of the silence, and the time at which it was asked to abort.
    pub hung: Option<(Duration, Instant)>,
    watchdog: Duration,
    log: PathBuf,
    /// Length of the log before the process was started, bytes: predecessors wrote that part.
    log_begin: u64,
    output: PathBuf,
    notify_path: PathBuf,
}

impl Child {
    /// Creates a process that is not started yet; its output goes to files in the first folder, its notifications to a
    /// socket in the second.
    #[must_use]
    pub fn new(
        spec: ProcessSpec,
        number: usize,
        supervision: &SupervisionConfig,
        [logs, sockets]: [&Path; 2],
    ) -> Child {
        let file = spec.name.replace('/', "-");
        Child {
            log: logs.join(format!("{file}.log")),
            output: logs.join(format!("{file}.out")),
            // Shorter than the cell's own socket path, whose length was checked.
            notify_path: sockets.join(format!("n{number}")),
            log_begin: 0,
            state: ProcessState::Down(Duration::ZERO),
            restarts: RestartPolicy::new(supervision),
            notifications: None,
            hung: None,
            watchdog: Duration::from_nanos(supervision.watchdog_ns),
            spec,
        }
    }

    /// Starts the process.
    ///
    /// # Errors
    /// Returns the system's error with the program or file.
    pub fn start(&mut self) -> Result<(), StartError> {
        let create = |path: &Path| {
            // Append mode, so that emptying the file leaves no hole.
            let mut options = OpenOptions::new();
            let options = options.create(true).append(true).mode(0o600).open(path);
            options.map_err(|error| StartError::file(path, error))
        };
        let log = create(&self.log)?;
        self.log_begin = log.metadata().map_or(0, |found| found.len());
        let output = create(&self.output)?;
        // The process reports its readiness on it.
        output
            .set_len(0)
            .map_err(|error| StartError::file(&self.output, error))?;
        let mut command = Command::new(&self.spec.program);
        // If set for the supervisor itself, these are not meant for its children.
        for name in ["NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"] {
            command.env_remove(name);
        }
        // A child that starts while the supervisor dies must not outlive it.
        command.env(PARENT, std::process::id().to_string());
        self.hung = None;
        if self.spec.ready == ReadySignal::Notified {
            let notifications = NotifySocket::listen(&self.notify_path)
                .map_err(|error| StartError::file(&self.notify_path, error))?;
            self.notifications = Some(notifications);
            command.env("NOTIFY_SOCKET", &self.notify_path);
            command.env("WATCHDOG_USEC", self.watchdog.as_micros().to_string());
        }
        let process = command
            .args(&self.spec.arguments)
            .stdin(Stdio::null())
            .stdout(output)
            .stderr(log)
            .process_group(0)
            .spawn()
            .map_err(|error| StartError::program(&self.spec.program, error))?;
        // Ordinary users may only raise the score: then loader and simulators are killed first, which is what matters.
        let _ = oom::set(process.id(), self.spec.kind.oom_score());
        self.state = ProcessState::Starting(process);
        Ok(())
    }

    /// Decides what follows a death, or a start that failed: a restart, unless it `is_final` or came too often.
    pub fn after_death(&mut self, now: Duration, is_final: bool) -> RestartDecision {
        let decision = match is_final {
            true => RestartDecision::Failed,
            false => self.restarts.record_death(now),
        };
        self.state = match decision {
            RestartDecision::Restart { at, .. } => ProcessState::Down(at),
            RestartDecision::Failed => ProcessState::Failed,
        };
        decision
    }

    /// Returns the process id while it runs.
    #[must_use]
    pub fn pid(&self) -> Option<u32> {
        match &self.state {
            ProcessState::Starting(process) | ProcessState::Up(process) => Some(process.id()),
            ProcessState::Down(_) | ProcessState::Failed => None,
        }
    }

    /// Returns the exit status once the process has ended.
    pub fn ended(&mut self) -> Option<ExitStatus> {
        match &mut self.state {
            ProcessState::Starting(process) | ProcessState::Up(process) => {
                process.try_wait().ok().flatten()
            }
            ProcessState::Down(_) | ProcessState::Failed => None,
        }
    }

    /// Returns true if the process runs and is ready.
    #[must_use]
    pub fn is_ready(&self) -> bool {
        match &self.spec.ready {
            ReadySignal::Notified => self
                .notifications
                .as_ref()
                .is_some_and(NotifySocket::is_ready),
            ReadySignal::Line => tail(&self.output, 0).contains('\n'),
        }
    }

    /// Detects a hang: no READY within `start`, or no heartbeat within the watchdog's time. Aborts such a process, like
    /// systemd, and kills it if it does not end within `patience`. Returns the length of the silence when a hang is
    /// detected.
    pub fn check_watchdog(&mut self, start: Duration, patience: Duration) -> Option<Duration> {
        self.pid()?;
        if let Some((_, since)) = self.hung {
            if since.elapsed() > patience {
                self.signal(Signal::SIGKILL);
            }
            return None;
        }
        let notifications = self.notifications.as_mut()?;
        notifications.read();
        let silence = notifications.silence_beyond(start, self.watchdog)?;
        self.hung = Some((silence, Instant::now()));
        self.signal(Signal::SIGABRT);
        // A stopped process aborts only after it continues.
        self.signal(Signal::SIGCONT);
        Some(silence)
    }

    /// Sends a signal; does nothing if the process has ended meanwhile.
    pub fn signal(&self, signal: Signal) {
        if let Some(pid) = self.pid().and_then(|pid| i32::try_from(pid).ok()) {
            // The child has not been waited for, so its id is still its own.
            let _ = kill(Pid::from_raw(pid), signal);
        }
    }

    /// Returns the last lines of its stderr.
    #[must_use]
    pub fn last_log_lines(&self) -> Vec<String> {
        let text = tail(&self.log, self.log_begin);
        let lines: Vec<&str> = text.lines().filter(|line| !line.is_empty()).collect();
        let skipped = lines.len().saturating_sub(LOG_LINES_SHOWN);
        lines[skipped..]
            .iter()
            .map(|line| (*line).to_owned())
            .collect()
    }

    /// Empties logs that have grown too long.
    pub fn trim_log(&self) {
        for path in [&self.log, &self.output] {
            if std::fs::metadata(path).is_ok_and(|found| found.len() > LOG_MAX) {
                // If this fails, the log stays long.
                let _ = OpenOptions::new().write(true).truncate(true).open(path);
            }
        }
    }
}

/// Returns true if a restart cannot help.
#[must_use]
pub fn is_final(status: ExitStatus) -> bool {
    remedy(status).is_some()
}

/// Returns the remedy for a process that ended permanently.
#[must_use]
pub fn remedy(status: ExitStatus) -> Option<&'static str> {
    final_ending(status).map(|(_, _, remedy)| *remedy)
}

fn final_ending(status: ExitStatus) -> Option<&'static (u8, &'static str, &'static str)> {
    let code = status.code()?;
    exit::FINAL.iter().find(|(row, ..)| i32::from(*row) == code)
}

/// Describes how a process ended.
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

/// Returns the end of a file, at most 8 KiB and not before `begin`; empty if it cannot be read.
fn tail(path: &Path, begin: u64) -> String {
    let read = || -> io::Result<Vec<u8>> {
        let mut file = File::open(path)?;
        let length = file.metadata()?.len();
        // It was emptied since if it is shorter.
        let begin = if begin <= length { begin } else { 0 };
        file.seek(SeekFrom::Start(begin.max(length.saturating_sub(8192))))?;
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes)?;
        Ok(bytes)
    };
    read().map_or_else(
        |_| String::new(),
        |bytes| String::from_utf8_lossy(&bytes).into_owned(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::supervisor::processes::ProcessKind;

    fn child(program: &str, logs: &Path) -> Child {
        let spec = ProcessSpec {
            kind: ProcessKind::Simulator,
            name: "simulator".into(),
            program: program.into(),
            arguments: Vec::new(),
            ready: ReadySignal::Line,
        };
        Child::new(spec, 0, &SupervisionConfig::default(), [logs, logs])
    }

    #[test]
    fn a_start_that_fails_for_a_moment_is_tried_again() {
        let folder = rcc_testing::folder();
        let logs = folder.path().join("logs");
        let mut child = child("/bin/true", &logs);
        let error = child.start().unwrap_err();
        assert!(!error.remedy().is_final(), "{error}");
        let decision = child.after_death(Duration::ZERO, error.remedy().is_final());
        assert!(matches!(decision, RestartDecision::Restart { nth: 1, .. }));
        assert!(matches!(child.state, ProcessState::Down(_)));
        std::fs::create_dir(&logs).unwrap();
        child.start().unwrap();
        let ProcessState::Starting(process) = &mut child.state else {
            panic!("{:?}", child.state)
        };
        assert!(process.wait().unwrap().success());
    }

    #[test]
    fn a_missing_program_is_not_tried_again() {
        let folder = rcc_testing::folder();
        let mut child = child("/nowhere/rcc-exec", folder.path());
        let error = child.start().unwrap_err();
        assert!(
            error.to_string().starts_with("/nowhere/rcc-exec: "),
            "{error}"
        );
        let decision = child.after_death(Duration::ZERO, error.remedy().is_final());
        assert_eq!(decision, RestartDecision::Failed);
        assert!(matches!(child.state, ProcessState::Failed));
    }
}
