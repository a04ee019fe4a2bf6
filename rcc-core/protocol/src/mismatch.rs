//! Two processes that cannot work together, because they are of different builds or were started with different
//! configurations. Found at start-up, from announcements, by threads that are not real-time.

use std::fmt;

use crate::announcement::Announcement;
use crate::build::{Build, REMEDY, describe};
use crate::configuration::Configuration;
use crate::events::{self, EventKind};

impl Build {
    /// Checks that `other` uses the same shared-memory layout, before any of its services is opened.
    ///
    /// # Errors
    /// Returns an error if `other` has another layout, or announces none because it is an older build.
    pub fn require_layout(other: &Announcement) -> Result<(), BuildMismatch> {
        let own = Build::own();
        match &other.build {
            Some(build) if build.layout == own.layout => Ok(()),
            theirs => Err(BuildMismatch {
                who: other.who(),
                theirs: describe(theirs.as_ref()),
                own: own.to_string(),
            }),
        }
    }
}

/// Another process uses a different shared-memory layout.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the {who} was built from another version ({theirs}) than this program ({own}); {REMEDY}")]
pub struct BuildMismatch {
    /// The other process: `executor`, `driver io`.
    pub who: String,
    /// Its build.
    pub theirs: String,
    /// Build of this process.
    pub own: String,
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
            let named = |process: &Announcement| (process.who(), describe(process.build.as_ref()));
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
                REMEDY.to_owned()
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

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::role::Role;

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
