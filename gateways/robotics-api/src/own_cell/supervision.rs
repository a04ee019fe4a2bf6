//! Keeps a cell of the gateway's own running: starts it again when its devices change, or when it is lost. `rcc-cli up`
//! supervises its processes; one thread of the gateway supervises `rcc-cli up`.

use std::fs;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::PoisonError;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

use super::{OwnCell, OwnCellError, OwnDevice};
use crate::devices::{DeviceKind, cell_file, robot_file};
use crate::gateway::Gateway;
use crate::pushes::NetState;

/// Pause before another attempt while a net runs.
const AGAIN_AFTER: Duration = Duration::from_millis(200);
/// Pause before the cell is started again after `rcc-cli up` has ended: the first one, and the longest after failures.
const BACK_OFF: [Duration; 2] = [Duration::from_millis(500), Duration::from_secs(30)];
/// Time for the cell to end before its supervisor is killed.
const END_TIME_MAX: Duration = Duration::from_secs(20);
/// Time for the cell's devices to be ready; the library waits 5 s for a device.
const READY_TIME_MAX: Duration = Duration::from_secs(60);

impl OwnCell {
    /// Keeps the cell running with the devices that are wanted, until [`OwnCell::end`].
    pub fn run(&self, gateway: &Gateway) {
        let mut child: Option<Child> = None;
        let [first_pause, longest_pause] = BACK_OFF;
        let mut pause = first_pause;
        loop {
            let (is_due, is_over) = {
                let wanted = self.wanted();
                let due = wanted
                    .change_due
                    .map(|due| due.saturating_duration_since(Instant::now()));
                let wait = due.unwrap_or(AGAIN_AFTER).min(AGAIN_AFTER);
                let waited = self.changed.wait_timeout(wanted, wait);
                let wanted = waited.unwrap_or_else(PoisonError::into_inner).0;
                (
                    wanted.change_due.is_some_and(|due| due <= Instant::now()),
                    wanted.is_over,
                )
            };
            if is_over {
                child.as_mut().inspect(|_| tracing::info!("the cell ends"));
                return end_child(child.as_mut());
            }
            let ended = child
                .as_mut()
                .and_then(|child| child.try_wait().ok().flatten());
            if let Some(status) = ended {
                tracing::error!(%status, folder = %self.folder.display(), "rcc-cli up has ended: its nets are lost; see up.log");
                child = None;
                lose_nets(gateway);
                self.wanted().change_due = Some(Instant::now() + pause);
                pause = longest_pause.min(pause * 2);
            }
            let mut is_ready = false;
            if is_due && !gateway.without_nets(|| is_ready = self.restart(gateway, &mut child)) {
                // A net was started meanwhile: the change waits for its end.
                std::thread::sleep(AGAIN_AFTER);
            }
            if is_ready {
                pause = first_pause;
            }
        }
    }

    /// Starts the cell with the devices that are wanted now; returns true if all of them are ready.
    fn restart(&self, gateway: &Gateway, child: &mut Option<Child>) -> bool {
        self.is_restarting.store(true, Ordering::Release);
        let devices = {
            let mut wanted = self.wanted();
            wanted.change_due = None;
            wanted.devices.clone()
        };
        end_child(child.as_mut());
        *child = match self.start(&devices) {
            Ok(started) => Some(started),
            Err(error) => {
                tracing::error!(%error, "the cell cannot be started");
                None
            }
        };
        let is_ready = child
            .as_mut()
            .is_some_and(|child| self.await_ready(gateway, child, devices.len()));
        // A device that was added meanwhile needs another turn.
        let is_complete = self.wanted().change_due.is_none();
        self.is_restarting.store(!is_complete, Ordering::Release);
        is_ready
    }

    fn start(&self, devices: &[OwnDevice]) -> Result<Child, OwnCellError> {
        let write = |path: PathBuf, text: String| {
            let written = fs::write(&path, text);
            written
                .map(|()| path.clone())
                .map_err(|source| OwnCellError::File { path, source })
        };
        let mut rows = Vec::new();
        for device in devices {
            let robot = match &device.spec.kind {
                DeviceKind::Arm(arm) => {
                    let text = robot_file(
                        &device.spec.name,
                        arm,
                        &device.recognised,
                        self.options.period_ms,
                    );
                    Some(write(
                        self.folder.join(format!("{}.yaml", device.cell_name)),
                        text,
                    )?)
                }
                DeviceKind::Io(_) => None,
            };
            rows.push((device.cell_name.clone(), &device.spec, robot));
        }
        let config = write(
            self.folder.join("cell.yaml"),
            cell_file(&self.options, &rows),
        )?;
        let log = self.folder.join("up.log");
        let opened = fs::File::options().create(true).append(true).open(&log);
        let opened = opened.and_then(|file| Ok((file.try_clone()?, file)));
        let (out, err) = opened.map_err(|source| OwnCellError::File { path: log, source })?;
        tracing::info!(devices = devices.len(), config = %config.display(), "the cell starts");
        let mut command = Command::new(&self.rcc_cli);
        command
            .args(["--cell", &self.options.name, "up", "--parent-death"])
            .arg(&config);
        let started = command.stdin(Stdio::null()).stdout(out).stderr(err).spawn();
        started.map_err(|source| OwnCellError::File {
            path: self.rcc_cli.clone(),
            source,
        })
    }

    /// Waits until every device is ready. One that does not become ready is reported as it is.
    fn await_ready(&self, gateway: &Gateway, child: &mut Child, count: usize) -> bool {
        let begun = Instant::now();
        let mut loader = gateway.loader();
        while begun.elapsed() < READY_TIME_MAX && !self.wanted().is_over {
            if child.try_wait().is_ok_and(|status| status.is_some()) {
                return false;
            }
            let ready = loader.devices().map(|devices| {
                devices
                    .iter()
                    .filter(|device| device.state == "ready")
                    .count()
            });
            if ready.is_ok_and(|ready| ready == count) {
                tracing::info!(devices = count, took = ?begun.elapsed(), "the cell is ready");
                return true;
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        false
    }
}

/// Nets that ran when the cell was lost never run again.
fn lose_nets(gateway: &Gateway) {
    let mut state = gateway.state();
    for net in state.nets.values_mut() {
        net.command = None;
        if net.state.is_active() {
            net.state = NetState::Error;
        }
    }
}

/// Ends a cell as Ctrl-C does.
fn end_child(child: Option<&mut Child>) {
    let Some(child) = child else { return };
    let pid = Pid::from_raw(child.id().cast_signed());
    // It may have ended already.
    let _ = kill(pid, Signal::SIGINT);
    let begun = Instant::now();
    while child.try_wait().is_ok_and(|status| status.is_none()) {
        if begun.elapsed() > END_TIME_MAX {
            tracing::error!("rcc-cli up does not end and is killed");
            // It may have ended just now.
            let _ = child.kill();
            let _ = child.wait();
            return;
        }
        std::thread::sleep(Duration::from_millis(10));
    }
}
