//! Configuration and ports of a running cell, in a file of its runtime folder, because automatic ports are stored
//! nowhere else. Written by the supervisor's thread, read by verbs.

use std::collections::BTreeMap;
use std::path::PathBuf;

use rcc_api::codes;
use rcc_config::CellConfig;
use rcc_ipc::Cell;
use rcc_os::file::{self, Readers};
use serde::{Deserialize, Serialize};

use super::processes::PreparedCell;
use crate::failure::Failure;

/// Longest file that is read, bytes; it holds a path and some ports.
const RUNNING_MAX: u64 = 1 << 20;

/// Content of the file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RunningCell {
    /// File of the configuration, absolute.
    pub config: PathBuf,
    /// Numbers of its automatic ports.
    pub ports: BTreeMap<String, u16>,
}

/// Writes the file of a cell.
///
/// # Errors
/// Fails if the file cannot be written.
pub fn write(cell: &Cell, prepared: &PreparedCell) -> Result<(), Failure> {
    let running = RunningCell {
        config: prepared.path.clone(),
        ports: prepared.ports.clone(),
    };
    let path = cell.running_file();
    serde_json::to_vec(&running)
        .map_err(std::io::Error::other)
        .and_then(|text| file::replace(&path, &text, Readers::Owner))
        .map_err(|error| Failure::unreadable(&path.display().to_string(), &error))
}

/// Reads the file and loads the configuration again.
///
/// # Errors
/// Fails if the file does not exist or if the configuration has become invalid.
pub fn read(cell: &Cell) -> Result<CellConfig, Failure> {
    let path = cell.running_file();
    let text = file::read(&path, RUNNING_MAX).map_err(|_| {
        Failure::new(
            codes::NO_LOADER,
            format!("the configuration of cell `{}` is unknown", cell.name()),
            "start it with `rcc-cli up FILE`",
        )
    })?;
    let running: RunningCell = serde_json::from_slice(&text).map_err(|error| {
        let message = format!("{}: {error}", path.display());
        Failure::new(codes::BAD_REQUEST, message, "restart the cell")
    })?;
    CellConfig::load(&running.config, &running.ports)
        .map_err(|faults| Failure::from_faults("invalid configuration", &faults))
}
