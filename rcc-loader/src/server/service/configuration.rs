//! Checks whether all processes of the cell were started with the same configuration, and whether its files have
//! changed since. Run by blocking threads of the server and by the maintenance thread.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

use rcc_api::codes;
use rcc_api::error::ApiError;
use rcc_config::{CellConfig, ConfigChange, DeviceConfig, DriverConfig, FileWatch};
use rcc_core::pose::Pose;
use rcc_protocol::announcement::EXECUTOR_LABEL;
use rcc_protocol::configuration::changed;
use rcc_protocol::events::{EventKind, event_text};
use rcc_protocol::{Announcement, Configuration, ProcessMismatch, Role};

use super::Service;
use crate::server::executor::ExecutorConnection;

/// Interval at which the configuration's files are checked.
const CHECK_EVERY: Duration = Duration::from_secs(1);
/// Placeholder for the driver of a device that this loader knows with another driver.
const UNKNOWN: &str = "?";

/// The files of the configuration; none are watched by default.
#[derive(Debug, Default)]
pub struct WatchedFiles {
    watch: Option<FileWatch>,
    checked_at: Option<Instant>,
}

impl Service {
    /// Watches the files of the configuration, which was loaded with these ports.
    #[must_use]
    pub fn with_file_watch(mut self, ports: BTreeMap<String, u16>) -> Service {
        let files = self.files.get_mut().unwrap_or_else(PoisonError::into_inner);
        files.watch = Some(FileWatch::new(self.config.clone(), ports));
        self
    }

    /// Checks the files of the configuration, and reports each change once.
    pub(super) fn check_files(&self) {
        let mut files = self.files.lock().unwrap_or_else(PoisonError::into_inner);
        let now = Instant::now();
        let is_due = |checked_at: Instant| now.duration_since(checked_at) >= CHECK_EVERY;
        if !files.checked_at.is_none_or(is_due) {
            return;
        }
        files.checked_at = Some(now);
        let Some(change) = files.watch.as_mut().and_then(FileWatch::poll) else {
            return;
        };
        let (differs, fault) = described(change);
        tracing::warn!("{}", changed(&differs, fault.as_deref()));
        self.record(EventKind::ConfigurationChanged { differs, fault });
    }

    /// Compares the configuration of an executor with ours when that incarnation is first seen. A difference is
    /// reported, and from then on only devices and channels with the same meaning in both are named.
    pub(super) fn check_configuration(&self, executor: &Announcement) {
        let is_known = |naming: &(u64, _)| naming.0 == executor.incarnation;
        if is_known(&self.naming.get()) {
            return;
        }
        let why = ProcessMismatch::about_cell(&self.own, executor);
        let config = match &why {
            None => self.config.clone(),
            Some(_) => common_configuration(&self.config, executor.configuration.as_ref()),
        };
        let is_first = self.naming.change(|naming| {
            let is_first = !is_known(naming);
            *naming = (executor.incarnation, Arc::new(config));
            is_first
        });
        if let Some(why) = why.filter(|_| is_first) {
            let remedy = why.remedy();
            tracing::warn!(
                "LOAD and START are refused: the executor was {}: {why}; {remedy}",
                why.description()
            );
            self.record(why.event(executor));
        }
    }

    /// As [`Service::check_configuration`], for an executor of another build, to which no connection is opened.
    pub(super) fn check_unopened_configuration(&self) {
        let announced = self
            .executor
            .cell()
            .announced(Role::Executor, EXECUTOR_LABEL);
        // If it is gone or unreadable meanwhile, the next check reports it.
        let announced = announced.ok().flatten();
        if let Some(executor) = announced.filter(|one| one.liveness().is_alive()) {
            self.check_configuration(&executor);
        }
    }

    /// Returns the configuration by which the executor's devices and channels are named.
    pub(super) fn naming_config(&self) -> Arc<CellConfig> {
        Arc::clone(&self.naming.get().1)
    }

    /// Refuses LOAD and START while loader and executor are of different builds or have different configurations,
    /// because a text could mean something else there.
    pub(super) fn require_agreement(&self, attached: &ExecutorConnection) -> Result<(), ApiError> {
        match ProcessMismatch::about_cell(&self.own, &attached.announcement) {
            None => Ok(()),
            Some(why @ ProcessMismatch::Build { .. }) => Err(ApiError::new(
                codes::OTHER_BUILD,
                format!(
                    "LOAD and START are refused: loader and executor were built from different versions ({why})"
                ),
                why.remedy(),
            )),
            Some(why) => Err(ApiError::new(
                codes::OTHER_CONFIGURATION,
                format!(
                    "LOAD and START are refused: loader and executor were started with different configurations ({why})"
                ),
                why.remedy(),
            )),
        }
    }

    /// Returns why the living driver of a device is not attached to the executor, if the reason is its build or
    /// configuration.
    pub(super) fn disagreement(&self, device: &str) -> Option<ProcessMismatch> {
        let (attached, _) = self.executor.attach().ok()?;
        let driver = self.executor.cell().announced(Role::Driver, device);
        let driver = driver.ok().flatten();
        let driver = driver.filter(|one| one.liveness().is_alive())?;
        ProcessMismatch::about_device(&driver, &attached.announcement, device)
    }

    /// Returns the problems of the configuration, one sentence each.
    pub(super) fn configuration_problems(
        &self,
        attached: &ExecutorConnection,
        processes: &[Announcement],
    ) -> Vec<String> {
        let mut problems = self.file_problems(processes);
        let executor = &attached.announcement;
        if let Some(why) = ProcessMismatch::about_cell(&self.own, executor) {
            problems.push(disagreement_sentence(
                "the loader refuses LOAD and START: it",
                &why,
            ));
        }
        for driver in processes
            .iter()
            .filter(|one| one.role == Role::Driver && one.liveness().is_alive())
        {
            if let Some(why) = ProcessMismatch::about_device(driver, executor, &driver.label) {
                let who = format!("the driver of {} is not attached: it", driver.label);
                problems.push(disagreement_sentence(&who, &why));
            }
        }
        problems
    }

    /// Returns sentences about changed files, and about processes that were started with another configuration than the
    /// files now contain.
    fn file_problems(&self, processes: &[Announcement]) -> Vec<String> {
        let files = self.files.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(watch) = files.watch.as_ref() else {
            return Vec::new();
        };
        let mut problems = Vec::new();
        if *watch.change() != ConfigChange::None {
            let (differs, fault) = described(watch.change());
            problems.push(changed(&differs, fault.as_deref()));
        }
        if let Some(disk) = watch.disk() {
            let disk = Configuration::new(disk.identity());
            let others = processes.iter().filter(|one| one.liveness().is_alive());
            let others = others.filter(|one| is_older(one, &disk));
            let names: Vec<String> = others.map(Announcement::who).collect();
            if !names.is_empty() {
                problems.push(format!(
                    "not started with the current content of the files: {}",
                    names.join(", ")
                ));
            }
        }
        problems
    }
}

/// Returns true if a process was started with another configuration than `disk`, as far as that process uses it.
fn is_older(process: &Announcement, disk: &Configuration) -> bool {
    let Some(own) = &process.configuration else {
        return false;
    };
    match process.role {
        Role::Driver => !own.device_differences(disk, &process.label).is_empty(),
        _ => !own.differences(disk).is_empty(),
    }
}

/// Returns a sentence about a process that does not fit the executor.
pub(super) fn disagreement_sentence(who: &str, why: &ProcessMismatch) -> String {
    let remedy = why.remedy();
    format!(
        "{who} was {} than the executor ({why}); {remedy}",
        why.description()
    )
}

/// Describes a change, shortened for the event log.
fn described(change: &ConfigChange) -> (String, Option<String>) {
    match change {
        ConfigChange::None => (String::new(), None),
        ConfigChange::Differs(differences) => (event_text(&differences.join("; ")), None),
        ConfigChange::Invalid(fault) => (String::new(), Some(event_text(fault))),
    }
}

/// Returns the part of our configuration that also holds for an executor with another one: the executor's devices in
/// its order, with what both define alike.
fn common_configuration(ours: &CellConfig, theirs: Option<&Configuration>) -> CellConfig {
    let mine = Configuration::new(ours.identity());
    let named = |theirs: &Configuration, name: &str| {
        let Some((_, known)) = ours.device(name) else {
            return unknown(name);
        };
        let differs = theirs.device_differences(&mine, name);
        let same = |part: &str| differs.iter().all(|one| one != part);
        let (driver, robot, channels) = (same("driver"), same("robot"), same("channels"));
        DeviceConfig {
            driver: if driver {
                known.driver.clone()
            } else {
                DriverConfig::Name(UNKNOWN.to_owned())
            },
            robot: known.robot.clone().filter(|_| robot),
            channels: if channels {
                known.channels.clone()
            } else {
                Vec::new()
            },
            ..known.clone()
        }
    };
    let devices = theirs.map(|theirs| {
        let names = theirs.devices.iter().map(|device| &device.name);
        names.map(|name| named(theirs, name)).collect()
    });
    CellConfig {
        devices: devices.unwrap_or_default(),
        ..ours.clone()
    }
}

/// A device of which only the name is known.
fn unknown(name: &str) -> DeviceConfig {
    DeviceConfig {
        name: name.to_owned(),
        driver: DriverConfig::Name(UNKNOWN.to_owned()),
        folder: PathBuf::new(),
        robot: None,
        settings: serde_json::Value::Null,
        channels: Vec::new(),
        first_tolerance_rad: 0.0,
        base: Pose::IDENTITY,
        workspace: None,
        command_timeout_ns: 0,
        delay_ns: 0,
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn cell(devices: &str) -> CellConfig {
        let text = format!("cell: a\nperiod: 1 ms\ndevices:\n{devices}");
        let cell = CellConfig::parse(&text, "a.yaml", Path::new(""), &BTreeMap::new());
        cell.unwrap_or_else(|faults| panic!("{faults}"))
    }

    #[test]
    fn only_devices_and_channels_with_the_same_meaning_in_both_configurations_are_named() {
        let torch = "{kind: digital output, address: 1, on_release: hold}";
        let ours = format!(
            "  one: {{driver: a, channels: {{torch: {torch}}}}}\n  two: {{driver: b, channels: {{torch: {torch}}}}}\n"
        );
        let theirs = format!(
            "  new: {{driver: c}}\n  two: {{driver: b, channels: {{torch: {torch}}}}}\n  \
             one: {{driver: d, channels: {{gas: {torch}}}}}\n"
        );
        let theirs = Configuration::new(cell(&theirs).identity());
        let named = common_configuration(&cell(&ours), Some(&theirs));
        let rows = named.devices.iter().map(|device| {
            let channels = device.channels.iter().map(|channel| channel.name.as_str());
            (
                device.name.as_str(),
                device.driver.to_string(),
                channels.collect(),
            )
        });
        let rows: Vec<(&str, String, Vec<&str>)> = rows.collect();
        let expected = [
            ("new", UNKNOWN.to_owned(), vec![]),
            ("two", "b".to_owned(), vec!["torch"]),
            ("one", UNKNOWN.to_owned(), vec![]),
        ];
        assert_eq!(rows, expected);
        assert!(common_configuration(&cell(&ours), None).devices.is_empty());
    }
}
