//! The configuration that a process announces, so that other processes notice a different one. Written at start-up;
//! compared by threads that are not real-time.

use std::collections::BTreeMap;
use std::fmt;

use crate::announcement::Announcement;
use crate::build;
use crate::events::{self, EventKind};

/// A configuration, as far as processes compare it.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Configuration {
    /// Path of the file.
    pub file: String,
    /// Fingerprint of everything that plans depend on.
    #[serde(with = "crate::announcement::hexadecimal")]
    pub cell: u64,
    /// The devices that the process knows, in the order of the file; a driver lists only its own.
    pub devices: Vec<DeviceFingerprints>,
}

/// Fingerprints of the configuration of one device.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct DeviceFingerprints {
    /// Name of the device.
    pub name: String,
    /// Fingerprint (16 hexadecimal digits) of each part of the configuration.
    pub parts: BTreeMap<String, String>,
}

/// Result of `CellConfig::identity`: file, fingerprint of the cell, names of the parts, and one fingerprint per part of
/// each device.
type Identity<'a, const PARTS: usize> =
    (String, u64, [&'a str; PARTS], Vec<(String, [u64; PARTS])>);

impl Configuration {
    /// Builds the announced form of `CellConfig::identity`.
    #[must_use]
    pub fn new<const PARTS: usize>(
        (file, cell, names, devices): Identity<'_, PARTS>,
    ) -> Configuration {
        let parts = |values: [u64; PARTS]| {
            let named = names.into_iter().zip(values);
            named
                .map(|(name, value)| (name.to_owned(), format!("{value:016x}")))
                .collect()
        };
        let row = |(name, values)| DeviceFingerprints {
            name,
            parts: parts(values),
        };
        Configuration {
            file,
            cell,
            devices: devices.into_iter().map(row).collect(),
        }
    }

    /// Keeps only this device, as its driver announces it.
    #[must_use]
    pub fn only(mut self, device: &str) -> Configuration {
        self.devices.retain(|one| one.name == device);
        self
    }

    /// Returns the parts of `device` that differ; empty if they agree.
    #[must_use]
    pub fn device_differences(&self, other: &Configuration, device: &str) -> Vec<String> {
        let parts = |configuration: &Configuration| {
            let mut devices = configuration.devices.iter();
            devices
                .find(|one| one.name == device)
                .map(|one| one.parts.clone())
        };
        let (Some(here), Some(there)) = (parts(self), parts(other)) else {
            return vec![format!("device {device} is missing in one of them")];
        };
        let keys = here
            .keys()
            .chain(there.keys().filter(|key| !here.contains_key(*key)));
        keys.filter(|key| here.get(*key) != there.get(*key))
            .cloned()
            .collect()
    }

    /// Returns all differences; empty if both agree in everything, including the order of the devices.
    #[must_use]
    pub fn differences(&self, other: &Configuration) -> Vec<String> {
        if self.cell == other.cell && self.devices == other.devices {
            return Vec::new();
        }
        let names = |configuration: &Configuration| -> Vec<String> {
            let devices = configuration.devices.iter();
            devices.map(|one| one.name.clone()).collect()
        };
        let (here, there) = (names(self), names(other));
        let mut words = Vec::new();
        for name in here
            .iter()
            .chain(there.iter().filter(|name| !here.contains(name)))
        {
            match (here.contains(name), there.contains(name)) {
                (true, true) => {
                    let parts = self.device_differences(other, name);
                    if !parts.is_empty() {
                        words.push(format!("{name}: {}", parts.join(", ")));
                    }
                }
                _ => words.push(format!("device {name}")),
            }
        }
        if words.is_empty() {
            let order = here != there;
            words.push(if order { "order of devices" } else { "period" }.to_owned());
        }
        words
    }
}

/// Two processes cannot work together because their builds or their configurations differ.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ProcessMismatch {
    /// They were built from different versions, so shared data may not mean the same to both.
    Build {
        /// Name and build of the first process.
        one: (String, String),
        /// Name and build of the second process.
        other: (String, String),
    },
    /// They were started with different configurations.
    Configuration {
        /// The differences; empty if one of them announces no configuration.
        differs: Vec<String>,
        /// Name of the process that was started earlier and so has read the older file: `executor`, `driver io`.
        older: String,
    },
}

impl ProcessMismatch {
    /// Returns why a driver and an executor cannot work together; `None` if their builds agree and their configurations
    /// of the driver's device agree. The result is constant while both live: each process announces what it was started
    /// with before others can find it, and never reads the file again.
    #[must_use]
    pub fn about_device(
        driver: &Announcement,
        executor: &Announcement,
        device: &str,
    ) -> Option<ProcessMismatch> {
        ProcessMismatch::between(driver, executor, |one, other| {
            one.device_differences(other, device)
        })
    }

    /// Returns why two processes that know all devices cannot work together.
    #[must_use]
    pub fn about_cell(one: &Announcement, other: &Announcement) -> Option<ProcessMismatch> {
        ProcessMismatch::between(one, other, Configuration::differences)
    }

    fn between(
        one: &Announcement,
        other: &Announcement,
        differences: impl FnOnce(&Configuration, &Configuration) -> Vec<String>,
    ) -> Option<ProcessMismatch> {
        // Compare builds first: configurations of different builds may differ for that reason alone.
        if one.build != other.build {
            let named =
                |process: &Announcement| (process.who(), build::describe(process.build.as_ref()));
            return Some(ProcessMismatch::Build {
                one: named(one),
                other: named(other),
            });
        }
        let both = one.configuration.as_ref().zip(other.configuration.as_ref());
        let differs = both.map(|(here, there)| differences(here, there));
        if differs.as_ref().is_some_and(Vec::is_empty) {
            return None;
        }
        let earlier = match one.start_time_ticks <= other.start_time_ticks {
            true => one,
            false => other,
        };
        Some(ProcessMismatch::Configuration {
            differs: differs.unwrap_or_default(),
            older: earlier.who(),
        })
    }

    /// Returns the mismatch as the end of `it was …`: `started with another configuration`.
    #[must_use]
    pub fn description(&self) -> &'static str {
        match self {
            ProcessMismatch::Build { .. } => "built from another version",
            ProcessMismatch::Configuration { .. } => "started with another configuration",
        }
    }

    /// Returns the event for the log of a process that refuses to work with `other` because of this.
    #[must_use]
    pub fn event(&self, other: &Announcement) -> EventKind {
        let (process, life) = (other.who(), events::hex_digits(other.incarnation));
        let (differs, remedy) = (
            events::event_text(&self.to_string()),
            events::event_text(&self.remedy()),
        );
        let pid = other.pid;
        match self {
            ProcessMismatch::Build { .. } => EventKind::BuildMismatch {
                process,
                pid,
                life,
                differs,
                remedy,
            },
            ProcessMismatch::Configuration { .. } => EventKind::ConfigurationMismatch {
                process,
                pid,
                life,
                differs,
                remedy,
            },
        }
    }

    /// Returns the remedy.
    #[must_use]
    pub fn remedy(&self) -> String {
        match self {
            ProcessMismatch::Configuration { differs, older } if !differs.is_empty() => format!(
                "restart the cell, so that all its processes read the same file; {older} was started first and has read an \
                 older version"
            ),
            ProcessMismatch::Configuration { .. } | ProcessMismatch::Build { .. } => {
                build::REMEDY.to_owned()
            }
        }
    }
}

/// Formats the differences.
impl fmt::Display for ProcessMismatch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ProcessMismatch::Build { one, other } => {
                write!(f, "{}: {}; {}: {}", one.0, one.1, other.0, other.1)
            }
            ProcessMismatch::Configuration { differs, .. } if differs.is_empty() => {
                write!(f, "one of them announces no configuration")
            }
            ProcessMismatch::Configuration { differs, .. } => {
                write!(f, "different in: {}", differs.join("; "))
            }
        }
    }
}

/// Formats that the files of a configuration are not in force: `differs` lists the differences, `fault` is the first
/// fault of files with which no process could be started.
#[must_use]
pub fn changed(differs: &str, fault: Option<&str>) -> String {
    match (differs, fault) {
        (_, Some(fault)) => format!(
            "the configuration files are no longer valid ({fault}); the cell continues with the configuration that it was \
             started with, but a process that dies now cannot be restarted: correct the files"
        ),
        ("", None) => "the configuration files match the running configuration again".to_owned(),
        (differs, None) => format!(
            "the configuration files have changed ({differs}), but the change is not in force: restart the cell; a process \
             that is restarted alone reads the new files, and the others refuse to work with it"
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::announcement::Role;
    use crate::build::Build;

    fn process(role: Role, version: &str, layout: u64) -> Announcement {
        Announcement {
            role,
            label: "io".to_owned(),
            incarnation: 0xabc,
            pid: 77,
            start_time_ticks: 1,
            services: BTreeMap::new(),
            note: String::new(),
            configuration: Some(Configuration::new((
                "a.yaml".to_owned(),
                7,
                ["channels"],
                vec![("io".to_owned(), [layout])],
            ))),
            build: Some(Build {
                version: version.to_owned(),
                layout,
            }),
        }
    }

    #[test]
    fn processes_of_different_builds_disagree_about_that_and_not_about_their_configurations() {
        let executor = process(Role::Executor, "0.1.0", 0x10);
        let older = Announcement {
            build: None,
            ..executor.clone()
        };
        let drivers = [
            (
                process(Role::Driver, "0.1.0", 0x20),
                "driver io: 0.1.0, layout 0000000000000020",
            ),
            (
                process(Role::Driver, "0.2.0", 0x10),
                "driver io: 0.2.0, layout 0000000000000010",
            ),
        ];
        for (driver, words) in &drivers {
            let why = ProcessMismatch::about_device(driver, &executor, "io").map(|why| {
                assert_eq!(why.description(), "built from another version");
                assert!(why.remedy().contains("from one build"), "{}", why.remedy());
                assert!(matches!(
                    why.event(driver),
                    EventKind::BuildMismatch { pid: 77, process, .. } if process == "driver io"
                ));
                why.to_string()
            });
            let expected = format!("{words}; executor: 0.1.0, layout 0000000000000010");
            assert_eq!(why, Some(expected));
        }
        let why = ProcessMismatch::about_cell(&executor, &older).map(|why| why.to_string());
        assert!(why.is_some_and(|words| {
            words.ends_with("executor: an older one that does not announce it")
        }));
        assert_eq!(ProcessMismatch::about_cell(&executor, &executor), None);
        assert_eq!(
            ProcessMismatch::about_device(&process(Role::Driver, "0.1.0", 0x10), &executor, "io"),
            None
        );
    }

    #[test]
    fn an_announcement_without_a_build_is_read_and_its_layout_is_not_taken_for_ours() {
        let own = Announcement {
            build: Some(Build::own()),
            ..process(Role::Executor, "", 0)
        };
        assert_eq!(Build::require_layout(&own), Ok(()));
        let mut text = serde_json::to_value(&own).unwrap_or_default();
        let removed = text
            .as_object_mut()
            .and_then(|fields| fields.remove("build"));
        assert!(removed.is_some_and(|build| build["layout"].is_string()));
        let read: Announcement =
            serde_json::from_value(text).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(read.build, None);
        let words = Build::require_layout(&read).map_err(|other| other.to_string());
        assert!(words.is_err_and(|words| {
            words.contains("the executor was built from another version (an older one")
        }));
    }
}
