//! A cell's requirements on the machine: from its file, from a running cell, or the defaults. Run by the main thread.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use rcc_api::codes;
use rcc_config::cell::RealTime;
use rcc_config::ports::PortArgument;
use rcc_config::{CellConfig, ExecutorConfig, auto_ports};
use rcc_ipc::Cell;
use rcc_protocol::Announcement;

use crate::context::{Context, cell_failure};
use crate::failure::Failure;

/// Requirements on the machine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MachineRequirements {
    /// SCHED_FIFO priority of the executor.
    pub priority: u8,
    /// Core of the executor.
    pub core: Option<usize>,
    /// Period of the executor, ns.
    pub period_ns: u64,
    /// Age at which a measurement is stale, ns; `None` without a configuration.
    pub stale_after_ns: Option<u64>,
    /// True if the executor ends when SCHED_FIFO, locked memory or its core are refused (`rt: required`).
    pub required: bool,
    /// Where the requirements are configured.
    pub source: String,
}

impl Default for MachineRequirements {
    fn default() -> Self {
        let ExecutorConfig { priority, core, .. } = ExecutorConfig::default();
        MachineRequirements {
            priority,
            core,
            period_ns: 1_000_000,
            stale_after_ns: None,
            required: false,
            source: "defaults (select a cell's file with --cell)".to_owned(),
        }
    }
}

/// A configuration, and the cell that runs with it, if any.
#[derive(Clone, Debug)]
pub struct SelectedCell {
    /// Configuration; automatic ports are placeholders unless the cell runs.
    pub config: CellConfig,
    /// File of the configuration.
    pub path: PathBuf,
    /// Numbers of the automatic ports, from the running cell.
    pub ports: BTreeMap<String, u16>,
    /// The cell that runs with this configuration.
    pub cell: Option<Cell>,
}

impl MachineRequirements {
    /// Returns the requirements of a configuration.
    #[must_use]
    pub fn of(config: &CellConfig) -> MachineRequirements {
        MachineRequirements {
            priority: config.executor.priority,
            core: config.executor.core,
            period_ns: config.period_ns,
            stale_after_ns: Some(config.stale_after_ns),
            required: config.executor.rt == RealTime::Required,
            source: config.source.display().to_string(),
        }
    }
}

/// Returns the configuration selected by `--cell`: a file, or a running cell. Without `--cell`, the default cell if it
/// runs.
///
/// A dead cell has no configuration: `None`, so that its leftovers can be inspected.
///
/// # Errors
/// Fails if the file is invalid, or if no cell of that name exists, not even a dead one.
pub fn select(context: &Context) -> Result<Option<SelectedCell>, Failure> {
    match context.cell.as_deref() {
        Some(name) if is_file(name) => of_file(Path::new(name)).map(Some),
        Some(name) => match of_running(name)? {
            Some(running) => Ok(Some(running)),
            None if is_known(name) => Ok(None),
            None => Err(Failure::new(
                codes::NO_LOADER,
                format!("cell `{name}` not found"),
                "start it (`rcc-cli up FILE`), or select its file: --cell FILE.yaml",
            )),
        },
        None => of_running(context.cell_name()),
    }
}

fn is_known(name: &str) -> bool {
    Cell::find(name).is_ok_and(|cell| cell.is_some())
}

fn is_file(name: &str) -> bool {
    name.contains('/')
        || name.ends_with(".yaml")
        || name.ends_with(".yml")
        || name.ends_with(".json")
}

fn of_file(path: &Path) -> Result<SelectedCell, Failure> {
    let config = load(path, &BTreeMap::new())?;
    let running = of_running(&config.name).ok().flatten();
    let same = |chosen: &SelectedCell| chosen.path.canonicalize().ok() == path.canonicalize().ok();
    Ok(match running.filter(same) {
        Some(running) => running,
        None => SelectedCell {
            config,
            path: path.to_owned(),
            ports: BTreeMap::new(),
            cell: None,
        },
    })
}

fn of_running(name: &str) -> Result<Option<SelectedCell>, Failure> {
    let Some(cell) = Cell::find(name).map_err(|error| cell_failure(&error))? else {
        return Ok(None);
    };
    let announced = cell.announced_all().unwrap_or_default();
    let living = announced
        .iter()
        .filter(|announced| announced.liveness().is_alive());
    let Some((path, ports)) = living.filter_map(arguments_of).next() else {
        return Ok(None);
    };
    Ok(Some(SelectedCell {
        config: load(&path, &ports)?,
        path,
        ports,
        cell: Some(cell),
    }))
}

/// Reads the configuration from a process of the cell, which was started with `--config FILE` and its ports; the
/// automatic ports are known nowhere else.
fn arguments_of(announced: &Announcement) -> Option<(PathBuf, BTreeMap<String, u16>)> {
    let read = |file: &str| fs::read(format!("/proc/{}/{file}", announced.pid)).ok();
    configuration_in(&read("cmdline")?).or_else(|| configuration_of(&read("environ")?))
}

fn configuration_in(command_line: &[u8]) -> Option<(PathBuf, BTreeMap<String, u16>)> {
    let arguments: Vec<&str> = command_line
        .split(|byte| *byte == 0)
        .filter_map(|word| std::str::from_utf8(word).ok())
        .collect();
    let mut path = None;
    let mut ports = BTreeMap::new();
    for (index, word) in arguments.iter().enumerate() {
        let (key, value) = match word.split_once('=') {
            Some((key, value)) if key.starts_with("--") => (key, Some(value)),
            _ => (*word, arguments.get(index + 1).copied()),
        };
        match (key, value) {
            ("--config", Some(value)) => path = Some(PathBuf::from(value)),
            ("--port", Some(value)) => {
                if let Ok(PortArgument { name, number }) = value.parse() {
                    ports.insert(name, number);
                }
            }
            _ => {}
        }
    }
    Some((path?, ports))
}

/// Services receive it through their environment.
fn configuration_of(environment: &[u8]) -> Option<(PathBuf, BTreeMap<String, u16>)> {
    let variable = |name: &str| {
        let mut all = environment.split(|byte| *byte == 0);
        all.find_map(|one| std::str::from_utf8(one).ok()?.strip_prefix(name))
    };
    let ports = variable("RCC_PORTS=").unwrap_or_default().split(',');
    let ports = ports.filter_map(|port| port.parse::<PortArgument>().ok());
    let ports = ports
        .map(|PortArgument { name, number }| (name, number))
        .collect();
    Some((PathBuf::from(variable("RCC_CONFIG=")?), ports))
}

fn load(path: &Path, chosen: &BTreeMap<String, u16>) -> Result<CellConfig, Failure> {
    let invalid = |faults| Failure::from_faults("invalid configuration", &faults);
    let mut ports: BTreeMap<String, u16> = auto_ports(path)
        .map_err(invalid)?
        .into_iter()
        // A placeholder: only the running cell knows the real number.
        .map(|(name, _)| (name, 1))
        .collect();
    ports.extend(chosen.iter().map(|(name, number)| (name.clone(), *number)));
    CellConfig::load(path, &ports).map_err(invalid)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn file_and_ports_are_read_from_a_command_line() {
        let line = b"/bin/rcc-driver\0--cell\0demo\0--config\0/a/cell.yaml\0--port\0fri=4711\0--port=io=5\0--device\0lwr\0";
        let (path, ports) = configuration_in(line).unwrap_or_default();
        assert_eq!(path, Path::new("/a/cell.yaml"));
        assert_eq!(
            ports,
            BTreeMap::from([("fri".to_owned(), 4711), ("io".to_owned(), 5)])
        );
        assert_eq!(configuration_in(b"sh\0-c\0x\0"), None);
        let environment = b"HOME=/\0RCC_CONFIG=/etc/rcc/cell.yaml\0RCC_PORTS=fri=4711\0";
        let (path, ports) = configuration_of(environment).unwrap_or_default();
        assert_eq!(
            (path, ports.get("fri")),
            (PathBuf::from("/etc/rcc/cell.yaml"), Some(&4711))
        );
    }

    #[test]
    fn arguments_that_look_like_paths_are_files() {
        for (name, file) in [
            ("demo", false),
            ("./demo", true),
            ("cell.yaml", true),
            ("a/b", true),
        ] {
            assert_eq!(is_file(name), file, "{name}");
        }
    }
}
