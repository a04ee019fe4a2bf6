//! The link of a cell to others: read from `rcc-link doctor`, which speaks TLS. Run by the main thread.

use std::process::Command;

use rcc_api::findings::LinkFinding;
use rcc_config::link::is_link_device;

use crate::doctor::requirements::SelectedCell;
use crate::doctor::{FindingLevel, HealthFinding};
use crate::supervisor::paths;

/// Verifies the link of a cell and its link devices; no findings for a cell without them, and a warning if `rcc-link` is not there or
/// gives no findings.
#[must_use]
pub fn read(selected: &SelectedCell) -> Vec<HealthFinding> {
    let SelectedCell {
        config,
        path: file,
        ports,
        ..
    } = selected;
    let mut devices = config.devices.iter();
    if config.link.is_none() && !devices.any(|device| is_link_device(&device.driver)) {
        return Vec::new();
    }
    let ports = ports.iter();
    let ports: Vec<String> = ports
        .map(|(name, number)| format!("--port={name}={number}"))
        .collect();
    let again = ["rcc-link", "--cell", &config.name, "doctor", "--config"].map(str::to_owned);
    let again = [&again[..], &[file.display().to_string()], &ports]
        .concat()
        .join(" ");
    let not_verified = |reason: &str, fix: String| {
        let what = format!("the link to other cells is not verified: {reason}");
        vec![HealthFinding::warn(what, fix)]
    };
    let program = match paths::program("rcc-link") {
        Ok(program) => program,
        Err(failure) => {
            let fix = "build it (`cargo build --release -p rcc-link`) and put it beside rcc-cli";
            return not_verified(&failure.body.message, fix.to_owned());
        }
    };
    let mut command = Command::new(&program);
    let command = command.args(["--cell", &config.name, "doctor", "--json", "--config"]);
    let output = match command
        .arg(file)
        .args(ports)
        .env_remove("RCC_PORTS")
        .output()
    {
        Ok(output) => output,
        Err(error) => return not_verified(&format!("{}: {error}", program.display()), again),
    };
    match serde_json::from_slice::<Vec<LinkFinding>>(&output.stdout) {
        Ok(findings) => {
            let findings = findings.into_iter();
            findings.map(|it| finding(it, &again)).collect()
        }
        Err(_) => {
            let words = String::from_utf8_lossy(&output.stderr);
            let reason = format!(
                "{} ended with {}: {}",
                program.display(),
                output.status,
                words.trim()
            );
            not_verified(
                &reason,
                format!("use the rcc-link of this build; `{again}` says more"),
            )
        }
    }
}

fn finding(LinkFinding { level, of, what }: LinkFinding, again: &str) -> HealthFinding {
    HealthFinding {
        level,
        // The words say what to do.
        fix: (level >= FindingLevel::Warn).then(|| format!("then again: `{again}`")),
        ..HealthFinding::ok(format!("{of}: {what}"))
    }
}
