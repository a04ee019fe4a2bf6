//! Stores the last grade for `status`: it belongs to the machine and outlives cells. Run by the main thread.
//!
//! Stored in the user's state folder ([`state_base`]).

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use rcc_ipc::state_folder::state_base;
use rcc_os::file::{self, Readers};
use rcc_os::wall;
use serde::{Deserialize, Serialize};

use super::grade::Grade;
use super::measure::WakeUpMeasurement;
use crate::table::{grouped, time};

/// Folder of root's record, readable by everybody.
const ROOT_STATE_DIR: &str = "/var/lib/rcc";
const FILE: &str = "doctor.json";
/// Longest record that is read, bytes.
const FILE_MAX: u64 = 64 << 10;
/// Version of the file format.
const SCHEMA: u32 = 1;

/// A grade and how it was measured.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct GradeRecord {
    /// Version of the file format, 1.
    pub schema: u32,
    /// Time of the measurement, seconds since the epoch.
    pub at: u64,
    /// Boot id of the machine.
    pub boot: String,
    /// Kernel release.
    pub kernel: String,
    /// Grade.
    pub grade: Grade,
    /// SCHED_FIFO priority; `None` if without.
    pub priority: Option<u8>,
    /// Core; `None` if not bound.
    pub core: Option<usize>,
    /// Period, ns.
    pub period_ns: u64,
    /// Number of wake-ups.
    pub cycles: u64,
    /// 99.9th percentile of the latency, ns.
    pub p999_ns: u64,
    /// Longest latency, ns.
    pub max_ns: u64,
}

impl GradeRecord {
    /// Creates the record of a measurement that has just ended.
    #[must_use]
    pub fn of(measured: &WakeUpMeasurement) -> GradeRecord {
        GradeRecord {
            schema: SCHEMA,
            at: now(),
            boot: boot(),
            kernel: line("/proc/sys/kernel/osrelease"),
            grade: Grade::of(measured),
            priority: measured.priority,
            core: measured.core,
            period_ns: measured.period_ns,
            cycles: measured.cycles,
            p999_ns: measured.p999_ns,
            max_ns: measured.max_ns,
        }
    }

    /// Stores the record; returns its file.
    ///
    /// # Errors
    /// Fails if it cannot be written.
    pub fn store(&self) -> io::Result<PathBuf> {
        self.store_in(&state_base())
    }

    fn store_in(&self, folder: &Path) -> io::Result<PathBuf> {
        fs::create_dir_all(folder)?;
        let path = folder.join(FILE);
        let text = serde_json::to_string_pretty(self).map_err(io::Error::other)? + "\n";
        file::replace_shared(&path, text.as_bytes(), Readers::Anybody)?;
        Ok(path)
    }

    /// Returns the last record of this user, or else of root.
    #[must_use]
    pub fn last() -> Option<GradeRecord> {
        let folders = [state_base(), PathBuf::from(ROOT_STATE_DIR)];
        folders.iter().find_map(|folder| read(folder))
    }

    /// Describes the record in one line.
    #[must_use]
    pub fn summary(&self) -> String {
        self.summary_at(now(), &boot(), &line("/proc/sys/kernel/osrelease"))
    }

    fn summary_at(&self, now: u64, boot: &str, kernel: &str) -> String {
        let how = match self.priority {
            Some(priority) => format!("SCHED_FIFO {priority}"),
            None => "without SCHED_FIFO".to_owned(),
        };
        let core = self
            .core
            .map_or_else(|| "any core".to_owned(), |core| format!("core {core}"));
        let doubt = if self.kernel != kernel {
            format!("; under another kernel ({}): measure again", self.kernel)
        } else if self.boot != boot {
            "; before the last boot of this machine".to_owned()
        } else {
            String::new()
        };
        format!(
            "grade {} for {}, measured {} ago: max {} in {} cycles, {how}, {core}{doubt}",
            self.grade,
            time(self.period_ns),
            age(now.saturating_sub(self.at)),
            time(self.max_ns),
            grouped(self.cycles)
        )
    }
}

/// Formats an elapsed time in one unit.
#[must_use]
pub fn age(seconds: u64) -> String {
    match seconds {
        0..120 => format!("{seconds} s"),
        120..7200 => format!("{} min", seconds / 60),
        7200..172_800 => format!("{} h", seconds / 3600),
        _ => format!("{} days", seconds / 86_400),
    }
}

fn read(folder: &Path) -> Option<GradeRecord> {
    let text = file::read_text(&folder.join(FILE), FILE_MAX).ok()?;
    serde_json::from_str(&text)
        .ok()
        .filter(|record: &GradeRecord| record.schema == SCHEMA)
}

fn now() -> u64 {
    wall::seconds()
}

fn boot() -> String {
    line("/proc/sys/kernel/random/boot_id")
}

fn line(path: &str) -> String {
    fs::read_to_string(path)
        .unwrap_or_default()
        .trim()
        .to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::grade::tests::measured;

    #[test]
    fn a_stored_record_is_read_again() -> io::Result<()> {
        let temporary = rcc_testing::folder();
        let folder = temporary.path().join("new");
        let record = GradeRecord::of(&measured(21, 38));
        let path = record.store_in(&folder)?;
        let read = read(&folder);
        let others = fs::read_dir(&folder)?.count();
        assert_eq!(read, Some(record));
        assert!(path.ends_with("doctor.json") && others == 1);
        Ok(())
    }

    #[test]
    fn the_summary_shows_grade_age_and_doubt() {
        let mut record = GradeRecord::of(&measured(21, 38));
        (record.at, record.boot, record.kernel) = (1000, "x".to_owned(), "6.1".to_owned());
        assert_eq!(
            record.summary_at(1400, "x", "6.1"),
            "grade A for 1.0 ms, measured 6 min ago: max 38.0 µs in 5 000 cycles, SCHED_FIFO 80, core 1"
        );
        assert!(
            record
                .summary_at(1400, "y", "6.1")
                .ends_with("before the last boot of this machine")
        );
        assert!(
            record
                .summary_at(1400, "x", "6.2")
                .ends_with("under another kernel (6.1): measure again")
        );
    }

    #[test]
    fn the_form_of_the_file_is_stable() -> Result<(), serde_json::Error> {
        let text = r#"{"schema":1,"at":5,"boot":"b","kernel":"6.1","grade":"C","priority":null,"core":null,
                       "period_ns":1000000,"cycles":5000,"p999_ns":1,"max_ns":2}"#;
        let record: GradeRecord = serde_json::from_str(text)?;
        assert_eq!((record.grade, record.priority), (Grade::C, None));
        Ok(())
    }
}
