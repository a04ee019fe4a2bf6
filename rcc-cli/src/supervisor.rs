//! Supervisor of a cell in development: starts its processes, restarts dead ones (never a motion), and ends all of them
//! without leaving a process or a file behind, except for the state folder. Run by one thread; the
//! children die with that thread.

pub mod child;
mod logs;
pub mod notify;
pub mod paths;
pub mod policy;
pub mod processes;
pub mod running;
mod start_error;
mod stop;

use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use rcc_api::bodies::{DeviceView, StatusView};
use rcc_api::codes;
use rcc_config::{CellConfig, ConfigChange, FileWatch};
use rcc_ipc::clean::{self, JANITOR_TIMEOUT, WipeError};
use rcc_ipc::{Announced, Cell, events, ownership, shm_space};
use rcc_protocol::configuration::changed;
use rcc_protocol::events::{EventKind, EventOrigin, event_text};
use rcc_protocol::{Announcement, Configuration, Role};

use crate::client::LoaderClient;
use crate::context::cell_failure;
use crate::failure::Failure;
use crate::interrupt::Interrupts;
use child::{Child, ProcessState};
use policy::{Remedy, RestartDecision};
use processes::{PreparedCell, ProcessKind};

/// Interval between two polls of the processes.
pub const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// Interval between two queries of the devices.
const DEVICE_POLL_INTERVAL: Duration = Duration::from_millis(250);
/// Interval between two checks of the configuration files.
const FILE_POLL_INTERVAL: Duration = Duration::from_secs(1);
/// Longest time for one answer of the loader.
const ANSWER_TIMEOUT: Duration = Duration::from_millis(500);
/// Longest time for a cell, and for each of its processes, to become ready.
const START_TIMEOUT: Duration = Duration::from_secs(30);
/// Pause before a failed janitor runs again.
const JANITOR_RETRY_DELAY: Duration = Duration::from_secs(1);
/// Shared memory of a cell, bytes: executor, loader and a few monitors, plus each device. Measured: 8.4 MB in total
/// with two devices and a monitor.
const CELL_SHM_BYTES: u64 = 14 << 20;
const DEVICE_SHM_BYTES: u64 = 1 << 20;

/// A change reported by the supervisor.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SupervisorEvent {
    /// Time since the supervisor's start.
    pub at: Duration,
    /// Process or device.
    pub who: String,
    /// The change, in words.
    pub what: String,
}

/// A cell under supervision.
pub struct Supervisor {
    /// The cell.
    pub cell: Cell,
    /// Its configuration and ports.
    pub prepared: PreparedCell,
    children: Vec<Child>,
    started: Instant,
    on_event: Box<dyn FnMut(&SupervisorEvent)>,
    client: LoaderClient,
    devices: Vec<(String, String)>,
    devices_polled_at: Instant,
    grade_pid: u32,
    files: FileWatch,
    files_polled_at: Instant,
    /// Time at which the janitor must run again, since the supervisor's start.
    clean_due: Option<Duration>,
    polled_at: Instant,
    /// Processes that have failed permanently, with their causes and remedies.
    failures: Vec<(String, String)>,
    executor_failed: bool,
    // Held until the end, so that a second supervisor of this cell is refused.
    presence: Announced,
}

impl Supervisor {
    /// Claims the cell `name` and starts its processes. Refuses a living cell of that name; cleans up a dead one.
    /// Changes are passed to `on_event`.
    ///
    /// # Errors
    /// Fails if the cell is alive, if shared memory is short, or if a program is missing.
    pub fn start(
        name: &str,
        prepared: PreparedCell,
        on_event: Box<dyn FnMut(&SupervisorEvent)>,
    ) -> Result<Supervisor, Failure> {
        let specs = processes::process_specs(name, &prepared)?;
        paths::program("rcc-janitor")?;
        let cell = Cell::new(name).map_err(|error| cell_failure(&error))?;
        let presence = claim(&cell, &prepared.config)?;
        let (client, logs) = set_up(&cell, &prepared).inspect_err(|_| {
            // Removes our own files; what remains, the next `up` removes.
            let _ = ownership::release(&cell, &presence);
        })?;
        let sockets = cell.supervisor_dir();
        let supervision = &prepared.config.supervision;
        let children = specs.into_iter().enumerate();
        let children =
            children.map(|(number, spec)| Child::new(spec, number, supervision, [&logs, &sockets]));
        let files = FileWatch::new(prepared.config.clone(), prepared.ports.clone());
        let mut supervisor = Supervisor {
            children: children.collect(),
            cell,
            prepared,
            started: Instant::now(),
            on_event,
            client,
            devices: Vec::new(),
            devices_polled_at: Instant::now(),
            grade_pid: 0,
            files,
            files_polled_at: Instant::now(),
            clean_due: None,
            polled_at: Instant::now(),
            failures: Vec::new(),
            executor_failed: false,
            presence,
        };
        supervisor.poll();
        Ok(supervisor)
    }

    /// Waits until every process is ready and every driver has reached its device; supervises the cell meanwhile.
    ///
    /// # Errors
    /// Fails on an interrupt, if a process fails, or if it takes too long.
    pub fn wait_until_up(&mut self, interrupts: &Interrupts) -> Result<(), Failure> {
        let limit = Instant::now() + START_TIMEOUT;
        loop {
            self.poll();
            let waiting: Vec<&str> = self
                .children
                .iter()
                .filter(|child| !matches!(child.state, ProcessState::Up(_)))
                .map(|child| child.spec.name.as_str())
                .collect();
            if waiting.is_empty() {
                return Ok(());
            }
            if interrupts.asked() {
                return Err(Failure::interrupted());
            }
            if let Some((cause, remedy)) = self.failures.first() {
                let message = format!("cell `{}` did not start: {cause}", self.cell.name());
                return Err(Failure::new(codes::PROCESS_FAILED, message, remedy.clone()));
            }
            if Instant::now() >= limit {
                let names = waiting.join(", ");
                return Err(Failure::new(
                    codes::PROCESS_FAILED,
                    format!(
                        "cell `{}` did not start within {START_TIMEOUT:?}: waiting for {names}",
                        self.cell.name()
                    ),
                    "see the lines above for the reason",
                ));
            }
            std::thread::sleep(POLL_INTERVAL);
        }
    }

    /// Polls everything once; call it at least every [`POLL_INTERVAL`].
    pub fn poll(&mut self) {
        self.reset_watchdogs();
        for index in 0..self.children.len() {
            self.poll_child(index);
        }
        if self
            .clean_due
            .is_some_and(|due| due <= self.started.elapsed())
        {
            self.clean(None);
        }
        if self.devices_polled_at.elapsed() >= DEVICE_POLL_INTERVAL {
            self.devices_polled_at = Instant::now();
            self.poll_devices();
        }
        if self.files_polled_at.elapsed() >= FILE_POLL_INTERVAL {
            self.files_polled_at = Instant::now();
            self.poll_files();
        }
        self.polled_at = Instant::now();
    }

    /// Reports each change of the configuration files that is not in force; the loader writes it to the event log.
    fn poll_files(&mut self) {
        let message = match self.files.poll() {
            None => return,
            Some(ConfigChange::None) => changed("", None),
            Some(ConfigChange::Differs(differences)) => changed(&differences.join("; "), None),
            Some(ConfigChange::Invalid(fault)) => changed("", Some(fault)),
        };
        self.report("configuration", &message);
    }

    /// Returns true once a process has failed permanently.
    #[must_use]
    pub fn has_failed(&self) -> bool {
        !self.failures.is_empty()
    }

    /// Returns true once the executor has failed permanently: the cell cannot continue without it. Failures of other
    /// processes do not end the cell.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.executor_failed
    }

    /// Returns the longest time for a process to end after it was asked to.
    fn stop_timeout(&self) -> Duration {
        Duration::from_nanos(self.prepared.config.supervision.stop_timeout_ns)
    }

    /// Resets the watchdogs if the supervisor itself did not run for long (a busy or suspended machine). Time spent
    /// within a poll, such as waiting for a hung janitor or loader, does not count: heartbeats wait in the sockets
    /// meanwhile.
    fn reset_watchdogs(&mut self) {
        let away = self.polled_at.elapsed();
        if away > Duration::from_nanos(self.prepared.config.supervision.watchdog_ns) / 2 {
            let sockets = self
                .children
                .iter_mut()
                .filter_map(|child| child.notifications.as_mut());
            sockets.for_each(notify::NotifySocket::reset_watchdog);
        }
    }

    /// Returns the process id of a child, by its name.
    #[must_use]
    pub fn pid(&self, name: &str) -> Option<u32> {
        let child = self.children.iter().find(|child| child.spec.name == name)?;
        child.pid()
    }

    fn poll_child(&mut self, index: usize) {
        let now = self.started.elapsed();
        let patience = self.stop_timeout();
        let Some(child) = self.children.get_mut(index) else {
            return;
        };
        let name = child.spec.name.clone();
        if let Some(status) = child.ended() {
            let how = match child.hung {
                Some(_) => format!("killed because it hung ({})", child::describe(status)),
                None => child::describe(status),
            };
            self.handle_death(index, now, &how, child::remedy(status).map(Remedy::Final));
            return;
        }
        if let Some(silence) = child.check_watchdog(START_TIMEOUT, patience) {
            let silence = silence.as_secs_f64();
            let status = child
                .notifications
                .as_ref()
                .map_or("", notify::NotifySocket::status);
            let status_text =
                format!("hangs: no progress for {silence:.1} s, killing it; last status: {status}");
            let pid = child.pid().unwrap_or(0);
            self.report(&name, &status_text);
            self.record(EventKind::WatchdogKill {
                process: name,
                pid,
                silent_ms: (silence * 1e3) as u64,
            });
            return;
        }
        match std::mem::replace(&mut child.state, ProcessState::Failed) {
            ProcessState::Down(at) if at <= now => {
                if let Err(error) = child.start() {
                    self.handle_death(index, now, &error.to_string(), Some(error.remedy()));
                }
            }
            ProcessState::Starting(process) => {
                child.state = ProcessState::Starting(process);
                if child.is_ready() {
                    let pid = child.pid().unwrap_or(0);
                    if let ProcessState::Starting(process) =
                        std::mem::replace(&mut child.state, ProcessState::Failed)
                    {
                        child.state = ProcessState::Up(process);
                    }
                    self.report(&name, &format!("up  pid {pid}"));
                    self.record(EventKind::ProcessStarted { process: name, pid });
                }
            }
            other => {
                child.state = other;
                child.trim_log();
            }
        }
    }

    /// Handles the death of a process: logs its last lines, runs the janitor, and restarts it or gives up.
    fn handle_death(&mut self, index: usize, now: Duration, how: &str, remedy: Option<Remedy>) {
        let Some(child) = self.children.get_mut(index) else {
            return;
        };
        let (name, last_words) = (child.spec.name.clone(), child.last_log_lines());
        let pid = child.pid().unwrap_or(0);
        let is_executor = child.spec.kind == ProcessKind::Executor;
        let verdict = child.after_death(now, remedy.is_some_and(Remedy::is_final));
        self.report(&name, &format!("died: {how}"));
        // Earlier activity is in the log; only an error or panic explains the death.
        let usual = |line: &&String| line.contains(" INFO ") || line.contains(" WARN ");
        let said = last_words.iter().rfind(|line| !usual(line)).cloned();
        self.record(EventKind::ProcessDied {
            process: name.clone(),
            pid,
            how: how.to_owned(),
            last_words: event_text(said.as_deref().unwrap_or_default()),
        });
        for line in last_words {
            self.report(&name, &format!("  | {line}"));
        }
        self.clean(Some(clean::HALF_CREATED_AFTER * 2));
        match verdict {
            RestartDecision::Restart { nth, .. } => {
                let (most, window) = self.restart_limits();
                self.report(&name, &format!("restarting ({nth}/{most} in {window} s)"));
                self.record(EventKind::ProcessRestart {
                    process: name,
                    nth,
                    most,
                    within_s: window,
                });
            }
            RestartDecision::Failed => {
                let cause = said.unwrap_or_else(|| how.to_owned());
                self.fail(name, is_executor, (how, &cause), remedy.map(Remedy::words));
            }
        }
    }

    /// Reports that a process has failed permanently, the effect on the cell, and the remedy.
    fn fail(
        &mut self,
        name: String,
        is_executor: bool,
        (why, cause): (&str, &str),
        remedy: Option<&str>,
    ) {
        self.executor_failed |= is_executor;
        let (most, window) = self.restart_limits();
        let rest = match is_executor {
            true => "the cell ends",
            false => "the rest of the cell keeps running",
        };
        let remedy = remedy.map_or_else(
            || format!("it died more than {most} times in {window} s: fix the cause given above, then restart the cell"),
            str::to_owned,
        );
        self.failures
            .push((format!("{name} failed: {cause}"), remedy.clone()));
        self.report(&name, &format!("failed: not restarted ({why})"));
        self.report(&name, &format!("  > {rest}; {remedy}"));
        self.record(EventKind::ProcessFailed {
            process: name,
            why: why.to_owned(),
        });
    }

    /// Returns the allowed number of restarts and the time window, s.
    fn restart_limits(&self) -> (usize, u64) {
        let supervision = &self.prepared.config.supervision;
        (
            supervision.restarts as usize,
            supervision.within_ns / 1_000_000_000,
        )
    }

    /// Runs the janitor. After a death it runs again after `again`, because half-created resources are removed only at
    /// a certain age. A failed janitor runs again in any case.
    fn clean(&mut self, again: Option<Duration>) {
        let done = clean::run_janitor(&self.cell, JANITOR_TIMEOUT);
        let pause = done.as_ref().map_or(Some(JANITOR_RETRY_DELAY), |_| again);
        self.clean_due = pause.map(|pause| self.started.elapsed() + pause);
        if let Err(error) = done {
            self.report("janitor", &error.to_string());
        }
    }

    fn poll_devices(&mut self) {
        let serving = self.children.iter().any(|child| {
            child.spec.kind == ProcessKind::Loader && matches!(child.state, ProcessState::Up(_))
        });
        if !serving {
            return;
        }
        // Without an executor the table shows it anyway.
        let Ok(devices) = self.client.get::<Vec<DeviceView>>("/devices") else {
            return;
        };
        let states: Vec<(String, String)> = devices
            .into_iter()
            .map(|device| {
                let reason = match device.reason.as_str() {
                    "" => String::new(),
                    reason => format!(" ({reason})"),
                };
                (device.name, format!("{}{reason}", device.state))
            })
            .collect();
        let before = std::mem::replace(&mut self.devices, states.clone());
        for (name, state) in states {
            let old = before.iter().find(|(other, _)| *other == name);
            match old {
                Some((_, old)) if *old == state => {}
                Some((_, old)) => {
                    self.report(&format!("device {name}"), &format!("{old} → {state}"))
                }
                None => self.report(&format!("device {name}"), &state),
            }
        }
        self.report_grade();
    }

    /// Reports the real-time grade once per incarnation of the executor.
    fn report_grade(&mut self) {
        let pid = self.pid("executor").unwrap_or(0);
        if pid == self.grade_pid {
            return;
        }
        if let Ok(status) = self.client.get::<StatusView>("/status")
            && status.executor.pid == pid
        {
            self.grade_pid = pid;
            self.report("executor", &status.executor.grade);
        }
    }

    /// Adds an entry to the cell's event log.
    fn record(&self, what: EventKind) {
        events::tell(&self.cell, EventOrigin::Supervisor, "up", what);
    }

    fn report(&mut self, who: &str, what: &str) {
        (self.on_event)(&SupervisorEvent {
            at: self.started.elapsed(),
            who: who.to_owned(),
            what: what.to_owned(),
        });
    }
}

/// Creates the files that the processes of a cell expect; returns a client of the loader and the folder of their logs.
fn set_up(cell: &Cell, prepared: &PreparedCell) -> Result<(LoaderClient, PathBuf), Failure> {
    shm_space::require(CELL_SHM_BYTES + DEVICE_SHM_BYTES * prepared.config.devices.len() as u64)
        .map_err(|error| Failure::new(codes::NO_SPACE, error.to_string(), ""))?;
    let recorder = &prepared.config.recorder;
    cell.make_state(recorder.folder.as_deref())
        .map_err(|error| cell_failure(&error))?;
    let logs = logs::begin_run(&cell.state(), recorder.keep)?;
    let sockets = cell.supervisor_dir();
    private_folder(&sockets)
        .map_err(|error| Failure::unreadable(&sockets.display().to_string(), &error))?;
    let config = prepared.path.display().to_string();
    events::begin_log(cell, &config, &prepared.ports);
    running::write(cell, prepared)?;
    let client = LoaderClient::new(cell.name(), &cell.socket(), ANSWER_TIMEOUT)?;
    Ok((client, logs))
}

fn private_folder(path: &Path) -> std::io::Result<()> {
    let mut folder = std::fs::DirBuilder::new();
    folder.recursive(true).mode(0o700).create(path)
}

/// Claims the cell for this process unless somebody else has it; then nothing is changed.
fn claim(cell: &Cell, config: &CellConfig) -> Result<Announced, Failure> {
    let supervisor = Announcement::supervisor()
        .map_err(|error| Failure::new(codes::PROCESS_FAILED, error.to_string(), ""))?
        .configured(Configuration::new(config.identity()));
    ownership::acquire(cell, &supervisor).map_err(|error| {
        let name = cell.name();
        match &error {
            WipeError::Living { role: Role::Cli, pid, .. } => Failure::new(
                codes::CELL_LIVES,
                format!("cell `{name}` is already running: `rcc-cli up` (process {pid}) supervises it"),
                format!(
                    "inspect it with `rcc-cli --cell {name} status`, end it with `rcc-cli --cell {name} down`; \
                     --cell NAME starts another cell beside it"
                ),
            ),
            WipeError::Living { role, label, pid, .. } => Failure::new(
                codes::CELL_LIVES,
                format!("cell `{name}` is in use: its {role} `{label}` (process {pid}) runs without `rcc-cli up`"),
                format!(
                    "`rcc-cli --cell {name} down` ends it, or names the systemd unit that does; for a moment after \
                     `rcc-cli up` was killed, its processes still bring the devices to rest; --cell NAME starts \
                     another cell beside it"
                ),
            ),
            WipeError::InUse { .. } => Failure::new(codes::CELL_LIVES, error.to_string(), ""),
            _ => Failure::new(codes::PROCESS_FAILED, error.to_string(), ""),
        }
    })
}
