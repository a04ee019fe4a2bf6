//! The summary of a cell on the fleet's screen: published once a second and at each change. JSON, so that any program
//! of the network can read it. Pure.

use rcc_api::bodies::{CommandView, DeviceView, EventView, StatusView};
use serde::{Deserialize, Serialize};

/// Longest overview that is read, bytes.
const BYTES_MAX: usize = 8192;
/// Nets that are named.
const NETS_MAX: usize = 8;
/// Characters of a sentence.
const WORDS_MAX: usize = 200;

/// State of a cell.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct CellOverview {
    /// Why there is nothing else: executor or loader does not answer. Empty if they do.
    pub problem: String,
    /// Number of the newest cycle.
    pub cycle: u64,
    /// Late cycles that nobody has acknowledged.
    pub late: u64,
    /// Active nets, as `net#id`; at most 8 are named.
    pub nets: Vec<String>,
    /// Number of active nets.
    pub nets_count: usize,
    /// Devices that are not ready, with their states: `arm offline`.
    pub lost: Vec<String>,
    /// First problem of the configuration; empty if there is none.
    pub configuration: String,
    /// Newest event.
    pub event: Option<OverviewEvent>,
}

/// An event in an overview.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct OverviewEvent {
    /// Wall time, UTC.
    pub time: String,
    /// `info`, `warning` or `error`.
    pub severity: String,
    /// In words.
    pub words: String,
}

impl CellOverview {
    /// Makes the overview of a cell that answers.
    #[must_use]
    pub fn new(
        status: &StatusView,
        commands: &[CommandView],
        devices: &[DeviceView],
        event: Option<&EventView>,
    ) -> CellOverview {
        let executor = &status.executor;
        let active = commands.iter().filter(|row| row.is_active());
        let nets: Vec<String> = active
            .map(|row| format!("{}#{}", row.net, row.id))
            .collect();
        let is_lost = |device: &&DeviceView| {
            !["ready", "commanded", "stopping"].contains(&device.state.as_str())
        };
        let lost = devices.iter().filter(is_lost);
        let problem = status.configuration.first();
        CellOverview {
            problem: String::new(),
            cycle: executor.cycle,
            late: executor.late.saturating_sub(executor.late_acknowledged),
            nets_count: nets.len(),
            nets: nets.into_iter().take(NETS_MAX).collect(),
            lost: lost
                .map(|device| format!("{} {}", device.name, device.state))
                .collect(),
            configuration: problem.map_or_else(String::new, |words| short(words)),
            event: event.map(|event| OverviewEvent {
                time: event.time.clone(),
                severity: event.severity.clone(),
                words: short(&event.words),
            }),
        }
    }

    /// Makes the overview of a cell that does not answer.
    #[must_use]
    pub fn of_problem(words: &str) -> CellOverview {
        CellOverview {
            problem: short(words),
            ..CellOverview::default()
        }
    }

    /// Reads an overview; `None` for everything else.
    #[must_use]
    pub fn read(bytes: &[u8]) -> Option<CellOverview> {
        let bytes = Some(bytes).filter(|bytes| bytes.len() <= BYTES_MAX)?;
        serde_json::from_slice(bytes).ok()
    }
}

/// Returns the first line, shortened.
fn short(words: &str) -> String {
    words
        .lines()
        .next()
        .unwrap_or_default()
        .chars()
        .take(WORDS_MAX)
        .collect()
}
