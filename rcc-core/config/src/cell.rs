//! A cell as its file describes it: timing, devices, simulators and ports, checked as a whole.
//! Read once at start-up by every process that works with the cell; never by the real-time thread.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use rcc_core::frame::DeviceModel;

use crate::access::AccessConfig;
use crate::device::DeviceConfig;
use crate::diagnostic::Faults;
use crate::file::{self, SourceFile};
use crate::ports::PortNumbers;
use crate::recorder::RecorderConfig;

mod clock;
mod read;

/// Everything that the processes of one cell must agree on.
#[derive(Clone, Debug, PartialEq)]
pub struct CellConfig {
    /// Name of the cell; `[a-z0-9][a-z0-9_-]{0,31}`.
    pub name: String,
    /// Period of the executor, ns.
    pub period_ns: u64,
    /// A measurement older than this is stale, and the ports of its device are null; ns.
    pub stale_after_ns: u64,
    /// The device that the executor's clock follows, `None` = it has its own.
    pub clock: Option<ClockConfig>,
    /// The real-time thread.
    pub executor: ExecutorConfig,
    /// The flight recorder.
    pub recorder: RecorderConfig,
    /// What supervisors do with processes that die or hang.
    pub supervision: SupervisionConfig,
    /// Who may use the cell beside the user that runs it.
    pub access: AccessConfig,
    /// At most 16, in the order of the file: the place is the device's index in plans.
    pub devices: Vec<DeviceConfig>,
    /// Robot-side programs that `up` starts; none in production.
    pub simulators: Vec<SimulatorConfig>,
    /// Every port of the file by its name, with the numbers that hold in this run.
    pub ports: BTreeMap<String, u16>,
    /// The file.
    pub source: PathBuf,
}

/// A clock that follows a device: each cycle begins a fixed time after a packet of the device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClockConfig {
    /// Index of the device.
    pub device: usize,
    /// How long after the packet a cycle begins, ns; at most half of the period.
    pub offset_ns: u64,
}

/// How the executor's real-time thread runs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExecutorConfig {
    /// SCHED_FIFO priority, 1 to 99.
    pub priority: u8,
    /// The core that it is bound to, `None` = the system chooses.
    pub core: Option<usize>,
    /// After this many late cycles in a row the most expensive net ends; 0 = never.
    pub late_in_a_row_max: u32,
    /// What nets may need of a cycle together, in thousandths of the period; more than 1000 admits what is too much.
    pub budget_permille: u32,
    /// What becomes of an executor that is not real-time.
    pub rt: RealTime,
}

/// What becomes of an executor that the system does not let be real-time: SCHED_FIFO, locked memory, and its core if
/// one is configured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RealTime {
    /// It runs, and says what it lacks.
    BestEffort,
    /// It ends.
    Required,
}

/// What supervisors (`rcc-cli up`, systemd) do with processes that die or hang.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SupervisionConfig {
    /// A process that dies is started again so many times …
    pub restarts: u32,
    /// … within this time, ns; one more death and it has failed for good.
    pub within_ns: u64,
    /// How long a process that was asked to end may take before it is killed, ns.
    pub stop_timeout_ns: u64,
    /// How long a process may make no progress before it is killed and started again, ns.
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

/// A program that plays a device's part.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SimulatorConfig {
    /// Name, unique among the simulators of its cell.
    pub name: String,
    /// The program: a name beside our own programs, or a path.
    pub program: String,
    /// Its arguments; `${port}` is already replaced. With `device`, whoever starts it adds `--control`: its control port.
    pub arguments: Vec<String>,
    /// The device whose part it plays.
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
    /// Reads a cell's file and the robots' files that it names. `ports` are the numbers that the program which started
    /// the cell has chosen: every automatic port needs one; a fixed port takes it instead of its own.
    ///
    /// # Errors
    /// All faults of all these files.
    pub fn load(path: &Path, ports: &BTreeMap<String, u16>) -> Result<CellConfig, Faults> {
        CellConfig::read(path, PortNumbers::Chosen(ports))
    }

    /// As [`CellConfig::load`], for those who open no port and only check or compile: automatic ports are 0.
    ///
    /// # Errors
    /// All faults of all these files.
    pub fn load_offline(path: &Path) -> Result<CellConfig, Faults> {
        CellConfig::read(path, PortNumbers::Offline)
    }

    /// Reads a cell's text; `file` is its name for people, `base` the folder that paths in it begin at.
    ///
    /// # Errors
    /// All faults of the text and of the files that it names.
    pub fn parse(
        text: &str,
        file: &str,
        base: &Path,
        ports: &BTreeMap<String, u16>,
    ) -> Result<CellConfig, Faults> {
        let (name, text) = (file.to_owned(), text.to_owned());
        read::cell(&SourceFile { name, text }, base, PortNumbers::Chosen(ports))
    }

    fn read(path: &Path, numbers: PortNumbers<'_>) -> Result<CellConfig, Faults> {
        let file = file::read(path)?;
        let base = path.parent().unwrap_or(Path::new(""));
        read::cell(&file, base, numbers)
    }

    /// What nets may need together in one cycle, ns.
    #[must_use]
    pub fn budget_ns(&self) -> u64 {
        // No overflow: a period is at most a second, the share at most 100000.
        self.period_ns * u64::from(self.executor.budget_permille) / 1000
    }

    /// The devices as the core knows them, in order of their index.
    #[must_use]
    pub fn models(&self) -> Vec<DeviceModel> {
        self.devices.iter().map(DeviceConfig::model).collect()
    }

    /// Index and configuration of the device of this name.
    #[must_use]
    pub fn device(&self, name: &str) -> Option<(usize, &DeviceConfig)> {
        self.devices
            .iter()
            .enumerate()
            .find(|(_, device)| device.name == name)
    }
}
