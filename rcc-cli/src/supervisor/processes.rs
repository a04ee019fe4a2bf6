//! The processes of a cell with their programs and arguments. Pure apart from locating the programs; used by the main
//! thread.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

use rcc_api::codes;
use rcc_config::{CellConfig, DriverConfig, auto_ports, free_port};
use rcc_ipc::cell;
use rcc_process::oom;

use super::paths;
use crate::context::cell_failure;
use crate::failure::Failure;

/// Difference between the SCHED_FIFO priorities of the executor and of the drivers.
const BELOW_EXECUTOR: u8 = 10;

/// Kind of a process of a cell; processes are stopped in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum ProcessKind {
    /// Runs the cycle.
    Executor,
    /// Serves REST and compiles nets.
    Loader,
    /// Drives one device; brings it to rest when the executor is gone.
    Driver,
    /// Simulates a device.
    Simulator,
}

impl ProcessKind {
    /// All kinds, in the order in which they are stopped.
    pub const ALL: [ProcessKind; 4] = [
        ProcessKind::Executor,
        ProcessKind::Loader,
        ProcessKind::Driver,
        ProcessKind::Simulator,
    ];

    /// Returns the OOM score adjustment: how readily the kernel kills it when memory runs out.
    #[must_use]
    pub fn oom_score(self) -> i32 {
        match self {
            ProcessKind::Executor | ProcessKind::Driver => oom::SCORE_ROBOT,
            ProcessKind::Loader => oom::SCORE_RESTARTABLE,
            ProcessKind::Simulator => oom::SCORE_OBSERVER,
        }
    }
}

/// How a process signals that it is ready.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ReadySignal {
    /// By a notification to its supervisor, as to systemd.
    Notified,
    /// By writing a line.
    Line,
}

/// One process of a cell.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ProcessSpec {
    /// Kind.
    pub kind: ProcessKind,
    /// Name in messages and of its log: `executor`, `driver/lwr`.
    pub name: String,
    /// Program.
    pub program: PathBuf,
    /// Arguments.
    pub arguments: Vec<OsString>,
    /// How it signals that it is ready.
    pub ready: ReadySignal,
}

/// A configuration with the ports of this run.
#[derive(Clone, Debug)]
pub struct PreparedCell {
    /// Configuration.
    pub config: CellConfig,
    /// Its file, absolute.
    pub path: PathBuf,
    /// Numbers of the automatic ports.
    pub ports: BTreeMap<String, u16>,
}

/// Reads a configuration and chooses its automatic ports.
///
/// # Errors
/// Fails with all faults of the configuration, or if no port is free.
pub fn prepare(path: &Path) -> Result<PreparedCell, Failure> {
    let name = path.display().to_string();
    let path = path
        .canonicalize()
        .map_err(|error| Failure::unreadable(&name, &error))?;
    let invalid = |faults| Failure::from_faults("invalid configuration", &faults);
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

/// Returns a driver's SCHED_FIFO priority: below the executor's, but above ordinary threads, because a late driver
/// costs the robot's connection.
#[must_use]
pub fn driver_priority(executor: u8) -> u8 {
    executor.saturating_sub(BELOW_EXECUTOR).max(1)
}

/// Returns the processes of a cell, in the order in which they are started.
///
/// # Errors
/// Fails if a program is missing or if the path of a control port is too long.
pub fn process_specs(name: &str, prepared: &PreparedCell) -> Result<Vec<ProcessSpec>, Failure> {
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
            cell::check_socket_path(&socket).map_err(|error| cell_failure(&error))?;
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
        let mut arguments: Vec<OsString> = match &device.driver {
            DriverConfig::Name(_) => Vec::new(),
            DriverConfig::Program(own) => own.arguments.iter().map(Into::into).collect(),
        };
        arguments.extend(common.clone());
        arguments.extend(["--device".into(), device.name.as_str().into()]);
        let priority = driver_priority(prepared.config.executor.priority);
        arguments.extend(["--priority".into(), priority.to_string().into()]);
        all.push(ProcessSpec {
            kind: ProcessKind::Driver,
            name: format!("driver/{}", device.name),
            program: paths::driver(device)?,
            arguments,
            ready: ReadySignal::Notified,
        });
    }
    Ok(all)
}
