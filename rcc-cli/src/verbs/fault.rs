//! `fault TARGET EFFECT`: injects a fault into a simulated device (through its simulator's control port) or into a
//! process of the cell (by a signal); only in cells whose devices are simulated.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use rcc_api::codes;
use rcc_config::CellConfig;
use rcc_ipc::{Cell, events};
use rcc_os::process_instance::Liveness;
use rcc_protocol::Role;
use rcc_protocol::announcement::EXECUTOR_LABEL;
use rcc_protocol::events::{EventKind, EventOrigin};
use serde_json::{Value, json};

use crate::cells;
use crate::context::{Context, cell_failure};
use crate::demo::simulator::SimulatorClient;
use crate::failure::Failure;
use crate::supervisor::running;
use effect::{FaultAction, FaultEffect, action};

mod effect;

/// Number of SIGSEGV signals sent until the process dies.
const SEGV_TRIES: u32 = 50;
/// Longest time that `clear` waits for a moving arm.
const REST_LIMIT: Duration = Duration::from_secs(5);

/// Arguments of `fault`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Simulated device (lwr) or process (driver/lwr, executor, loader)
    target: Option<String>,
    /// Fault to inject
    #[command(subcommand)]
    effect: FaultEffect,
}

/// Runs the verb.
///
/// # Errors
/// Fails if the cell has no simulators, the target does not exist, or the simulator refuses.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let (target, effect) = in_order(arguments)?;
    let name = context.cell_name();
    let cell = Cell::find(name).map_err(|error| cell_failure(&error))?;
    let cell = cell.ok_or_else(|| cells::not_found(name))?;
    let config = running::read(&cell)?;
    let (action, description) = action(&effect);
    match action {
        FaultAction::Signal(signal) => send(&cell, &config, &target, signal, &description)?,
        FaultAction::Command(command) => {
            command_simulator(&cell, &config, &target, &command, &description)?
        }
    }
    let done = json!({"target": target, "what": description});
    context.print(&done, |_| match effect {
        FaultEffect::Clear { .. } | FaultEffect::Ack => format!("{target}: faults cleared"),
        _ => format!("{target}: done; see `rcc-cli events` for the effects"),
    });
    Ok(())
}

/// Treats `fault clear lwr` like `fault lwr clear`.
fn in_order(Arguments { target, effect }: Arguments) -> Result<(String, FaultEffect), Failure> {
    let after = match &effect {
        FaultEffect::Clear { device } => device.clone(),
        _ => None,
    };
    match (target, after) {
        (Some(target), None) | (None, Some(target)) => Ok((target, effect)),
        _ => Err(Failure::new(
            codes::BAD_REQUEST,
            "name exactly one device or process",
            "`rcc-cli fault DEVICE EFFECT`, for example `rcc-cli fault lwr estop`",
        )),
    }
}

/// Returns the control port of the simulator of a device.
pub(super) fn control_of(cell: &Cell, config: &CellConfig, device: &str) -> Option<PathBuf> {
    let mut simulators = config.simulators.iter();
    let simulator = simulators.find(|one| one.device.as_deref() == Some(device))?;
    Some(cell.simulator_socket(&simulator.name))
}

fn is_simulated(config: &CellConfig, device: &str) -> bool {
    let mut simulators = config.simulators.iter();
    simulators.any(|one| one.device.as_deref() == Some(device))
}

pub(super) fn not_simulated(what: &str) -> Failure {
    Failure::new(
        codes::NOT_PERMITTED,
        format!(
            "{what} is not simulated in this cell: only simulated devices can be disturbed and set"
        ),
        "start a cell with simulators (`simulators:` with `device:`), for example configs/cells/demo.yaml",
    )
}

fn log_fault(cell: &Cell, target: &str, description: &str) {
    let what = EventKind::FaultInjected {
        target: target.to_owned(),
        what: description.to_owned(),
    };
    events::tell(cell, EventOrigin::Cli, "fault", what);
}

fn command_simulator(
    cell: &Cell,
    config: &CellConfig,
    device: &str,
    command: &Value,
    description: &str,
) -> Result<(), Failure> {
    if config.device(device).is_none() {
        return Err(unknown(config, device));
    }
    let path = control_of(cell, config, device).ok_or_else(|| not_simulated(device))?;
    let failed = |error: std::io::Error| {
        Failure::new(
            codes::PROCESS_FAILED,
            format!("the simulator of {device} at {}: {error}", path.display()),
            "not every simulator supports every fault; see `rcc-cli fault DEVICE --help`",
        )
    };
    let mut simulator = SimulatorClient::connect(&path).map_err(failed)?;
    log_fault(cell, device, description);
    let started = Instant::now();
    loop {
        match simulator.ask(command) {
            Ok(_) => return Ok(()),
            // `clear` and `ack` acknowledge, which the simulator refuses while the arm moves.
            Err(error)
                if error.to_string().contains("still moving") && started.elapsed() < REST_LIMIT =>
            {
                std::thread::sleep(Duration::from_millis(20));
            }
            Err(error) => return Err(failed(error)),
        }
    }
}

fn unknown(config: &CellConfig, target: &str) -> Failure {
    let devices: Vec<&str> = config.devices.iter().map(|one| one.name.as_str()).collect();
    Failure::new(
        codes::BAD_REQUEST,
        format!("unknown target `{target}`"),
        format!(
            "name a device ({}) or a process: driver/DEVICE, executor, loader",
            devices.join(", ")
        ),
    )
}

/// Sends a signal to a process of the cell, found by its announcement.
fn send(
    cell: &Cell,
    config: &CellConfig,
    target: &str,
    signal: Signal,
    description: &str,
) -> Result<(), Failure> {
    let (role, label) = match target.split_once('/') {
        Some(("driver", device)) if config.device(device).is_some() => (Role::Driver, device),
        None if target == "executor" => (Role::Executor, EXECUTOR_LABEL),
        None if target == "loader" => (Role::Loader, "loader"),
        _ => return Err(unknown(config, target)),
    };
    // A driver affects only its own device; executor and loader affect all.
    let mut concerned = config.devices.iter().map(|device| device.name.as_str());
    let real = concerned
        .find(|device| (role != Role::Driver || *device == label) && !is_simulated(config, device));
    if let Some(real) = real {
        return Err(not_simulated(real));
    }
    let not_known = |why: String| Failure::new(codes::PROCESS_FAILED, why, "try again");
    let found = cell.announced(role, label);
    let found = found.map_err(|error| not_known(error.to_string()))?;
    if let Some(Liveness::Unknown(error)) = found.as_ref().map(|found| found.liveness()) {
        return Err(not_known(format!(
            "cannot tell whether {target} runs: {error}"
        )));
    }
    let announced = found
        .filter(|found| found.liveness().is_alive())
        .ok_or_else(|| {
            Failure::new(
                codes::PROCESS_FAILED,
                format!("{target} is not running"),
                "`rcc-cli status` shows the processes of the cell",
            )
        })?;
    let pid = i32::try_from(announced.pid).map_err(|_| unknown(config, target))?;
    log_fault(cell, target, description);
    kill(Pid::from_raw(pid), signal).map_err(|error| {
        Failure::new(
            codes::NOT_PERMITTED,
            format!("{target} (pid {pid}): {error}"),
            "run as the cell's user",
        )
    })?;
    // The first SIGSEGV only removes the handler by which Rust reports stack overflows.
    for _ in 0..SEGV_TRIES {
        if signal != Signal::SIGSEGV || announced.liveness().is_dead() {
            break;
        }
        std::thread::sleep(Duration::from_millis(10));
        // If it died in between, the goal is reached.
        let _ = kill(Pid::from_raw(pid), signal);
    }
    if signal == Signal::SIGSEGV && announced.liveness().is_alive() {
        return Err(Failure::new(
            codes::PROCESS_FAILED,
            format!("{target} (pid {pid}) is still alive after {SEGV_TRIES} signals"),
            format!("`rcc-cli fault {target} kill`"),
        ));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(clap::Parser)]
    struct FaultCommandLine {
        #[command(flatten)]
        arguments: Arguments,
    }

    fn parsed(line: &str) -> (String, FaultAction) {
        let words = std::iter::once("fault").chain(line.split(' '));
        let (target, effect) = in_order(FaultCommandLine::parse_from(words).arguments).unwrap();
        (target, action(&effect).0)
    }

    #[test]
    fn a_line_becomes_a_command_of_the_simulator() {
        for (line, command) in [
            (
                "lwr force 0 0 -20",
                json!({"wrench": {"force": [0.0, 0.0, -20.0], "torque": [0.0, 0.0, 0.0]}}),
            ),
            (
                "lwr loss 10%",
                json!({"network": {"to_pc": {"lost": 0.1}, "from_pc": {"lost": 0.1}}}),
            ),
            (
                "lwr loss 5 --direction to-pc",
                json!({"network": {"to_pc": {"lost": 0.05}, "from_pc": {}}}),
            ),
            (
                "lwr load 2 --centre 0 0 0.1",
                json!({"load": {"mass": 2.0, "centre": [0.0, 0.0, 0.1]}}),
            ),
            ("lwr freeze 200ms", json!({"freeze_ms": 200})),
            ("lwr drives off", json!({"drives": {"on": false}})),
            ("io exception 6", json!({"exception": 6})),
            ("clear lwr", json!("clear")),
            ("lwr clear", json!("clear")),
        ] {
            let target = if line.starts_with("io") { "io" } else { "lwr" };
            assert_eq!(
                parsed(line),
                (target.to_owned(), FaultAction::Command(command)),
                "{line}"
            );
        }
    }

    #[test]
    fn a_process_gets_a_signal() {
        assert_eq!(
            parsed("driver/lwr kill"),
            ("driver/lwr".into(), FaultAction::Signal(Signal::SIGKILL))
        );
        assert_eq!(
            parsed("executor exit"),
            ("executor".into(), FaultAction::Signal(Signal::SIGTERM))
        );
    }

    #[test]
    fn invalid_percentages_are_refused() {
        for part in ["", "x", "101%", "nan"] {
            assert!(
                FaultCommandLine::try_parse_from(["fault", "lwr", "loss", part]).is_err(),
                "{part}"
            );
        }
    }
}
