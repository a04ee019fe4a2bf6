//! Collects the facts about a device: from its driver if it is alive, or else by listening in its place. Run by the
//! main thread; takes about two seconds.

use std::net::{SocketAddr, TcpStream};
use std::process::Command;
use std::thread;
use std::time::{Duration, Instant};

use rcc_config::{DeviceConfig, DriverConfig, auto_ports};
use rcc_protocol::Role;

use super::{LinkFacts, sockets};
use crate::doctor::driver_status::DriverStatus;
use crate::doctor::requirements::SelectedCell;
use crate::supervisor::paths;

/// Time of listening if no driver runs.
const LISTEN_TIME: Duration = Duration::from_secs(2);
/// Longest time to wait for the driver's next status; drivers write once a second.
const STATUS_TIMEOUT: Duration = Duration::from_secs(3);
const POLL_STEP: Duration = Duration::from_millis(50);
/// Longest time for a server to accept a connection.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(1);

/// Collects all facts about `device`.
#[must_use]
pub fn gather(chosen: &SelectedCell, device: &DeviceConfig) -> LinkFacts {
    let config = &chosen.config;
    let announced = chosen
        .cell
        .as_ref()
        .and_then(|cell| cell.announced(Role::Driver, &device.name).ok().flatten())
        .filter(|announced| !announced.liveness().is_dead());
    let unknown = auto_ports(&chosen.path).unwrap_or_default();
    let unknown = unknown.into_iter().map(|(name, _)| name);
    let mut facts = LinkFacts {
        device: device.name.clone(),
        driver: device.driver.to_string(),
        settings: device.settings.clone(),
        source: config.source.display().to_string(),
        period_ns: config.period_ns,
        unknown_ports: unknown
            .filter(|name| !chosen.ports.contains_key(name))
            .collect(),
        simulated: !config.simulators.is_empty(),
        pid: announced.as_ref().map(|announced| announced.pid),
        interfaces: sockets::interfaces(),
        nic: device.settings["interface"]
            .as_str()
            .and_then(sockets::link_state),
        ..LinkFacts::default()
    };
    if !facts.unknown_ports.is_empty() {
        return facts;
    }
    match (&chosen.cell, facts.pid) {
        (Some(cell), Some(_)) => {
            facts.previous_status = DriverStatus::of(cell, &device.name);
            facts.driver_status = next_status(
                || DriverStatus::of(cell, &device.name),
                facts.previous_status.as_ref(),
            );
        }
        _ => listen(chosen, device, &mut facts),
    }
    let address = |key: &str| {
        device.settings[key]
            .as_str()
            .and_then(|text| text.parse::<SocketAddr>().ok())
    };
    facts.holder = address("listen").and_then(sockets::holder);
    // Some servers accept a single client only: none is tried while a driver exchanges data.
    let exchanges =
        |status: &Option<DriverStatus>| status.as_ref().map_or(0, |status| status.exchanges);
    let works = exchanges(&facts.driver_status) > exchanges(&facts.previous_status);
    facts.connects = address("server").filter(|_| !works).map(|server| {
        TcpStream::connect_timeout(&server, CONNECT_TIMEOUT)
            .map(drop)
            .map_err(|error| error.to_string())
    });
    facts
}

/// Waits for the driver's next status; returns the last one if none arrives.
fn next_status(
    read: impl Fn() -> Option<DriverStatus>,
    before: Option<&DriverStatus>,
) -> Option<DriverStatus> {
    let started = Instant::now();
    loop {
        let now = read();
        let is_new =
            now.is_some() && now.as_ref().map(|status| status.at) != before.map(|status| status.at);
        if is_new || started.elapsed() > STATUS_TIMEOUT {
            return now;
        }
        thread::sleep(POLL_STEP);
    }
}

fn listen(chosen: &SelectedCell, device: &DeviceConfig, facts: &mut LinkFacts) {
    match probe(chosen, device) {
        Ok(probe) => facts.probe = Some(probe),
        Err(reason) => facts.no_probe = Some(reason),
    }
}

fn probe(chosen: &SelectedCell, device: &DeviceConfig) -> Result<serde_json::Value, String> {
    let program = paths::driver(device).map_err(|failure| failure.body.message.clone())?;
    let mut command = Command::new(&program);
    if let DriverConfig::Program(own) = &device.driver {
        command.args(&own.arguments);
    }
    command
        .args(["--cell", &chosen.config.name, "--device", &device.name])
        .arg("--config")
        .arg(&chosen.path)
        .args(["--listen", &LISTEN_TIME.as_millis().to_string()])
        .env_remove("RCC_PORTS");
    for (name, number) in &chosen.ports {
        command.arg("--port").arg(format!("{name}={number}"));
    }
    let output = command
        .output()
        .map_err(|error| format!("{}: {error}", program.display()))?;
    if !output.status.success() {
        return Err(String::from_utf8_lossy(&output.stderr).trim().to_owned());
    }
    serde_json::from_slice(&output.stdout)
        .map_err(|error| format!("{}: {error}", program.display()))
}
