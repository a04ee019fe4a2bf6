//! `devices`: the devices of the cell, why one is not ready, and what their connections were like in the last minute.

use rcc_ipc::Cell;
use rcc_loader::server::api::DeviceView;
use serde::Serialize;

use crate::context::Context;
use crate::doctor::link::percent;
use crate::doctor::record::age;
use crate::doctor::told::{self, History, Told};
use crate::failure::Failure;
use crate::table;

/// Nothing more to say.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// The channels of each device, too.
    #[arg(long)]
    channels: bool,
}

/// A device as the executor sees it, and its connection as its driver does.
#[derive(Serialize)]
struct Row {
    #[serde(flatten)]
    device: DeviceView,
    /// None without a living driver.
    history: Option<History>,
}

/// Does it.
///
/// # Errors
/// Not reachable.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let devices: Vec<DeviceView> = context.client()?.get("/devices")?;
    // A cell on another machine has no folder here, and no history.
    let cell = Cell::find(context.cell_name()).ok().flatten();
    let history = |name: &str| Some(Told::of(cell.as_ref()?, name)?.history());
    let rows: Vec<Row> = devices
        .into_iter()
        .map(|device| Row {
            history: history(&device.name),
            device,
        })
        .collect();
    context.print(&rows, |rows| list(rows, arguments.channels));
    Ok(())
}

fn list(rows: &[Row], channels: bool) -> String {
    let mut parts = vec![devices(rows)];
    if rows.iter().any(|row| row.history.is_some()) {
        parts.push(connections(rows));
    }
    if channels {
        parts.push(channels_of(rows));
    }
    parts.join("\n\n")
}

fn devices(rows: &[Row]) -> String {
    let heads = ["DEVICE", "DRIVER", "STATE", "QUALITY", "LOSSES", "HELD BY", "REASON"];
    let mut table = table::table(&heads);
    for Row { device, .. } in rows {
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

fn connections(rows: &[Row]) -> String {
    let heads = ["DEVICE", "LAST MINUTE", "MEAN", "MIN", "LATE", "LAST LOST", "PEER"];
    let mut table = table::table(&heads);
    for Row { device, history } in rows {
        let Some(history) = history else { continue };
        table.add_row([
            device.name.clone(),
            history.sparkline.clone(),
            percent(history.quality_mean_permille),
            percent(history.quality_min_permille),
            format!("{} ({})", history.late, history.late_total),
            last_lost(history, told::now()),
            history.peer.clone().unwrap_or_else(|| "–".to_owned()),
        ]);
    }
    table::text(&table)
}

/// When, or since when not.
fn last_lost(history: &History, now: u64) -> String {
    if history.stale {
        return "its driver tells nothing any more".to_owned();
    }
    match history.lost_at {
        Some(at) => format!("{} ago", age(now.saturating_sub(at))),
        None => format!("not in {}", age(now.saturating_sub(history.since))),
    }
}

fn channels_of(rows: &[Row]) -> String {
    let mut table = table::table(&["CHANNEL", "KIND", "UNIT", "ON RELEASE"]);
    for Row { device, .. } in rows {
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

    fn row(history: Option<History>) -> Row {
        Row {
            device: DeviceView {
                name: "lwr".to_owned(),
                driver: "fri-lwr".to_owned(),
                state: "ready".to_owned(),
                quality_permille: 1000,
                ..DeviceView::default()
            },
            history,
        }
    }

    #[test]
    fn without_a_driver_there_is_no_history() {
        let text = list(&[row(None)], false);
        assert!(text.starts_with("DEVICE") && !text.contains("LAST MINUTE"), "{text}");
    }

    #[test]
    fn the_history_says_how_long_nothing_was_lost_or_when() {
        let mut history = History {
            sparkline: "█▇".to_owned(),
            since: 1000,
            late: 1,
            late_total: 12,
            ..History::default()
        };
        assert_eq!(last_lost(&history, 1090), "not in 90 s");
        history.lost_at = Some(1030);
        assert_eq!(last_lost(&history, 1090), "60 s ago");
        let text = list(&[row(Some(history.clone()))], false);
        assert!(text.contains("█▇") && text.contains("1 (12)"), "{text}");
        history.stale = true;
        assert!(last_lost(&history, 1090).contains("nothing any more"));
    }
}
