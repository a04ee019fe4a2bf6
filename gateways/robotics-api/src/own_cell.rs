//! The cell that the gateway makes for devices that the library creates. A cell's devices are fixed while it runs, so
//! that a changed set means: write the files, start the cell again. `rcc-cli up` supervises its processes; one thread
//! of the gateway supervises `rcc-cli up`.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

use crate::devices::{
    ArmGeometry, CellOptions, DeviceKind, DeviceSpec, cell_file, cell_name, robot_file, urdf,
};
use crate::gateway::Gateway;
use crate::pushes::NetState;
use crate::state::{GatewayState, ReportedDevice};

/// Time that removed devices stay in the cell: the library often removes several, or creates others at once.
const REMOVAL_DELAY: Duration = Duration::from_millis(500);
/// Pause before another attempt while a net runs.
const AGAIN_AFTER: Duration = Duration::from_millis(200);
/// Pause before the cell is started again after `rcc-cli up` has ended: the first one, and the longest after failures.
const BACK_OFF: [Duration; 2] = [Duration::from_millis(500), Duration::from_secs(30)];
/// Time for the cell to end before its supervisor is killed.
const END_TIME_MAX: Duration = Duration::from_secs(20);
/// Time for the cell's devices to be ready; the library waits 5 s for a device.
const READY_TIME_MAX: Duration = Duration::from_secs(60);

/// A cell of the gateway's own.
#[derive(Debug)]
pub struct OwnCell {
    options: CellOptions,
    folder: PathBuf,
    rcc_cli: PathBuf,
    wanted: Mutex<WantedDevices>,
    changed: Condvar,
    is_restarting: AtomicBool,
}

/// The devices that the library wants, and whether the cell has them.
#[derive(Debug, Default)]
struct WantedDevices {
    devices: Vec<OwnDevice>,
    /// Since when the cell differs; `None` if it does not.
    change_due: Option<Instant>,
    is_over: bool,
}

#[derive(Clone, Debug)]
struct OwnDevice {
    cell_name: String,
    spec: DeviceSpec,
    /// Section `kinematics` of an arm that was recognised.
    recognised: String,
}

/// The cell cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum OwnCellError {
    /// A file or a program of it.
    #[error("{path}: {source}")]
    File {
        /// The file.
        path: PathBuf,
        /// The error of the system.
        source: io::Error,
    },
    /// The geometry of the arm is not one of the supported kinds.
    #[error("the geometry of '{device}' is not supported: {cause}")]
    Geometry {
        /// The device.
        device: String,
        /// Message of `rcc-cli robot import`.
        cause: String,
    },
}

impl OwnCell {
    /// Returns a cell without devices, whose files are in `folder`.
    ///
    /// # Errors
    /// Returns an error if the folder cannot be created.
    pub fn new(
        options: CellOptions,
        folder: PathBuf,
        rcc_cli: PathBuf,
    ) -> Result<OwnCell, OwnCellError> {
        fs::create_dir_all(&folder).map_err(|source| OwnCellError::File {
            path: folder.clone(),
            source,
        })?;
        let folder = fs::canonicalize(&folder).unwrap_or(folder);
        Ok(OwnCell {
            options,
            folder,
            rcc_cli,
            wanted: Mutex::new(WantedDevices {
                change_due: Some(Instant::now()),
                ..WantedDevices::default()
            }),
            changed: Condvar::new(),
            is_restarting: AtomicBool::new(true),
        })
    }

    /// Returns true while devices are being added or removed.
    #[must_use]
    pub fn is_restarting(&self) -> bool {
        self.is_restarting.load(Ordering::Acquire)
    }

    /// Recognises the geometry of an arm. Takes some milliseconds: another program does it.
    ///
    /// # Errors
    /// Returns an error if RCC has no kinematics for it.
    pub fn recognise(&self, spec: &DeviceSpec) -> Result<String, OwnCellError> {
        let DeviceKind::Arm(arm) = &spec.kind else {
            return Ok(String::new());
        };
        let ArmGeometry::Dh(table) = &arm.geometry else {
            return Ok(String::new());
        };
        let path = self.folder.join("recognised.urdf");
        let failed = |source| OwnCellError::File {
            path: path.clone(),
            source,
        };
        fs::write(&path, urdf(table, &arm.joints)).map_err(failed)?;
        let output = Command::new(&self.rcc_cli)
            .args(["robot", "import"])
            .arg(&path)
            .output();
        let output = output.map_err(|source| OwnCellError::File {
            path: self.rcc_cli.clone(),
            source,
        })?;
        let text = String::from_utf8_lossy(&output.stdout);
        let section = kinematics_of(&text);
        match output.status.success() && !section.is_empty() {
            true => Ok(section),
            false => Err(OwnCellError::Geometry {
                device: spec.name.clone(),
                cause: String::from_utf8_lossy(&output.stderr)
                    .lines()
                    .collect::<Vec<_>>()
                    .join(" "),
            }),
        }
    }

    /// Adds a device; the caller wakes the thread afterwards.
    pub fn add(&self, state: &mut GatewayState, spec: DeviceSpec, recognised: String) {
        let mut wanted = self.wanted();
        let taken: Vec<&str> = wanted
            .devices
            .iter()
            .map(|device| device.cell_name.as_str())
            .collect();
        let cell_name = cell_name(&spec.name, &taken);
        let reported = ReportedDevice {
            type_name: spec.type_name.clone(),
            kind: spec.kind.clone(),
            cell_name: cell_name.clone(),
            state: "off",
        };
        state.devices.insert(spec.name.clone(), reported);
        wanted.devices.push(OwnDevice {
            cell_name,
            spec,
            recognised,
        });
        wanted.change_due = Some(Instant::now());
        self.is_restarting.store(true, Ordering::Release);
    }

    /// Removes a device; the caller wakes the thread afterwards.
    pub fn remove(&self, state: &mut GatewayState, name: &str) {
        state.devices.remove(name);
        let mut wanted = self.wanted();
        wanted.devices.retain(|device| device.spec.name != name);
        wanted
            .change_due
            .get_or_insert(Instant::now() + REMOVAL_DELAY);
    }

    /// Wakes the thread.
    pub fn wake(&self) {
        self.changed.notify_all();
    }

    /// Tells the thread to end the cell, and to return.
    pub fn end(&self) {
        self.wanted().is_over = true;
        self.wake();
    }

    fn wanted(&self) -> MutexGuard<'_, WantedDevices> {
        // Each change is complete when it could panic.
        self.wanted.lock().unwrap_or_else(PoisonError::into_inner)
    }

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

/// Returns the section `kinematics` of a robot file.
fn kinematics_of(text: &str) -> String {
    let mut lines = text
        .lines()
        .skip_while(|line| !line.starts_with("kinematics:"));
    let first = lines.next().into_iter();
    let rest = lines.take_while(|line| line.starts_with(' '));
    first
        .chain(rest)
        .fold(String::new(), |section, line| section + line + "\n")
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

/// Returns the program `rcc-cli` beside this one, or that of the path.
#[must_use]
pub fn rcc_cli_beside(this: Option<&Path>) -> PathBuf {
    let beside = this
        .and_then(Path::parent)
        .map(|folder| folder.join("rcc-cli"));
    beside
        .filter(|path| path.is_file())
        .unwrap_or_else(|| PathBuf::from("rcc-cli"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_kinematics_of_a_robot_file_are_found() {
        let text =
            "# head\nrobot: x\nkinematics:\n  type: srs\n  upper_arm: 1 m\n\njoints:\n  A1: {}\n";
        assert_eq!(
            kinematics_of(text),
            "kinematics:\n  type: srs\n  upper_arm: 1 m\n"
        );
        assert_eq!(kinematics_of("robot: x\n"), "");
    }
}
