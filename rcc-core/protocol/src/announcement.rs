//! Announcements: the file that each process of a cell writes, with its role, its process id and its services. Plain
//! data; [`Announcement::liveness`] reads `/proc`, which real-time threads must not.

use std::collections::BTreeMap;
use std::io;

use rcc_os::process_instance::{Liveness, ProcessInstance};
use serde::{Deserialize, Serialize};

use crate::build::Build;
use crate::configuration::Configuration;
use crate::role::Role;

/// Label under which the executor of a cell announces itself.
pub const EXECUTOR_LABEL: &str = "exec";
/// Role and label under which the supervisor of a cell announces itself; at most one process has them.
const SUPERVISOR: (Role, &str) = (Role::Cli, "up");

/// Identity of a process and the full names of its services.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Announcement {
    /// Role of the process in the cell.
    pub role: Role,
    /// Distinguishes processes of one role; for a driver, the name of its device.
    pub label: String,
    /// Incarnation number, unique to this run of the process (see [`ProcessInstance::incarnation`]).
    #[serde(with = "crate::hexadecimal")]
    pub incarnation: u64,
    /// Process id.
    pub pid: u32,
    /// Start time of the process, clock ticks after boot.
    pub start_time_ticks: u64,
    /// Full service names, by short name.
    #[serde(default)]
    pub services: BTreeMap<String, String>,
    /// Note for people; a driver lists its reason numbers here, one `NUMBER TEXT` per line.
    #[serde(default)]
    pub note: String,
    /// Configuration that the process was started with; `None` for processes without one, and for older builds.
    #[serde(default)]
    pub configuration: Option<Configuration>,
    /// Build of the process; `None` for older builds, which do not announce it.
    #[serde(default)]
    pub build: Option<Build>,
}

impl Announcement {
    /// Returns the announcement of a process of this build, without services.
    #[must_use]
    pub fn new(role: Role, label: &str, instance: ProcessInstance) -> Announcement {
        Announcement {
            role,
            label: label.to_owned(),
            incarnation: instance.incarnation(),
            pid: instance.pid,
            start_time_ticks: instance.start_time_ticks,
            services: BTreeMap::new(),
            note: String::new(),
            configuration: None,
            build: Some(Build::own()),
        }
    }

    /// Returns the announcement of this process as the supervisor of a cell.
    ///
    /// # Errors
    /// Returns an error if the system does not tell the start time of this process.
    pub fn supervisor() -> io::Result<Announcement> {
        let (role, label) = SUPERVISOR;
        Ok(Announcement::new(role, label, ProcessInstance::current()?).note("supervisor"))
    }

    /// Returns true if the announcing process supervises the cell.
    #[must_use]
    pub fn is_supervisor(&self) -> bool {
        (self.role, self.label.as_str()) == SUPERVISOR
    }

    /// Adds the service `full` under the short name `name`.
    #[must_use]
    pub fn service(mut self, name: &str, full: &str) -> Announcement {
        self.services.insert(name.to_owned(), full.to_owned());
        self
    }

    /// Sets the note for people.
    #[must_use]
    pub fn note(mut self, note: &str) -> Announcement {
        note.clone_into(&mut self.note);
        self
    }

    /// Sets the configuration that the process was started with.
    #[must_use]
    pub fn configured(mut self, configuration: Configuration) -> Announcement {
        self.configuration = Some(configuration);
        self
    }

    /// Returns a name for people: `executor`, `driver io`.
    #[must_use]
    pub fn who(&self) -> String {
        match self.role {
            Role::Driver => format!("driver {}", self.label),
            role => role.to_string(),
        }
    }

    /// Returns the process instance that made this announcement.
    #[must_use]
    pub fn instance(&self) -> ProcessInstance {
        ProcessInstance {
            pid: self.pid,
            start_time_ticks: self.start_time_ticks,
        }
    }

    /// Returns whether exactly this process instance still runs (a zombie does not), as far as the system can tell.
    #[must_use]
    pub fn liveness(&self) -> Liveness {
        self.instance().liveness()
    }
}
