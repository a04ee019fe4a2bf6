//! systemd units of a cell: the units common to all cells, and drop-ins generated from the cell's configuration. Pure
//! apart from [`disk`]; used by the main thread of `install-units`.

pub mod addresses;
pub mod cores;
pub mod disk;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use rcc_config::cell::SupervisionConfig;
use rcc_config::{AccessConfig, CellConfig, DeviceConfig, DriverConfig, DriverNeed};

use crate::supervisor::processes;
use cores::Cores;

/// First characters of every file written by RCC; only such files are replaced or removed.
pub const MARK: &str = "# RCC:";
/// Folder of the administrator's units.
pub const UNITS: &str = "etc/systemd/system";
/// Folder of packaged units.
pub const PACKAGED: &str = "usr/lib/systemd/system";
/// Name of the drop-in in each folder.
pub const DROP_IN: &str = "50-cell.conf";
/// Folder of packaged programs, as named in the shipped units.
pub const PROGRAMS: &str = "/usr/bin";
/// Runtime folder of the cells, as named in the shipped units (`RCC_RUNTIME_DIR`).
const RUNTIME: &str = "/run/rcc";
/// Time for the executor's nets to end after CANCEL, ms (as in `rcc_exec::rt`).
const NETS_END_MS: u64 = 5000;

macro_rules! shipped {
    ($($path:literal = $file:literal;)*) => {
        /// Files common to all cells: destination below the root, and content.
        pub const SHIPPED: &[(&str, &str)] = &[
            $(($path, include_str!(concat!("../../configs/systemd/", $file)))),*
        ];
    };
}

shipped! {
    "etc/systemd/system/rcc.target" = "rcc.target";
    "etc/systemd/system/rcc@.target" = "rcc@.target";
    "etc/systemd/system/rcc.slice" = "rcc.slice";
    "etc/systemd/system/rcc-rt-setup.service" = "rcc-rt-setup.service";
    "etc/systemd/system/rcc-executor@.service" = "rcc-executor@.service";
    "etc/systemd/system/rcc-loader@.service" = "rcc-loader@.service";
    "etc/systemd/system/rcc-driver@.service" = "rcc-driver@.service";
    "etc/systemd/system/rcc-simulator@.service" = "rcc-simulator@.service";
    "etc/sysusers.d/rcc.conf" = "sysusers.conf";
    "etc/tmpfiles.d/rcc.conf" = "tmpfiles.conf";
    "etc/security/limits.d/rcc.conf" = "limits.conf";
}

/// A file to be written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnitFile {
    /// Path below the root.
    pub path: PathBuf,
    /// Content.
    pub text: String,
}

/// Units of one cell.
#[derive(Clone, Copy, Debug)]
pub struct CellUnits<'a> {
    /// Name of the cell.
    pub cell: &'a str,
    /// Configuration of the cell.
    pub config: &'a CellConfig,
    /// File of the configuration, absolute.
    pub path: &'a Path,
    /// Numbers of its automatic ports.
    pub ports: &'a BTreeMap<String, u16>,
    /// Cores for everything but the cycle.
    pub cores: Option<&'a Cores>,
    /// Folder of the programs.
    pub programs: &'a Path,
    /// Whether simulators get units as well.
    pub simulators: bool,
}

/// Returns the files of [`SHIPPED`] for programs in this folder.
#[must_use]
pub fn shipped(programs: &Path) -> Vec<UnitFile> {
    let programs = programs.display().to_string();
    let file = |(path, text): &(&str, &str)| UnitFile {
        path: PathBuf::from(path),
        text: text.replace("/usr/bin/rcc-", &format!("{programs}/rcc-")),
    };
    SHIPPED.iter().map(file).collect()
}

impl CellUnits<'_> {
    /// Returns the drop-ins of the cell.
    #[must_use]
    pub fn drop_ins(&self) -> Vec<UnitFile> {
        let mut all = vec![self.target(), self.executor(), self.loader(), self.setup()];
        all.extend(self.config.devices.iter().map(|device| self.driver(device)));
        if self.simulators {
            let simulators = self.config.simulators.iter();
            all.extend(simulators.map(|simulator| self.simulator(simulator)));
        }
        all
    }

    /// Returns the names of the drivers' units, and of the simulators' units if requested.
    #[must_use]
    pub fn unit_names(&self) -> Vec<String> {
        let cell = self.cell;
        let drivers = self.config.devices.iter();
        let drivers = drivers.map(|device| format!("rcc-driver@{cell}.{}.service", device.name));
        let asked = self.config.simulators.iter().filter(|_| self.simulators);
        let simulators = asked.map(|one| format!("rcc-simulator@{cell}.{}.service", one.name));
        drivers.chain(simulators).collect()
    }

    fn file(&self, unit: &str, text: &str) -> UnitFile {
        let config = self.path.display();
        let head = format!(
            "{MARK} written by `rcc-cli install-units {config}`; do not edit; run it again after changing that file.\n"
        );
        UnitFile {
            path: Path::new(UNITS).join(format!("{unit}.d")).join(DROP_IN),
            text: head + text,
        }
    }

    fn target(&self) -> UnitFile {
        let wants = self.unit_names().join(" ");
        let unit = format!("rcc@{}.target", self.cell);
        self.file(&unit, &format!("[Unit]\nWants={wants}\n"))
    }

    fn executor(&self) -> UnitFile {
        let executor = &self.config.executor;
        let service = format!(
            "{}{}LimitRTPRIO={}\n{}{}",
            self.environment(""),
            times(&self.config.supervision, NETS_END_MS),
            executor.priority,
            self.affinity(),
            self.state_folder(),
        );
        let unit = format!("rcc-executor@{}.service", self.cell);
        self.file(
            &unit,
            &(limits(&self.config.supervision) + "\n[Service]\n" + &service),
        )
    }

    fn loader(&self) -> UnitFile {
        let service = format!(
            "{}{}{}{}{}",
            self.environment(""),
            times(&self.config.supervision, 0),
            self.affinity(),
            self.state_folder(),
            listeners(&self.config.access),
        );
        let unit = format!("rcc-loader@{}.service", self.cell);
        let text = limits(&self.config.supervision) + "\n[Service]\n" + &service;
        self.file(&unit, &text)
    }

    fn driver(&self, device: &DeviceConfig) -> UnitFile {
        let cell = self.cell;
        let priority = processes::driver_priority(self.config.executor.priority);
        let more = format!(
            " \"RCC_CELL={cell}\" \"RCC_DEVICE={}\" \"RCC_PRIORITY={priority}\"",
            device.name
        );
        let simulators = self.config.simulators.iter().filter(|_| self.simulators);
        let simulators: String = simulators
            .map(|one| format!(" rcc-simulator@{cell}.{}.service", one.name))
            .collect();
        let order = format!(
            "PartOf=rcc@{cell}.target\n# Started before the executor, so stopped after it: the device is brought to rest.\n\
             Before=rcc-executor@{cell}.service\n{}",
            if simulators.is_empty() {
                String::new()
            } else {
                format!("After={}\n", simulators.trim())
            }
        );
        let service = format!(
            "{}{}LimitRTPRIO={priority}\n{}{}{}",
            self.environment(&more),
            times(&self.config.supervision, 0),
            self.affinity(),
            self.state_folder(),
            addresses::allowed(&device.settings),
        ) + &self.own_program(device);
        let unit = format!("rcc-driver@{cell}.{}.service", device.name);
        self.file(
            &unit,
            &(limits(&self.config.supervision) + &order + "\n[Service]\n" + &service),
        )
    }

    /// Starts the program that the configuration names, with what it needs and no more.
    fn own_program(&self, device: &DeviceConfig) -> String {
        let (program, arguments) = match (&device.driver, device.driver.own_program()) {
            (DriverConfig::Program(own), _) => {
                let path = own.path(&device.folder);
                let path = path.unwrap_or_else(|| self.programs.join(&own.program));
                (path, own.arguments.as_slice())
            }
            (DriverConfig::Name(_), Some(own)) => (self.programs.join(own.program), &[][..]),
            (DriverConfig::Name(_), None) => return String::new(),
        };
        let arguments = arguments.iter().map(|one| format!(" {}", argument(one)));
        let start = quoted(&program.display().to_string()) + &arguments.collect::<String>();
        let needs: String = device.driver.needs().iter().map(permitted).collect();
        format!("ExecStart=\nExecStart={start}\n{needs}")
    }

    fn simulator(&self, simulator: &rcc_config::cell::SimulatorConfig) -> UnitFile {
        let cell = self.cell;
        let program = match simulator.program.contains('/') {
            true => PathBuf::from(&simulator.program),
            false => self.programs.join(&simulator.program),
        };
        let arguments = simulator
            .arguments
            .iter()
            .filter(|one| *one != "--parent-death");
        let mut arguments: String = arguments.map(|one| format!(" {}", argument(one))).collect();
        if simulator.device.is_some() {
            let folder = Path::new(RUNTIME).join(cell);
            let socket = rcc_ipc::cell::simulator_socket(&folder, &simulator.name);
            let option = format!("--control={}", socket.display());
            arguments += &format!(" {}", argument(&option));
        }
        let text = format!(
            "{}PartOf=rcc@{cell}.target\n\n[Service]\nExecStart={}{arguments}\n{}",
            limits(&self.config.supervision),
            quoted(&program.display().to_string()),
            self.affinity(),
        );
        self.file(
            &format!("rcc-simulator@{cell}.{}.service", simulator.name),
            &text,
        )
    }

    /// Names the core of the cycle, from which interrupts are kept away. One drop-in per cell, so that several cells
    /// add up.
    fn setup(&self) -> UnitFile {
        let name = format!("50-cell-{}.conf", self.cell);
        let cores = self
            .config
            .executor
            .core
            .map_or(String::new(), |core| core.to_string());
        let variable = self.cell.replace('-', "_").to_uppercase();
        let text = format!("[Service]\nEnvironment=RCC_RT_CORES_{variable}={cores}\n");
        let mut file = self.file("rcc-rt-setup.service", &text);
        file.path.set_file_name(name);
        file
    }

    fn environment(&self, more: &str) -> String {
        let path = quoted(&format!("RCC_CONFIG={}", self.path.display()));
        let ports: Vec<String> = self
            .ports
            .iter()
            .map(|(name, port)| format!("{name}={port}"))
            .collect();
        let ports = match ports.is_empty() {
            true => String::new(),
            false => format!(" \"RCC_PORTS={}\"", ports.join(",")),
        };
        format!("Environment={path}{more}{ports}\n")
    }

    /// Makes the folder that the configuration names for event log and incidents writable.
    fn state_folder(&self) -> String {
        let folder = self.config.recorder.folder.as_ref();
        folder.map_or(String::new(), |folder| {
            // If it does not exist, the programs say so, with the remedy.
            let path = quoted(&format!("-{}", folder.display()));
            format!("ReadWritePaths={path}\n")
        })
    }

    fn affinity(&self) -> String {
        self.cores.map_or(String::new(), |cores| {
            format!("# Housekeeping cores.\nCPUAffinity={cores}\n")
        })
    }
}

/// Sets the restart limits; systemd counts the first start as well.
fn limits(supervision: &SupervisionConfig) -> String {
    let SupervisionConfig {
        restarts,
        within_ns,
        ..
    } = supervision;
    format!(
        "[Unit]\nStartLimitIntervalSec={}ms\nStartLimitBurst={}\n",
        within_ns / 1_000_000,
        restarts + 1
    )
}

/// Returns the lines that permit what a driver needs.
fn permitted(need: &DriverNeed) -> String {
    match need {
        DriverNeed::RawNetwork => "AmbientCapabilities=CAP_NET_RAW\nCapabilityBoundingSet=CAP_NET_RAW\nRestrictAddressFamilies=AF_PACKET\n".to_owned(),
        DriverNeed::DeviceFile(path) => {
            format!("PrivateDevices=no\nDevicePolicy=closed\nDeviceAllow={path} rw\n")
        }
    }
}

/// Returns the permissions that the loader needs for its configured listeners.
fn listeners(access: &AccessConfig) -> String {
    let group = access.group.as_ref();
    let group = group.map_or(String::new(), |group| {
        format!("# The loader gives its socket to this group.\nSupplementaryGroups={group}\n")
    });
    let Some(tcp) = &access.tcp else {
        return group;
    };
    let from = match tcp.listen.ip().is_loopback() {
        true => "localhost",
        false => "any",
    };
    format!("{group}RestrictAddressFamilies=AF_INET AF_INET6\nIPAddressAllow={from}\n")
}

fn times(supervision: &SupervisionConfig, more_ms: u64) -> String {
    format!(
        "WatchdogSec={}ms\nTimeoutStopSec={}ms\n",
        supervision.watchdog_ns / 1_000_000,
        supervision.stop_timeout_ns / 1_000_000 + more_ms
    )
}

/// Quotes a word for a unit file, with any content: a value of `Environment=` or `ReadWritePaths=`, or the program of
/// `ExecStart=`. In none of these systemd expands `$`.
fn quoted(word: &str) -> String {
    let word = word.replace('\\', "\\\\").replace('"', "\\\"");
    format!("\"{}\"", word.replace('%', "%%"))
}

/// Quotes an argument of the program of `ExecStart=`, in which systemd expands `$`.
fn argument(word: &str) -> String {
    quoted(word).replace('$', "$$")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_shipped_file_has_the_mark() {
        for (path, text) in SHIPPED {
            assert!(text.starts_with(MARK), "{path}");
        }
    }

    #[test]
    fn no_unit_makes_a_whole_process_real_time_or_binds_executor_and_drivers() {
        for (path, text) in SHIPPED {
            for line in text.lines().filter(|line| !line.starts_with('#')) {
                for never in [
                    "CPUSchedulingPolicy",
                    "BindsTo",
                    "Requires=",
                    "AllowedCPUs",
                    "CPUWeight",
                ] {
                    assert!(!line.starts_with(never), "{path}: {line}");
                }
            }
        }
    }

    #[test]
    fn when_memory_runs_out_units_go_in_the_same_order_as_under_up() {
        for (unit, stage) in [
            ("executor", processes::ProcessKind::Executor),
            ("driver", processes::ProcessKind::Driver),
            ("loader", processes::ProcessKind::Loader),
            ("simulator", processes::ProcessKind::Simulator),
        ] {
            let path = format!("etc/systemd/system/rcc-{unit}@.service");
            let found = SHIPPED.iter().find(|(name, _)| *name == path);
            let lines = found.map_or("", |(_, text)| *text).lines();
            let score = lines.filter_map(|line| line.strip_prefix("OOMScoreAdjust="));
            assert_eq!(
                score.collect::<Vec<_>>(),
                [stage.oom_score().to_string()],
                "{unit}"
            );
        }
    }

    #[test]
    fn words_are_quoted_for_units() {
        assert_eq!(quoted("a b%c$d\"e\\f"), r#""a b%%c$d\"e\\f""#);
        assert_eq!(argument("a b%c$d\"e\\f"), r#""a b%%c$$d\"e\\f""#);
    }
}
