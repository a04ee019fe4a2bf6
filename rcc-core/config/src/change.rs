//! Detects that the configuration files differ from what a process was started with. Polled by threads that are not
//! real-time.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use crate::cell::CellConfig;
use crate::device::{ChannelConfig, DeviceConfig};
use crate::diagnostic::Faults;
use crate::ports::auto_ports;

/// Difference between the files and the configuration in force.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ConfigChange {
    /// No difference. A change of the text without a change of meaning does not count.
    None,
    /// Differences, one sentence each: `io: channels torch, gas`.
    Differs(Vec<String>),
    /// No process could be started with the files; the first fault.
    Invalid(String),
}

/// The configuration in force and its files.
#[derive(Debug)]
pub struct FileWatch {
    running: CellConfig,
    given: BTreeMap<String, u16>,
    files: Vec<PathBuf>,
    /// Stamps of the files at the last poll; empty before the first.
    seen: Vec<FileStamp>,
    /// Stamps of the files when they were last read.
    read: Vec<FileStamp>,
    change: ConfigChange,
    disk: Option<CellConfig>,
}

/// Identifies a version of a file: inode, length, time of the last change; `None` for a missing file.
type FileStamp = Option<(u64, u64, i64, i64)>;

impl FileWatch {
    /// Watches the files of `running`, which was loaded with the ports `given`.
    #[must_use]
    pub fn new(running: CellConfig, given: BTreeMap<String, u16>) -> FileWatch {
        FileWatch {
            files: running.files(),
            running,
            given,
            seen: Vec::new(),
            read: Vec::new(),
            change: ConfigChange::None,
            disk: None,
        }
    }

    /// Polls the files. They are read once they have changed and then stayed the same from one poll to the next, so
    /// that a writer can finish. Returns the result if it differs from the previous one.
    pub fn poll(&mut self) -> Option<&ConfigChange> {
        let stamps: Vec<FileStamp> = self.files.iter().map(|file| stamp(file)).collect();
        if stamps == self.read {
            return None;
        }
        let still = stamps == self.seen;
        self.seen.clone_from(&stamps);
        if !still {
            return None;
        }
        self.read = stamps;
        let read = reload(&self.running.source, &self.given);
        let change = match &read {
            Ok(disk) => match self.running.differences(disk) {
                none if none.is_empty() => ConfigChange::None,
                differences => ConfigChange::Differs(differences),
            },
            Err(faults) => ConfigChange::Invalid(first(faults)),
        };
        self.disk = read.ok();
        if let Some(disk) = &self.disk {
            // Watch the files of the configuration in force, and also those that the changed file names.
            for file in disk.files() {
                if !self.files.contains(&file) {
                    self.read.push(stamp(&file));
                    self.files.push(file);
                }
            }
        }
        let is_news = change != self.change;
        self.change = change;
        is_news.then_some(&self.change)
    }

    /// Returns the result of the last read.
    #[must_use]
    pub fn change(&self) -> &ConfigChange {
        &self.change
    }

    /// Returns the configuration from the last read, if it was valid.
    #[must_use]
    pub fn disk(&self) -> Option<&CellConfig> {
        self.disk.as_ref()
    }
}

impl CellConfig {
    /// Returns the files that the configuration was read from: the cell's and the robots'.
    #[must_use]
    pub fn files(&self) -> Vec<PathBuf> {
        let base = self.source.parent().unwrap_or(Path::new(""));
        let mut files = vec![self.source.clone()];
        for robot in self.devices.iter().filter_map(|one| one.robot.as_ref()) {
            let file = base.join(&robot.source);
            if !files.contains(&file) {
                files.push(file);
            }
        }
        files
    }

    /// Returns the differences to `other` in terms of the file's keys; empty if both mean the same.
    #[must_use]
    pub fn differences(&self, other: &CellConfig) -> Vec<String> {
        let changed = [
            ("cell", self.name != other.name),
            ("period", self.period_ns != other.period_ns),
            ("stale_after", self.stale_after_ns != other.stale_after_ns),
            ("clock", self.clock != other.clock),
            ("executor", self.executor != other.executor),
            ("recorder", self.recorder != other.recorder),
            ("supervision", self.supervision != other.supervision),
            ("access", self.access != other.access),
            ("link", self.link != other.link),
            ("ports", self.ports != other.ports),
            ("simulators", self.simulators != other.simulators),
        ];
        let mut words = named(&changed);
        let names = |cell: &CellConfig| -> Vec<String> {
            cell.devices.iter().map(|one| one.name.clone()).collect()
        };
        let (here, there) = (names(self), names(other));
        for gone in here.iter().filter(|name| !there.contains(name)) {
            words.push(format!("{gone}: removed"));
        }
        for new in there.iter().filter(|name| !here.contains(name)) {
            words.push(format!("{new}: new"));
        }
        if words.iter().all(|word| !word.contains(':')) && here != there {
            words.push("order of devices".to_owned());
        }
        for device in &self.devices {
            let Some((_, changed)) = other.device(&device.name) else {
                continue;
            };
            let parts = device.differences(changed);
            if !parts.is_empty() {
                words.push(format!("{}: {}", device.name, parts.join(", ")));
            }
        }
        words
    }
}

impl DeviceConfig {
    fn differences(&self, other: &DeviceConfig) -> Vec<String> {
        let robot = |device: &DeviceConfig| {
            // The path of the robot's file may differ.
            device.robot.clone().map(|robot| crate::RobotConfig {
                source: String::new(),
                ..robot
            })
        };
        let mut words = named(&[
            ("driver", self.driver != other.driver),
            ("robot", robot(self) != robot(other)),
            ("settings", self.settings != other.settings),
            (
                "first_tolerance",
                self.first_tolerance_rad != other.first_tolerance_rad,
            ),
            ("base", self.base != other.base),
            ("workspace", self.workspace != other.workspace),
            (
                "command_timeout",
                self.command_timeout_ns != other.command_timeout_ns,
            ),
            ("delay", self.delay_ns != other.delay_ns),
        ]);
        let channels = changed_channels(&self.channels, &other.channels);
        if !channels.is_empty() {
            words.push(format!("channels {}", channels.join(", ")));
        }
        words
    }
}

/// Returns the names of channels that are new, removed or different.
fn changed_channels<'a>(here: &'a [ChannelConfig], there: &'a [ChannelConfig]) -> Vec<&'a str> {
    let changed = here.iter().filter(|channel| !there.contains(channel));
    let new = there
        .iter()
        .filter(|channel| here.iter().all(|one| one.name != channel.name));
    let names = changed.chain(new).map(|channel| channel.name.as_str());
    names.collect()
}

fn named(rows: &[(&str, bool)]) -> Vec<String> {
    let changed = rows.iter().filter(|(_, changed)| *changed);
    changed.map(|(name, _)| (*name).to_owned()).collect()
}

/// Reads the file as a newly started process of this cell would: chosen ports keep their numbers if the file still
/// declares them, and new automatic ports are 0.
fn reload(path: &Path, given: &BTreeMap<String, u16>) -> Result<CellConfig, Faults> {
    let mut ports: BTreeMap<String, u16> = auto_ports(path)?
        .into_iter()
        .map(|(name, _)| (name, 0))
        .collect();
    let declared = CellConfig::load_offline(path)?.ports;
    let kept = given
        .iter()
        .filter(|(name, _)| declared.contains_key(*name));
    ports.extend(kept.map(|(name, number)| (name.clone(), *number)));
    CellConfig::load(path, &ports)
}

fn first(faults: &Faults) -> String {
    let rows = faults.rows();
    rows.first().map_or_else(String::new, |row| {
        format!("{}:{}: {}", row.file, row.line, row.message)
    })
}

fn stamp(file: &Path) -> FileStamp {
    let found = fs::metadata(file).ok()?;
    Some((found.ino(), found.len(), found.mtime(), found.mtime_nsec()))
}
