//! `devices`: lists the devices, why one is not ready, and the quality of their connections in the last minute.

use std::collections::BTreeMap;
use std::time::Duration;

use rcc_api::bodies::DeviceView;
use rcc_ipc::Cell;
use rcc_ipc::events::EventReader;
use rcc_os::clock::monotonic_ns;
use rcc_protocol::events::{Event, EventKind, wall_time_before};
use serde::Serialize;

use crate::context::Context;
use crate::doctor::driver_status::{self, DriverStatus, LinkHistory};
use crate::doctor::link::percent;
use crate::doctor::record::age;
use crate::failure::Failure;
use crate::table::{self, grouped};

/// Arguments of `devices`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Also list the channels of each device
    #[arg(long)]
    channels: bool,
}

/// A device as seen by the executor, and its connection as seen by its driver.
#[derive(Serialize)]
struct DeviceRow {
    #[serde(flatten)]
    device: DeviceView,
    /// `None` if no driver is alive.
    history: Option<LinkHistory>,
    /// The executor's last loss of the device, as far as the event log goes back.
    last_lost: Option<LastLoss>,
}

/// A loss of a device, as recorded by the executor.
#[derive(Clone, Debug, Serialize)]
struct LastLoss {
    /// Executor cycle from which the device's ports were null.
    cycle: Option<u64>,
    /// Wall clock time.
    time: String,
    /// CLOCK_MONOTONIC, ns.
    monotonic_ns: u64,
    /// Reason; empty if unknown.
    reason: String,
}

/// Runs the verb.
///
/// # Errors
/// Fails if the loader cannot be reached.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let devices: Vec<DeviceView> = context.client()?.get("/devices")?;
    // A cell on another machine has no folder here.
    let cell = match context.remote {
        Some(_) => None,
        None => Cell::find(context.cell_name()).ok().flatten(),
    };
    let history = |name: &str| Some(DriverStatus::of(cell.as_ref()?, name)?.history());
    let losses = cell.as_ref().map(losses).unwrap_or_default();
    let rows: Vec<DeviceRow> = devices
        .into_iter()
        .map(|device| DeviceRow {
            history: history(&device.name),
            last_lost: losses.get(&device.name).cloned(),
            device,
        })
        .collect();
    context.print(&rows, |rows| list(rows, arguments.channels));
    Ok(())
}

/// Returns the last loss of each device in this run of the cell.
fn losses(cell: &Cell) -> BTreeMap<String, LastLoss> {
    let mut last = BTreeMap::new();
    // An unreadable log counts as empty: the device list is still useful without it.
    let mut events = EventReader::open(&cell.state()).poll().unwrap_or_default();
    let started = |event: &Event| matches!(event.what, EventKind::CellStarted { .. });
    let begin = events.iter().rposition(started).unwrap_or(0);
    // The log of services has no such event, and goes back beyond the machine's start.
    let boot = wall_time_before(Duration::from_nanos(monotonic_ns()));
    for event in events.drain(begin..).filter(|event| event.time >= boot) {
        if let EventKind::DeviceLost { device, reason, .. } = event.what {
            let lost = LastLoss {
                cycle: event.cycle,
                time: event.time,
                monotonic_ns: event.monotonic_ns,
                reason,
            };
            last.insert(device, lost);
        }
    }
    last
}

fn list(rows: &[DeviceRow], channels: bool) -> String {
    let mut parts = vec![devices(rows)];
    if rows.iter().any(|row| row.history.is_some()) {
        parts.push(connections(rows));
    }
    if channels {
        parts.push(channels_of(rows));
    }
    parts.join("\n\n")
}

fn devices(rows: &[DeviceRow]) -> String {
    let heads = [
        "DEVICE", "DRIVER", "STATE", "QUALITY", "LOSSES", "HELD BY", "REASON",
    ];
    let mut table = table::table(&heads);
    for DeviceRow { device, .. } in rows {
        table.add_row([
            device.name.clone(),
            device.driver.clone(),
            device.state.clone(),
            percent(device.quality_permille),
            device.losses.to_string(),
            device.holder.clone().unwrap_or_else(|| "–".to_owned()),
            device.reason.clone(),
        ]);
    }
    table::text(&table)
}

fn connections(rows: &[DeviceRow]) -> String {
    let heads = [
        "DEVICE",
        "LAST MINUTE",
        "MEAN",
        "MIN",
        "LATE",
        "LAST LOST",
        "PEER",
    ];
    let mut table = table::table(&heads);
    for row in rows {
        let DeviceRow {
            device,
            history,
            last_lost: lost,
        } = row;
        let Some(history) = history else { continue };
        table.add_row([
            device.name.clone(),
            history.sparkline.clone(),
            percent(history.quality_mean_permille),
            percent(history.quality_min_permille),
            format!("{} ({})", history.late, history.late_total),
            last_lost(
                history,
                lost.as_ref(),
                [driver_status::now(), monotonic_ns()],
            ),
            history.peer.clone().unwrap_or_else(|| "–".to_owned()),
        ]);
    }
    table::text(&table)
}

/// Describes when the device was last lost, or for how long it was not. Prefers the executor's record, which names the
/// cycle. `now` is the wall clock in seconds and CLOCK_MONOTONIC in nanoseconds.
fn last_lost(history: &LinkHistory, lost: Option<&LastLoss>, now: [u64; 2]) -> String {
    let [now, now_ns] = now;
    if history.stale {
        return "its driver stopped reporting".to_owned();
    }
    if let Some(LastLoss {
        cycle: Some(cycle),
        monotonic_ns,
        ..
    }) = lost
    {
        let seconds = now_ns.saturating_sub(*monotonic_ns) / 1_000_000_000;
        return format!("cycle {}, {} ago", grouped(*cycle), age(seconds));
    }
    match history.lost_at {
        Some(at) => format!("{} ago", age(now.saturating_sub(at))),
        None => format!("not in {}", age(now.saturating_sub(history.since))),
    }
}

fn channels_of(rows: &[DeviceRow]) -> String {
    let mut table = table::table(&["CHANNEL", "KIND", "UNIT", "ON RELEASE"]);
    for DeviceRow { device, .. } in rows {
        for channel in &device.channels {
            table.add_row([
                format!("{}.{}", device.name, channel.name),
                channel.kind.clone(),
                channel.unit.clone(),
                channel.on_release.clone().unwrap_or_default(),
            ]);
        }
    }
    table::text(&table)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(history: Option<LinkHistory>) -> DeviceRow {
        DeviceRow {
            device: DeviceView {
                name: "lwr".to_owned(),
                driver: "fri-lwr".to_owned(),
                state: "ready".to_owned(),
                quality_permille: 1000,
                ..DeviceView::default()
            },
            history,
            last_lost: None,
        }
    }

    #[test]
    fn without_a_driver_there_is_no_history() {
        let text = list(&[row(None)], false);
        assert!(
            text.starts_with("DEVICE") && !text.contains("LAST MINUTE"),
            "{text}"
        );
    }

    #[test]
    fn the_history_shows_the_last_loss_or_the_time_without_one() {
        let mut history = LinkHistory {
            sparkline: "█▇".to_owned(),
            since: 1000,
            late: 1,
            late_total: 12,
            ..LinkHistory::default()
        };
        let now = [1090, 95_000_000_000];
        assert_eq!(last_lost(&history, None, now), "not in 90 s");
        history.lost_at = Some(1030);
        assert_eq!(last_lost(&history, None, now), "60 s ago");
        let lost = LastLoss {
            cycle: Some(81_422),
            time: String::new(),
            monotonic_ns: 35_000_000_000,
            reason: String::new(),
        };
        assert_eq!(
            last_lost(&history, Some(&lost), now),
            "cycle 81 422, 60 s ago"
        );
        let text = list(&[row(Some(history.clone()))], false);
        assert!(text.contains("█▇") && text.contains("1 (12)"), "{text}");
        history.stale = true;
        assert!(last_lost(&history, None, now).contains("stopped reporting"));
    }
}
