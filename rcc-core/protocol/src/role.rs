//! The roles of the processes of a cell. Plain data, used by every thread.

use std::fmt;

use serde::{Deserialize, Serialize};

/// Role of a process in its cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// Compiles nets to plans and serves the REST interface.
    Loader,
    /// Runs the cycle.
    Executor,
    /// Drives one device.
    Driver,
    /// Reads streams.
    Monitor,
    /// A command entered by a person.
    Cli,
}

impl Role {
    /// Returns the name used in file and service names.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Role::Loader => "loader",
            Role::Executor => "executor",
            Role::Driver => "driver",
            Role::Monitor => "monitor",
            Role::Cli => "cli",
        }
    }
}

impl fmt::Display for Role {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.as_str())
    }
}
