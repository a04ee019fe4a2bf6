//! A cell as described by its file: timing, devices, simulators and ports, checked as a whole. Read once at start-up by
//! every process that works with the cell; never by the real-time thread.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use rcc_core::frame::DeviceModel;

use crate::access::AccessConfig;
use crate::device::DeviceConfig;
use crate::diagnostic::Faults;
use crate::file::{self, SourceFile};
use crate::link::LinkConfig;
use crate::ports::PortNumbers;
use crate::recorder::RecorderConfig;

mod clock;
mod read;

/// The keys of each mapping, for the test of the schema.
#[cfg(test)]
pub(crate) mod keys {
    pub use super::read::{
        DEVICE_KEYS as DEVICE, DRIVER_KEYS as DRIVER, EXECUTOR_KEYS as EXECUTOR, KEYS as CELL,
        SIMULATOR_KEYS as SIMULATOR, SUPERVISION_KEYS as SUPERVISION,
    };
}

/// Configuration that all processes of one cell must agree on.
#[derive(Clone, Debug, PartialEq)]
pub struct CellConfig {
    /// Name of the cell; `[a-z0-9][a-z0-9_-]{0,31}`.
    pub name: String,
    /// Period of the executor, ns.
    pub period_ns: u64,
    /// Age beyond which a measurement is stale and the ports of its device are null, ns.
    pub stale_after_ns: u64,
    /// Device that the executor's clock follows; `None`: it has its own clock.
    pub clock: Option<ClockConfig>,
    /// Real-time thread of the executor.
    pub executor: ExecutorConfig,
    /// Flight recorder.
    pub recorder: RecorderConfig,
    /// How supervisors treat processes that die or hang.
    pub supervision: SupervisionConfig,
    /// Access for others than the user that runs the cell.
    pub access: AccessConfig,
    /// Link to other cells; `None`: nothing leaves this one.
    pub link: Option<LinkConfig>,
    /// Devices in the order of the file, at most 16; the position is the device index in plans.
    pub devices: Vec<DeviceConfig>,
    /// Simulators that `up` starts; none in production.
    pub simulators: Vec<SimulatorConfig>,
    /// All ports by name, with their numbers in this run.
    pub ports: BTreeMap<String, u16>,
    /// Path of the file.
    pub source: PathBuf,
}

/// A clock that follows a device: each cycle begins a fixed time after a packet of the device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClockConfig {
    /// Index of the device.
    pub device: usize,
    /// Time from the packet to the beginning of the cycle, ns; at most half of the period.
    pub offset_ns: u64,
}

/// Settings of the executor's real-time thread.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExecutorConfig {
    /// SCHED_FIFO priority, 1 to 99.
    pub priority: u8,
    /// CPU core that the thread is bound to; `None`: the system chooses.
    pub core: Option<usize>,
    /// Number of late cycles in a row after which the most expensive net ends; 0: never.
    pub late_in_a_row_max: u32,
    /// Share of a cycle that all nets may use together, in thousandths of the period; above 1000 overload is admitted.
    pub budget_permille: u32,
    /// Behaviour if the system does not grant real time.
    pub rt: RealTime,
}

/// Behaviour of an executor to which the system does not grant real time: SCHED_FIFO, locked memory, and its core if
/// one is configured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RealTime {
    /// It runs and reports what is missing.
    BestEffort,
    /// It exits.
    Required,
}

/// How supervisors (`rcc-cli up`, systemd) treat processes that die or hang.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SupervisionConfig {
    /// A process that dies is restarted this many times …
    pub restarts: u32,
    /// … within this time, ns; one more death, and it stays failed.
    pub within_ns: u64,
    /// Time that a process may take to end on request before it is killed, ns.
    pub stop_timeout_ns: u64,
    /// Time without progress after which a process is killed and restarted, ns.
    pub watchdog_ns: u64,
}

impl Default for SupervisionConfig {
    fn default() -> Self {
        SupervisionConfig {
            restarts: 5,
            within_ns: 30_000_000_000,
            stop_timeout_ns: 5_000_000_000,
            watchdog_ns: 2_000_000_000,
        }
    }
}

/// A program that simulates a device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SimulatorConfig {
    /// Name, unique among the simulators of its cell.
    pub name: String,
    /// The program: a name next to our own programs, or a path.
    pub program: String,
    /// Its arguments, with `${port}` replaced. With `device`, the program that starts it adds `--control` and its
    /// control socket.
    pub arguments: Vec<String>,
    /// The simulated device.
    pub device: Option<String>,
}

impl Default for ExecutorConfig {
    fn default() -> Self {
        ExecutorConfig {
            priority: 80,
            core: None,
            late_in_a_row_max: 100,
            budget_permille: 500,
            rt: RealTime::BestEffort,
        }
    }
}

impl CellConfig {
    /// Reads a cell's file and the robots' files that it names. `ports` holds the numbers chosen by the program that
    /// started the cell: every automatic port needs one; a fixed port is overridden by it.
    ///
    /// # Errors
    /// Returns all faults of all these files.
    pub fn load(path: &Path, ports: &BTreeMap<String, u16>) -> Result<CellConfig, Faults> {
        CellConfig::read(path, PortNumbers::Chosen(ports))
    }

    /// Like [`CellConfig::load`], for programs that open no port and only check or compile: automatic ports are 0.
    ///
    /// # Errors
    /// Returns all faults of all these files.
    pub fn load_offline(path: &Path) -> Result<CellConfig, Faults> {
        CellConfig::read(path, PortNumbers::Offline)
    }

    /// Parses the text of a cell's file; `file` is its name in diagnostics, `base` the folder at which relative paths
    /// start.
    ///
    /// # Errors
    /// Returns all faults of the text and of the files that it names.
    pub fn parse(
        text: &str,
        file: &str,
        base: &Path,
        ports: &BTreeMap<String, u16>,
    ) -> Result<CellConfig, Faults> {
        let (name, text) = (file.to_owned(), text.to_owned());
        read::cell(&SourceFile { name, text }, base, PortNumbers::Chosen(ports))
    }

    /// Like [`CellConfig::parse`], for programs that open no port and only check or compile: automatic ports are 0.
    ///
    /// # Errors
    /// Returns all faults of the text and of the files that it names.
    pub fn parse_offline(text: &str, file: &str, base: &Path) -> Result<CellConfig, Faults> {
        let (name, text) = (file.to_owned(), text.to_owned());
        read::cell(&SourceFile { name, text }, base, PortNumbers::Offline)
    }

    fn read(path: &Path, numbers: PortNumbers<'_>) -> Result<CellConfig, Faults> {
        let file = file::read(path)?;
        let base = path.parent().unwrap_or(Path::new(""));
        read::cell(&file, base, numbers)
    }

    /// Returns the time that all nets may use together in one cycle, ns.
    #[must_use]
    pub fn budget_ns(&self) -> u64 {
        // No overflow: a period is at most a second, the share at most 100000.
        self.period_ns * u64::from(self.executor.budget_permille) / 1000
    }

    /// Returns the device models of the core, in the order of their indices.
    #[must_use]
    pub fn models(&self) -> Vec<DeviceModel> {
        self.devices.iter().map(DeviceConfig::model).collect()
    }

    /// Returns index and configuration of the device with this name.
    #[must_use]
    pub fn device(&self, name: &str) -> Option<(usize, &DeviceConfig)> {
        self.devices
            .iter()
            .enumerate()
            .find(|(_, device)| device.name == name)
    }
}
