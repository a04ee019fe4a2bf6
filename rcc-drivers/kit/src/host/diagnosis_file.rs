//! Writes the diagnosis file of a device's connection: counters since the driver started, and the last minute second by
//! second.
//! Counted by the exchange thread; a helper thread writes them to `<cell>/drivers/<device>.json` once per second.
//!
//! A file can be read by anyone at any time, without loader and executor, and after a crash of the driver it stays
//! until the next driver overwrites it.

use std::collections::VecDeque;
use std::fs;
use std::io;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::Relaxed};
use std::time::Duration;

use rcc_config::DeviceConfig;
use rcc_core::message::{DeviceState, JOINTS_MAX, Measurement};
use rcc_ipc::Cell;
use rcc_os::file::{self, Readers};
use rcc_os::process_instance::ProcessInstance;
use rcc_process::Helpers;
use serde::Serialize;

use super::reason::{self, Reason};
use crate::driver;

/// Watchdog limit for writing the file, for slow disks.
const TURN_MAX: Duration = Duration::from_secs(60);
/// How long the end waits for the thread.
const FAREWELL: Duration = Duration::from_secs(2);
/// Version of the file's schema.
const SCHEMA: u32 = 1;
/// Interval of the history.
const EVERY: Duration = Duration::from_secs(1);
/// Number of entries in the history.
pub const SECONDS_MAX: usize = 60;

/// Written by the exchange thread, read by the helper thread; Relaxed, because each counter is independent.
#[derive(Debug, Default)]
struct LinkCounters {
    state: AtomicU32,
    reason: AtomicU32,
    quality: AtomicU32,
    exchanges: AtomicU64,
    late: AtomicU64,
    refused: AtomicU64,
    starved: AtomicU64,
    /// Quality since the last entry: sum, count and minimum.
    quality_sum: AtomicU64,
    quality_count: AtomicU64,
    quality_min: AtomicU32,
    joints: AtomicU32,
    /// Bits of the measured joint positions. They may be of two exchanges, which is enough for a picture.
    position: [AtomicU64; JOINTS_MAX],
}

/// One entry of the history.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct SecondSummary {
    /// Smallest quality, thousandths; 0 without any exchange.
    pub quality_min: u32,
    /// Mean quality, thousandths.
    pub quality_mean: u32,
    /// Number of exchanges.
    pub exchanges: u64,
    /// Number of answers that were late or lost.
    pub late: u64,
    /// Number of datagrams refused.
    pub refused: u64,
}

/// Content of the diagnosis file.
#[derive(Debug, Serialize)]
struct DiagnosisContent<'a> {
    schema: u32,
    device: &'a str,
    driver: &'a str,
    pid: u32,
    incarnation: String,
    /// Start of this driver and time of writing, in seconds since the epoch.
    since: u64,
    at: u64,
    state: &'static str,
    reason: u32,
    reason_words: &'static str,
    quality_permille: u32,
    exchanges: u64,
    late: u64,
    refused: u64,
    starved: u64,
    /// Number of times that the device went offline, and the last of them in seconds since the epoch.
    losses: u64,
    lost_at: Option<u64>,
    /// Measured joint positions, rad; null while they are not known, empty without an arm.
    position: Vec<Option<f64>>,
    /// History, oldest entry first.
    seconds: &'a VecDeque<SecondSummary>,
    /// The driver's own counters, see [`driver::LinkDiagnosis`].
    link: serde_json::Value,
}

/// State of the helper thread that writes the file.
struct DiagnosisWriter {
    path: PathBuf,
    device: String,
    driver: String,
    since: u64,
    reasons: &'static [Reason],
    counters: Arc<LinkCounters>,
    link: Option<Arc<dyn driver::LinkDiagnosis>>,
    seconds: VecDeque<SecondSummary>,
    before: SecondSummary,
    offline: bool,
    losses: u64,
    lost_at: Option<u64>,
}

/// Counters of one run of a driver. Dropping it ends the helper threads and removes the file.
#[derive(Debug)]
pub struct DiagnosisFile {
    counters: Arc<LinkCounters>,
    path: PathBuf,
    helpers: Helpers,
}

impl DiagnosisFile {
    /// Starts writing the diagnosis of `device`; `link` gives the driver's own counters.
    ///
    /// # Errors
    /// Returns an error if the operating system refuses to create a thread.
    pub fn start(
        cell: &Cell,
        device: &DeviceConfig,
        reasons: &'static [Reason],
        link: Option<Arc<dyn driver::LinkDiagnosis>>,
        helpers: &Helpers,
    ) -> io::Result<DiagnosisFile> {
        let counters = Arc::new(LinkCounters::default());
        counters.quality_min.store(u32::MAX, Relaxed);
        let path = cell.drivers_dir().join(format!("{}.json", device.name));
        let mut writer = DiagnosisWriter {
            path: path.clone(),
            device: device.name.clone(),
            driver: device.driver.to_string(),
            since: now(),
            reasons,
            counters: Arc::clone(&counters),
            link,
            seconds: VecDeque::with_capacity(SECONDS_MAX + 1),
            before: SecondSummary::default(),
            offline: true,
            losses: 0,
            lost_at: None,
        };
        helpers.spawn("diagnosis", TURN_MAX, move |helper| {
            while !helper.rest(EVERY) {
                writer.next_second();
                // A full disk, or a folder that was removed: nobody to report to, and the next second brings another
                // attempt.
                let _ = writer.write();
            }
        })?;
        Ok(DiagnosisFile {
            counters,
            path,
            helpers: helpers.clone(),
        })
    }

    /// Counts one turn of the exchange loop.
    pub fn update(&self, measurement: &Measurement) {
        let counters = &self.counters;
        counters.state.store(measurement.state, Relaxed);
        counters.reason.store(measurement.reason, Relaxed);
        counters
            .quality
            .store(measurement.quality_permille, Relaxed);
        counters.late.store(measurement.late, Relaxed);
        counters.refused.store(measurement.refused, Relaxed);
        counters.starved.store(measurement.starved, Relaxed);
        counters.joints.store(measurement.joints, Relaxed);
        for (kept, position) in counters.position.iter().zip(measurement.position) {
            kept.store(position.to_bits(), Relaxed);
        }
        let exchanges = counters.exchanges.swap(measurement.sequence, Relaxed);
        if exchanges != measurement.sequence {
            counters
                .quality_sum
                .fetch_add(u64::from(measurement.quality_permille), Relaxed);
            counters.quality_count.fetch_add(1, Relaxed);
            counters
                .quality_min
                .fetch_min(measurement.quality_permille, Relaxed);
        }
    }
}

impl Drop for DiagnosisFile {
    fn drop(&mut self) {
        // Otherwise the thread might write once more; the wait is bounded, since a hanging disk must not keep the
        // process from ending.
        self.helpers.end();
        let _ = self
            .helpers
            .join(FAREWELL, &["events", "notify", "signals"]);
        // An orderly end leaves no file; it may not even have been written yet.
        let _ = fs::remove_file(&self.path);
    }
}

impl DiagnosisWriter {
    fn next_second(&mut self) {
        let counters = &self.counters;
        let count = counters.quality_count.swap(0, Relaxed);
        let sum = counters.quality_sum.swap(0, Relaxed);
        let min = counters.quality_min.swap(u32::MAX, Relaxed);
        let total = SecondSummary {
            exchanges: counters.exchanges.load(Relaxed),
            late: counters.late.load(Relaxed),
            refused: counters.refused.load(Relaxed),
            ..SecondSummary::default()
        };
        let mean = sum
            .checked_div(count)
            .and_then(|mean| u32::try_from(mean).ok());
        self.seconds.push_back(SecondSummary {
            quality_min: if count == 0 { 0 } else { min },
            quality_mean: mean.unwrap_or(0),
            exchanges: total.exchanges.saturating_sub(self.before.exchanges),
            late: total.late.saturating_sub(self.before.late),
            refused: total.refused.saturating_sub(self.before.refused),
        });
        self.before = total;
        while self.seconds.len() > SECONDS_MAX {
            self.seconds.pop_front();
        }
        let offline = counters.state.load(Relaxed) == DeviceState::Offline as u32;
        if offline && !self.offline {
            self.losses += 1;
            self.lost_at = Some(now());
        }
        self.offline = offline;
    }

    /// Returns the measured joint positions; all of them are unknown while the device is offline.
    fn position(&self) -> Vec<Option<f64>> {
        let counters = &self.counters;
        let joints = counters.joints.load(Relaxed) as usize;
        let known = counters.position.iter().take(joints).map(|bits| {
            let position = f64::from_bits(bits.load(Relaxed));
            (position.is_finite() && !self.offline).then_some(position)
        });
        known.collect()
    }

    fn write(&self) -> io::Result<()> {
        let counters = &self.counters;
        let reason = counters.reason.load(Relaxed);
        let content = DiagnosisContent {
            schema: SCHEMA,
            device: &self.device,
            driver: &self.driver,
            pid: std::process::id(),
            incarnation: format!("{:016x}", ProcessInstance::current()?.incarnation()),
            since: self.since,
            at: now(),
            state: DeviceState::from_number(counters.state.load(Relaxed)).name(),
            reason,
            reason_words: if reason == 0 {
                ""
            } else {
                reason::meaning(reason, self.reasons)
            },
            quality_permille: counters.quality.load(Relaxed),
            exchanges: counters.exchanges.load(Relaxed),
            late: counters.late.load(Relaxed),
            refused: counters.refused.load(Relaxed),
            starved: counters.starved.load(Relaxed),
            losses: self.losses,
            lost_at: self.lost_at,
            position: self.position(),
            seconds: &self.seconds,
            link: self
                .link
                .as_ref()
                .map_or(serde_json::Value::Null, |link| link.link()),
        };
        let text = serde_json::to_vec(&content).map_err(io::Error::other)?;
        file::replace(&self.path, &text, Readers::Anybody)
    }
}

fn now() -> u64 {
    rcc_os::wall::seconds()
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    fn writer() -> DiagnosisWriter {
        let counters = Arc::new(LinkCounters::default());
        counters.quality_min.store(u32::MAX, Relaxed);
        DiagnosisWriter {
            path: std::env::temp_dir().join(format!("rcc-diagnosis-{}.json", std::process::id())),
            device: "lwr".to_owned(),
            driver: "fri-lwr".to_owned(),
            since: 5,
            reasons: &[],
            counters,
            link: None,
            seconds: VecDeque::new(),
            before: SecondSummary::default(),
            offline: true,
            losses: 0,
            lost_at: None,
        }
    }

    fn turn(writer: &DiagnosisWriter, state: DeviceState, quality_permille: u32, late: u64) {
        let diagnosis = DiagnosisFile {
            counters: Arc::clone(&writer.counters),
            path: PathBuf::new(),
            helpers: Helpers::default(),
        };
        let measurement = Measurement {
            state: state as u32,
            quality_permille,
            late,
            sequence: writer.counters.exchanges.load(Relaxed)
                + u64::from(state != DeviceState::Offline),
            ..Measurement::zeroed()
        };
        diagnosis.update(&measurement);
    }

    #[test]
    fn measured_positions_are_those_of_the_arm_and_unknown_while_it_is_offline() {
        let mut writer = writer();
        assert!(writer.position().is_empty());
        let counters = &writer.counters;
        counters.joints.store(2, Relaxed);
        counters.position[0].store(0.5_f64.to_bits(), Relaxed);
        counters.position[1].store(f64::NAN.to_bits(), Relaxed);
        assert_eq!(writer.position(), [None, None]);
        writer.offline = false;
        assert_eq!(writer.position(), [Some(0.5), None]);
    }

    #[test]
    fn each_second_has_its_own_smallest_and_mean_quality_and_its_own_losses() {
        let mut writer = writer();
        turn(&writer, DeviceState::Ready, 1000, 3);
        turn(&writer, DeviceState::Ready, 500, 4);
        writer.next_second();
        turn(&writer, DeviceState::Ready, 1000, 4);
        writer.next_second();
        writer.next_second();
        let lines: Vec<_> = writer
            .seconds
            .iter()
            .map(|second| {
                (
                    second.quality_min,
                    second.quality_mean,
                    second.exchanges,
                    second.late,
                )
            })
            .collect();
        assert_eq!(lines, [(500, 750, 2, 4), (1000, 1000, 1, 0), (0, 0, 0, 0)]);
    }

    #[test]
    fn the_history_is_bounded_and_going_offline_is_counted_once() {
        let mut writer = writer();
        turn(&writer, DeviceState::Ready, 1000, 0);
        for _ in 0..2 * SECONDS_MAX {
            writer.next_second();
        }
        assert_eq!((writer.seconds.len(), writer.losses), (SECONDS_MAX, 0));
        turn(&writer, DeviceState::Offline, 0, 0);
        writer.next_second();
        writer.next_second();
        assert_eq!(writer.losses, 1);
        assert!(writer.lost_at.is_some());
    }

    #[test]
    fn the_file_has_stable_keys() -> io::Result<()> {
        let mut writer = writer();
        turn(&writer, DeviceState::Online, 333, 1);
        writer.next_second();
        writer.write()?;
        let text = fs::read(&writer.path)?;
        fs::remove_file(&writer.path)?;
        let value: serde_json::Value = serde_json::from_slice(&text)?;
        let keys: Vec<&String> = value
            .as_object()
            .into_iter()
            .flat_map(|object| object.keys())
            .collect();
        assert_eq!(
            keys,
            [
                "schema",
                "device",
                "driver",
                "pid",
                "incarnation",
                "since",
                "at",
                "state",
                "reason",
                "reason_words",
                "quality_permille",
                "exchanges",
                "late",
                "refused",
                "starved",
                "losses",
                "lost_at",
                "position",
                "seconds",
                "link"
            ]
        );
        assert_eq!(
            (&value["state"], &value["seconds"][0]["quality_min"]),
            (&"online".into(), &333.into())
        );
        Ok(())
    }
}
