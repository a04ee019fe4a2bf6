//! The link of a cell to others: read from `rcc-link doctor`, which speaks TLS. Run by the main thread.

use std::path::Path;
use std::process::Command;

use rcc_config::CellConfig;
use serde::Deserialize;

use crate::doctor::link::peer::PROGRAM;
use crate::doctor::{FindingLevel, HealthFinding};
use crate::supervisor::paths;

/// A finding of `rcc-link doctor --json`.
#[derive(Deserialize)]
struct LinkFinding {
    level: FindingLevel,
    of: String,
    what: String,
}

/// Verifies the link of a cell and its link devices; no findings for a cell without them.
///
/// # Errors
/// Fails with the reason if `rcc-link` is not there or gives no findings.
pub fn read(config: &CellConfig, file: &Path) -> Result<Vec<HealthFinding>, String> {
    let is_link = |driver: String| driver.rsplit('/').next() == Some(PROGRAM);
    let mut devices = config.devices.iter();
    if config.link.is_none() && !devices.any(|device| is_link(device.driver.to_string())) {
        return Ok(Vec::new());
    }
    let program = paths::program("rcc-link").map_err(|failure| failure.body.message.clone())?;
    let mut command = Command::new(&program);
    let command = command.args(["doctor", "--json", "--config"]).arg(file);
    let output = command
        .output()
        .map_err(|error| format!("{}: {error}", program.display()))?;
    let findings: Vec<LinkFinding> = serde_json::from_slice(&output.stdout).map_err(|_| {
        let words = String::from_utf8_lossy(&output.stderr);
        format!("{}: {}", program.display(), words.trim())
    })?;
    Ok(findings.into_iter().map(finding).collect())
}

fn finding(LinkFinding { level, of, what }: LinkFinding) -> HealthFinding {
    HealthFinding {
        level,
        // The remedy is in the words.
        fix: (level >= FindingLevel::Warn).then(|| "follow the message".to_owned()),
        ..HealthFinding::ok(format!("{of}: {what}"))
    }
}
