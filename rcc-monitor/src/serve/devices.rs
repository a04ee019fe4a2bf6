//! Diagnosis files of the drivers: quality of the connection in the last minute, and positions of arms. A driver writes
//! its file once a second. Read by the serving thread.

use rcc_ipc::cell::base_dir;
use rcc_os::{file, wall};
use serde_json::{Value, json};

/// Longest file that is read, bytes; a minute takes a few kilobytes.
const FILE_MAX: u64 = 1 << 20;
/// A file that is older than this is of a driver that hangs or is dead, s.
const STALE_AFTER: u64 = 5;

/// Reads the file of a device; `None` if there is none, or if it is old.
#[must_use]
pub fn diagnosis(cell: &str, device: &str) -> Option<Value> {
    // Names of devices have no slash; `/drivers/` is `Cell::drivers_dir`, which would create the folder.
    let path = base_dir()
        .join(cell)
        .join("drivers")
        .join(format!("{device}.json"));
    let value: Value = serde_json::from_slice(&file::read(&path, FILE_MAX).ok()?).ok()?;
    let age = wall::seconds().saturating_sub(value["at"].as_u64()?);
    (age <= STALE_AFTER).then_some(value)
}

/// Adds the history of the connection to each device.
#[must_use]
pub fn with_history(cell: &str, mut rows: Value) -> Value {
    for row in rows.as_array_mut().into_iter().flatten() {
        let Some(found) = row["name"].as_str().and_then(|name| diagnosis(cell, name)) else {
            continue;
        };
        let seconds = found["seconds"].as_array().cloned().unwrap_or_default();
        let of = |name: &str| -> Vec<Value> {
            seconds.iter().map(|second| second[name].clone()).collect()
        };
        row["history"] = json!({
            "quality": of("quality_mean"), "late": of("late"), "exchanges": of("exchanges"), "peer": found["link"]["peer"],
            "late_total": found["late"], "refused_total": found["refused"], "starved_total": found["starved"],
        });
    }
    rows
}
