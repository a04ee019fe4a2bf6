//! The cell that the gateway makes for devices that the library creates. A cell's devices are fixed while it runs, so
//! that a changed set means: write the files, start the cell again. `rcc-cli up` supervises its processes; one thread
//! of the gateway supervises `rcc-cli up`.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use crate::devices::{ArmGeometry, CellOptions, DeviceKind, DeviceSpec, cell_name, urdf};
use crate::state::{GatewayState, ReportedDevice};

mod supervision;

/// Time that removed devices stay in the cell: the library often removes several, or creates others at once.
const REMOVAL_DELAY: Duration = Duration::from_millis(500);

/// A cell of the gateway's own.
#[derive(Debug)]
pub struct OwnCell {
    options: CellOptions,
    folder: PathBuf,
    rcc_cli: PathBuf,
    wanted: Mutex<WantedDevices>,
    changed: Condvar,
    is_restarting: AtomicBool,
    /// Number of the next file that is recognised; only the number counts.
    next_recognised: AtomicU64,
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
            next_recognised: AtomicU64::new(0),
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
        // Several connections may create devices at once.
        let number = self.next_recognised.fetch_add(1, Ordering::Relaxed);
        let path = self.folder.join(format!("recognised-{number}.urdf"));
        let failed = |source| OwnCellError::File {
            path: path.clone(),
            source,
        };
        fs::write(&path, urdf(table, &arm.joints)).map_err(failed)?;
        let output = Command::new(&self.rcc_cli)
            .args(["robot", "import"])
            .arg(&path)
            .output();
        // If it cannot be removed, the next gateway's file of this number replaces it.
        let _ = fs::remove_file(&path);
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
    use std::os::unix::fs::PermissionsExt;

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

    /// Arm of six joints, with the base at this height in metres.
    fn arm(name: &str, height: &str) -> DeviceSpec {
        let zeros = "[0,0,0,0,0,0]";
        let heights = format!("[{height},0,0,0,0,0]");
        let turns =
            "[1.5707963267948966,0,1.5707963267948966,-1.5707963267948966,1.5707963267948966,0]";
        let parameters = [
            ("dh_d", heights.as_str()),
            ("dh_a", "[0.025,0.315,0.035,0,0,0]"),
            ("dh_t", zeros),
            ("dh_al", turns),
            ("home_joint", zeros),
            ("min_joint", "[-2,-2,-2,-2,-2,-2]"),
            ("max_joint", "[2,2,2,2,2,2]"),
        ];
        let parameters = parameters.map(|(key, value)| (key.to_owned(), value.to_owned()));
        let read = DeviceSpec::read(name, "kuka_kr_arm_sim", &parameters.into());
        read.expect("a device").0
    }

    #[test]
    fn arms_that_are_created_at_once_have_their_own_kinematics() {
        let folder = rcc_testing::folder();
        // Writes the URDF that it was given as kinematics, but only when two of it run: who opens a pipe waits for the other.
        let program = folder.path().join("rcc-cli");
        let script = "#!/bin/sh\ncd \"${0%/*}\"\nif mkfifo pipe 2>/dev/null; then : >pipe; else : <pipe; fi\n\
                      echo kinematics:\nsed 's/^/  /' \"$3\"\n";
        fs::write(&program, script).expect("a program");
        let executable = fs::Permissions::from_mode(0o700);
        fs::set_permissions(&program, executable).expect("a program");
        let options = CellOptions {
            name: "test".to_owned(),
            period_ms: 2,
            delay_ms: 80,
        };
        let files = folder.path().join("files");
        let cell = OwnCell::new(options, files.clone(), program).expect("a cell");
        let arms = [arm("low", "0.25"), arm("high", "0.75")];
        let found = std::thread::scope(|scope| {
            let cell = &cell;
            let threads = arms
                .each_ref()
                .map(|arm| scope.spawn(|| cell.recognise(arm)));
            threads.map(|thread| thread.join().expect("no panic").expect("kinematics"))
        });
        for (arm, found) in arms.iter().zip(&found) {
            let DeviceKind::Arm(spec) = &arm.kind else {
                panic!("an arm")
            };
            let ArmGeometry::Dh(table) = &spec.geometry else {
                panic!("rows of Denavit and Hartenberg")
            };
            let own = urdf(table, &spec.joints);
            let own = own.lines().map(|line| format!("  {line}\n"));
            assert_eq!(*found, format!("kinematics:\n{}", own.collect::<String>()));
        }
        assert_ne!(found[0], found[1]);
        let left = fs::read_dir(files).expect("a folder").count();
        assert_eq!(left, 0, "files of arms that were recognised");
    }
}
