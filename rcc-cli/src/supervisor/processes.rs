//! Which processes a cell consists of, with their programs and arguments.
//! Pure but for looking where the programs are; used by the main thread.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

use rcc_config::{CellConfig, auto_ports, free_port};
use rcc_ipc::cell;
use rcc_loader::server::codes;
use rcc_process::oom;

use super::paths;
use crate::context::of_cell;
use crate::failure::Failure;

/// A driver's SCHED_FIFO priority, where it is granted, is this much below the executor's.
const BELOW_EXECUTOR: u8 = 10;

/// What a process is in its cell. At the end they stop in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum ProcessKind {
    /// The cycle.
    Executor,
    /// REST.
    Loader,
    /// One device; it brings the device to rest when the executor is gone.
    Driver,
    /// A robot-side program.
    Simulator,
}

impl ProcessKind {
    /// All, in the order in which they stop.
    pub const ALL: [ProcessKind; 4] = [
        ProcessKind::Executor,
        ProcessKind::Loader,
        ProcessKind::Driver,
        ProcessKind::Simulator,
    ];
}

/// What the loader's memory is asked with: what a long text took goes back to the system (mallopt(3)).
pub const LOADER_ENVIRONMENT: [(&str, &str); 3] = [
    ("MALLOC_ARENA_MAX", "2"),
    ("MALLOC_TRIM_THRESHOLD_", "131072"),
    ("MALLOC_MMAP_THRESHOLD_", "131072"),
];

impl ProcessKind {
    /// How gladly the kernel ends it when memory runs out.
    #[must_use]
    pub fn oom_score(self) -> i32 {
        match self {
            ProcessKind::Executor | ProcessKind::Driver => oom::SCORE_ROBOT,
            ProcessKind::Loader => oom::SCORE_RESTARTABLE,
            ProcessKind::Simulator => oom::SCORE_OBSERVER,
        }
    }
}

/// How one tells that a process is ready.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ReadySignal {
    /// It says so to its supervisor, as to systemd.
    Notified,
    /// It wrote a line.
    Line,
}

/// One process of a cell.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ProcessSpec {
    /// What it is.
    pub kind: ProcessKind,
    /// For people and for the name of its log: `executor`, `driver-lwr`.
    pub name: String,
    /// Its program.
    pub program: PathBuf,
    /// Its arguments.
    pub arguments: Vec<OsString>,
    /// How one tells that it is ready.
    pub ready: ReadySignal,
}

/// A configuration with the ports of this run.
#[derive(Clone, Debug)]
pub struct PreparedCell {
    /// The configuration.
    pub config: CellConfig,
    /// Its file, absolute.
    pub path: PathBuf,
    /// Ports that were chosen now.
    pub ports: BTreeMap<String, u16>,
}

/// Reads a configuration and chooses its automatic ports.
///
/// # Errors
/// Every fault of the configuration, or no free port.
pub fn prepare(path: &Path) -> Result<PreparedCell, Failure> {
    let name = path.display().to_string();
    let path = path
        .canonicalize()
        .map_err(|error| Failure::unreadable(&name, &error))?;
    let invalid = |faults| Failure::of_faults("the configuration is not valid", &faults);
    let mut ports = BTreeMap::new();
    for (name, protocol) in auto_ports(&path).map_err(invalid)? {
        let port = free_port(protocol).map_err(|error| {
            Failure::new(
                codes::PROCESS_FAILED,
                format!("no free port for `{name}`: {error}"),
                "close programs that occupy many ports on 127.0.0.1",
            )
        })?;
        ports.insert(name, port);
    }
    let config = CellConfig::load(&path, &ports).map_err(invalid)?;
    Ok(PreparedCell {
        config,
        path,
        ports,
    })
}

/// A driver's SCHED_FIFO priority: below the executor's, above everything ordinary, because a driver that is late costs
/// the robot's connection.
#[must_use]
pub fn driver_priority(executor: u8) -> u8 {
    executor.saturating_sub(BELOW_EXECUTOR).max(1)
}

/// The processes of a cell, in the order in which they are started.
///
/// # Errors
/// A program is not there, or the path of a control port is too long.
pub fn specs(name: &str, prepared: &PreparedCell) -> Result<Vec<ProcessSpec>, Failure> {
    let mut common: Vec<OsString> = vec!["--cell".into(), name.into(), "--config".into()];
    common.push(prepared.path.clone().into());
    for (port, number) in &prepared.ports {
        common.extend(["--port".into(), format!("{port}={number}").into()]);
    }
    common.push("--parent-death".into());
    let mut all = Vec::new();
    for simulator in &prepared.config.simulators {
        let mut arguments: Vec<OsString> = simulator.arguments.iter().map(Into::into).collect();
        if simulator.device.is_some() {
            let socket = cell::simulator_socket(&cell::base_dir().join(name), &simulator.name);
            cell::check_socket_path(&socket).map_err(|error| of_cell(&error))?;
            let mut argument = OsString::from("--control=");
            argument.push(socket);
            arguments.push(argument);
        }
        all.push(ProcessSpec {
            kind: ProcessKind::Simulator,
            name: format!("simulator/{}", simulator.name),
            program: paths::program(&simulator.program)?,
            arguments,
            ready: ReadySignal::Line,
        });
    }
    all.push(ProcessSpec {
        kind: ProcessKind::Executor,
        name: "executor".to_owned(),
        program: paths::program("rcc-exec")?,
        arguments: common.clone(),
        ready: ReadySignal::Notified,
    });
    all.push(ProcessSpec {
        kind: ProcessKind::Loader,
        name: "loader".to_owned(),
        program: paths::program("rcc-loader")?,
        arguments: common.clone(),
        ready: ReadySignal::Notified,
    });
    for device in &prepared.config.devices {
        let mut arguments = common.clone();
        arguments.extend(["--device".into(), device.name.as_str().into()]);
        let priority = driver_priority(prepared.config.executor.priority);
        arguments.extend(["--priority".into(), priority.to_string().into()]);
        all.push(ProcessSpec {
            kind: ProcessKind::Driver,
            name: format!("driver/{}", device.name),
            program: paths::program("rcc-driver")?,
            arguments,
            ready: ReadySignal::Notified,
        });
    }
    Ok(all)
}
