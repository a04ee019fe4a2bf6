//! What a device's driver tells about its connection: the file that it writes once a second, read with tolerance.
//! Run by the main thread. The history begins with the driver's life, and says since when.

use rcc_ipc::{Cell, Role};
use rcc_os::{file, wall};
use serde::{Deserialize, Serialize};

/// Bars of a sparkline, from worst to best.
const BARS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
/// A second without any exchange.
const NOTHING: char = '·';
/// Longest file of a driver that is read, bytes; a minute has a few kilobytes.
const FILE_MAX: u64 = 1 << 20;
/// A driver that lives and has not written for so many seconds does not turn.
const STALE_AFTER: u64 = 5;

/// One second of a device's life.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct SecondStats {
    /// Smallest quality, thousandths.
    pub quality_min: u32,
    /// Mean quality, thousandths.
    pub quality_mean: u32,
    /// Exchanges.
    pub exchanges: u64,
    /// Answers that came too late or got lost.
    pub late: u64,
    /// Datagrams refused.
    pub refused: u64,
}

/// The file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct DriverStatus {
    /// Name of the driver.
    pub driver: String,
    /// Its process.
    pub pid: u32,
    /// Seconds since the epoch: when the driver began.
    pub since: u64,
    /// Seconds since the epoch: when this was written.
    pub at: u64,
    /// As the driver sees it.
    pub state: String,
    /// Why it is not ready, 0 = it is.
    pub reason: u32,
    /// The same in words.
    pub reason_words: String,
    /// Newest quality, thousandths.
    pub quality_permille: u32,
    /// Since the driver began, as all that follow.
    pub exchanges: u64,
    /// Answers that came too late or got lost.
    pub late: u64,
    /// Datagrams refused.
    pub refused: u64,
    /// Times without a fresh set-point.
    pub starved: u64,
    /// Times that the device went offline.
    pub losses: u64,
    /// When it did last, seconds since the epoch.
    pub lost_at: Option<u64>,
    /// The last minute, oldest first.
    pub seconds: Vec<SecondStats>,
    /// What only this driver knows.
    pub link: serde_json::Value,
}

/// The history of a device, as `devices` shows it.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct LinkHistory {
    /// Seconds that it covers: at most 60, less after a start of the driver.
    pub seconds: usize,
    /// Smallest quality in it, thousandths.
    pub quality_min_permille: u32,
    /// Mean quality in it, thousandths.
    pub quality_mean_permille: u32,
    /// Late or lost answers in it.
    pub late: u64,
    /// Late or lost answers since the driver started.
    pub late_total: u64,
    /// When the driver began, seconds since the epoch.
    pub since: u64,
    /// When the device went offline last, seconds since the epoch.
    pub lost_at: Option<u64>,
    /// Who is on the other end, where the driver knows.
    pub peer: Option<String>,
    /// The driver lives, but does not tell any more.
    pub stale: bool,
    /// Mean quality second by second, oldest first.
    pub sparkline: String,
}

impl DriverStatus {
    /// What the driver of `device` told last, if there is one that lives.
    #[must_use]
    pub fn of(cell: &Cell, device: &str) -> Option<DriverStatus> {
        let announced = cell.announced(Role::Driver, device).ok().flatten()?;
        let path = cell.drivers_dir().join(format!("{device}.json"));
        let told: DriverStatus = serde_json::from_slice(&file::read(&path, FILE_MAX).ok()?).ok()?;
        // The file of a predecessor is history of somebody else.
        (!announced.liveness().is_dead() && announced.pid == told.pid).then_some(told)
    }

    /// The last minute in figures.
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

/// One sign a second: the mean quality, a dot where nothing was exchanged.
#[must_use]
pub fn sparkline(seconds: &[SecondStats]) -> String {
    let sign = |second: &SecondStats| {
        if second.exchanges == 0 {
            return NOTHING;
        }
        let place = second.quality_mean as usize * (BARS.len() - 1) / 1000;
        BARS[place.min(BARS.len() - 1)]
    };
    seconds.iter().map(sign).collect()
}

/// Seconds since the epoch.
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
    fn a_bar_a_second_and_a_dot_without_exchange() {
        let all = [second(1000, 5), second(0, 5), second(500, 5), second(0, 0)];
        assert_eq!(sparkline(&all), "█▁▄·");
    }

    #[test]
    fn silence_does_not_count_as_bad_quality_but_late_answers_add_up() {
        let told = DriverStatus {
            at: 100,
            seconds: vec![second(1000, 5), second(0, 0), second(600, 5)],
            link: serde_json::json!({"controller": "10.0.0.2:5"}),
            ..DriverStatus::default()
        };
        let history = told.history_at(101);
        assert_eq!(
            (history.quality_min_permille, history.quality_mean_permille),
            (300, 800)
        );
        assert_eq!(
            (history.late, history.seconds, history.stale),
            (3, 3, false)
        );
        assert_eq!(history.peer.as_deref(), Some("10.0.0.2:5"));
        assert!(told.history_at(106).stale);
    }

    #[test]
    fn an_older_or_newer_file_is_read_as_far_as_it_goes() -> Result<(), serde_json::Error> {
        let told: DriverStatus =
            serde_json::from_str(r#"{"schema":9,"pid":7,"new":[1],"seconds":[{"late":2}]}"#)?;
        assert_eq!((told.pid, told.seconds[0].late), (7, 2));
        Ok(())
    }
}
