//! Status file of a device's driver, which the driver writes once a second; unknown and missing fields are tolerated.
//! Run by the main thread. The history starts with the driver.

use rcc_ipc::Cell;
use rcc_os::{file, wall};
use rcc_protocol::Role;
use serde::{Deserialize, Serialize};

/// Bars of a sparkline, from worst to best.
const BARS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
/// Mark of a second without any exchange.
const NO_EXCHANGE: char = '·';
/// Longest status file that is read, bytes; a minute takes a few kilobytes.
const FILE_MAX: u64 = 1 << 20;
/// A living driver that has not written for this time is stuck, s.
const STALE_AFTER: u64 = 5;

/// Statistics of one second of a connection.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct SecondStats {
    /// Lowest quality, thousandths.
    pub quality_min: u32,
    /// Mean quality, thousandths.
    pub quality_mean: u32,
    /// Number of exchanges.
    pub exchanges: u64,
    /// Late or lost answers.
    pub late: u64,
    /// Refused datagrams.
    pub refused: u64,
}

/// Content of the status file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct DriverStatus {
    /// Name of the driver.
    pub driver: String,
    /// Process id.
    pub pid: u32,
    /// Start of the driver, seconds since the epoch.
    pub since: u64,
    /// Time of this status, seconds since the epoch.
    pub at: u64,
    /// State of the device as seen by the driver.
    pub state: String,
    /// Reason why the device is not ready; 0 if it is.
    pub reason: u32,
    /// Description of the reason.
    pub reason_words: String,
    /// Newest quality, thousandths.
    pub quality_permille: u32,
    /// Exchanges since the driver started; the following counters likewise.
    pub exchanges: u64,
    /// Late or lost answers.
    pub late: u64,
    /// Refused datagrams.
    pub refused: u64,
    /// Number of times without a fresh set-point.
    pub starved: u64,
    /// Number of times that the device went offline.
    pub losses: u64,
    /// Time of the last such event, seconds since the epoch.
    pub lost_at: Option<u64>,
    /// The last minute, oldest first.
    pub seconds: Vec<SecondStats>,
    /// Driver-specific diagnosis.
    pub link: serde_json::Value,
}

/// History of a connection, as shown by `devices`.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct LinkHistory {
    /// Length, s: at most 60, less after a start of the driver.
    pub seconds: usize,
    /// Lowest quality, thousandths.
    pub quality_min_permille: u32,
    /// Mean quality, thousandths.
    pub quality_mean_permille: u32,
    /// Late or lost answers.
    pub late: u64,
    /// Late or lost answers since the driver started.
    pub late_total: u64,
    /// Start of the driver, seconds since the epoch.
    pub since: u64,
    /// Time at which the device last went offline, seconds since the epoch.
    pub lost_at: Option<u64>,
    /// Address of the other end, if the driver knows it.
    pub peer: Option<String>,
    /// True if the driver lives but has stopped writing its status.
    pub stale: bool,
    /// Mean quality per second, oldest first.
    pub sparkline: String,
}

impl DriverStatus {
    /// Reads the last status of the device's driver, if it is alive.
    #[must_use]
    pub fn of(cell: &Cell, device: &str) -> Option<DriverStatus> {
        let announced = cell.announced(Role::Driver, device).ok().flatten()?;
        let path = cell.drivers_dir().join(format!("{device}.json"));
        let status: DriverStatus =
            serde_json::from_slice(&file::read(&path, FILE_MAX).ok()?).ok()?;
        // A file of an earlier driver process does not count.
        (!announced.liveness().is_dead() && announced.pid == status.pid).then_some(status)
    }

    /// Returns the history of the last minute.
    #[must_use]
    pub fn history(&self) -> LinkHistory {
        self.history_at(now())
    }

    fn history_at(&self, now: u64) -> LinkHistory {
        let with = |second: &&SecondStats| second.exchanges > 0;
        let count = self.seconds.iter().filter(with).count() as u64;
        let sum: u64 = self
            .seconds
            .iter()
            .filter(with)
            .map(|second| u64::from(second.quality_mean))
            .sum();
        let mean = sum
            .checked_div(count)
            .and_then(|mean| u32::try_from(mean).ok());
        let least = self
            .seconds
            .iter()
            .filter(with)
            .map(|second| second.quality_min)
            .min();
        let text = |key: &str| self.link[key].as_str().map(str::to_owned);
        LinkHistory {
            seconds: self.seconds.len(),
            quality_min_permille: least.unwrap_or(0),
            quality_mean_permille: mean.unwrap_or(0),
            late: self.seconds.iter().map(|second| second.late).sum(),
            late_total: self.late,
            since: self.since,
            lost_at: self.lost_at,
            peer: text("controller").or_else(|| text("peer")),
            stale: now.saturating_sub(self.at) > STALE_AFTER,
            sparkline: sparkline(&self.seconds),
        }
    }
}

/// Draws one character per second: the mean quality, or a dot if nothing was exchanged.
#[must_use]
pub fn sparkline(seconds: &[SecondStats]) -> String {
    let sign = |second: &SecondStats| {
        if second.exchanges == 0 {
            return NO_EXCHANGE;
        }
        let index = second.quality_mean as usize * (BARS.len() - 1) / 1000;
        BARS[index.min(BARS.len() - 1)]
    };
    seconds.iter().map(sign).collect()
}

/// Returns the current time, seconds since the epoch.
#[must_use]
pub fn now() -> u64 {
    wall::seconds()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn second(quality: u32, exchanges: u64) -> SecondStats {
        SecondStats {
            quality_min: quality / 2,
            quality_mean: quality,
            exchanges,
            late: 1,
            refused: 0,
        }
    }

    #[test]
    fn each_second_is_a_bar_or_a_dot_without_exchange() {
        let all = [second(1000, 5), second(0, 5), second(500, 5), second(0, 0)];
        assert_eq!(sparkline(&all), "█▁▄·");
    }

    #[test]
    fn silence_does_not_count_as_bad_quality_but_late_answers_add_up() {
        let status = DriverStatus {
            at: 100,
            seconds: vec![second(1000, 5), second(0, 0), second(600, 5)],
            link: serde_json::json!({"controller": "10.0.0.2:5"}),
            ..DriverStatus::default()
        };
        let history = status.history_at(101);
        assert_eq!(
            (history.quality_min_permille, history.quality_mean_permille),
            (300, 800)
        );
        assert_eq!(
            (history.late, history.seconds, history.stale),
            (3, 3, false)
        );
        assert_eq!(history.peer.as_deref(), Some("10.0.0.2:5"));
        assert!(status.history_at(106).stale);
    }

    #[test]
    fn an_older_or_newer_file_is_read_as_far_as_it_goes() -> Result<(), serde_json::Error> {
        let status: DriverStatus =
            serde_json::from_str(r#"{"schema":9,"pid":7,"new":[1],"seconds":[{"late":2}]}"#)?;
        assert_eq!((status.pid, status.seconds[0].late), (7, 2));
        Ok(())
    }
}
