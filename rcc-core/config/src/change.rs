//! Notices that the files of a configuration say something else than what a process was started with.
//! Run by threads that are not real-time, a look now and then.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use crate::cell::CellConfig;
use crate::device::{ChannelConfig, DeviceConfig};
use crate::diagnostic::Faults;
use crate::ports::auto_ports;

/// What the files say now, compared with what is in force.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ConfigChange {
    /// The same: text that means nothing else is no change.
    None,
    /// Something else; each sentence names what: `io: channels torch, gas`.
    Differs(Vec<String>),
    /// Nothing that a process could be started with; the first fault.
    Invalid(String),
}

/// A configuration in force, and its files.
#[derive(Debug)]
pub struct FileWatch {
    running: CellConfig,
    given: BTreeMap<String, u16>,
    files: Vec<PathBuf>,
    /// As the files were at the last look; empty before the first.
    seen: Vec<FileStamp>,
    /// As they were when they were read last.
    read: Vec<FileStamp>,
    change: ConfigChange,
    disk: Option<CellConfig>,
}

/// By what a changed file is noticed: inode, length, time of its last change. A file that is not there has none.
type FileStamp = Option<(u64, u64, i64, i64)>;

impl FileWatch {
    /// Watches the files of `running`; `given` are the ports that it was loaded with.
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

    /// Looks at the files. They are read when they were touched and then left alone from one look to the next: who is
    /// still writing is waited for. Returns what they say if that is something else than before.
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
            // What was in force before still counts, and what the file names now does, too.
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

    /// What the files said when they were read last.
    #[must_use]
    pub fn change(&self) -> &ConfigChange {
        &self.change
    }

    /// The configuration that they held then, if it was valid.
    #[must_use]
    pub fn disk(&self) -> Option<&CellConfig> {
        self.disk.as_ref()
    }
}

impl CellConfig {
    /// The files that it was read from: its own, and the robots'.
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

    /// What is not the same in `other`, by the words of the file; nothing if both mean the same.
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
            // Its file may have moved.
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

/// The names of channels that are new, gone, or not the same.
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

/// The file as a process of this cell would read it that is started now: ports that were chosen keep their numbers, as
/// far as the file still has them, and new ones have none yet.
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
