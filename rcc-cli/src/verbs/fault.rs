//! `fault TARGET EFFECT`: breaks something on purpose, in cells with simulators only: a simulated device (by its
//! simulator's control port) or a process of the cell (by a signal).

use std::net::SocketAddr;
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use rcc_config::CellConfig;
use rcc_ipc::events::{self, Kind, Origin};
use rcc_ipc::{Cell, Role};
use rcc_loader::server::codes;
use rcc_loader::server::executor::EXECUTOR_LABEL;
use serde_json::{Value, json};

use crate::client::no_loader;
use crate::context::{Context, of_cell};
use crate::demo::simulator::Simulator;
use crate::failure::Failure;
use crate::supervisor::running;

/// How often a SIGSEGV is repeated until it is obeyed.
const SEGV_TRIES: u32 = 50;
/// How long `clear` waits for an arm that still moves.
const REST_LIMIT: Duration = Duration::from_secs(5);

/// What to break, and how.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// A simulated device (lwr), or a process: driver/lwr, executor, loader.
    target: Option<String>,
    /// What happens to it.
    #[command(subcommand)]
    effect: Effect,
}

/// What happens.
#[derive(clap::Subcommand, Clone, Debug, PartialEq)]
enum Effect {
    /// Puts an obstacle in the arm's way: a plane with a point on it and its outward normal.
    Wall {
        /// A point of the plane, base frame, m.
        #[arg(long, num_args = 3, value_names = ["X", "Y", "Z"], allow_negative_numbers = true, required = true)]
        point: Vec<f64>,
        /// Its normal, away from the obstacle.
        #[arg(long, num_args = 3, value_names = ["X", "Y", "Z"], allow_negative_numbers = true, required = true)]
        normal: Vec<f64>,
        /// N/m.
        #[arg(long, default_value_t = 5000.0)]
        stiffness: f64,
        /// N s/m.
        #[arg(long, default_value_t = 20.0)]
        damping: f64,
    },
    /// Pushes the flange: force and torque in base axes.
    Force {
        /// N.
        #[arg(num_args = 3, value_names = ["X", "Y", "Z"], allow_negative_numbers = true, required = true)]
        force: Vec<f64>,
        /// N m.
        #[arg(long, num_args = 3, value_names = ["X", "Y", "Z"], allow_negative_numbers = true)]
        torque: Option<Vec<f64>>,
    },
    /// Loses a part of the datagrams.
    Loss {
        /// 10% or 10.
        #[arg(value_parser = percent)]
        part: f64,
        /// Which datagrams.
        #[arg(long, value_enum, default_value = "both")]
        direction: Direction,
    },
    /// Whatever a bad network does to datagrams; each a part of all, 10% or 10.
    Network {
        /// Do not arrive.
        #[arg(long, value_parser = percent, default_value = "0")]
        lost: f64,
        /// Arrive up to 5 cycles later.
        #[arg(long, value_parser = percent, default_value = "0")]
        late: f64,
        /// Arrive twice.
        #[arg(long, value_parser = percent, default_value = "0")]
        duplicated: f64,
        /// Arrive behind the next one.
        #[arg(long, value_parser = percent, default_value = "0")]
        reordered: f64,
        /// Arrive without their end.
        #[arg(long, value_parser = percent, default_value = "0")]
        truncated: f64,
        /// Arrive with other bits.
        #[arg(long, value_parser = percent, default_value = "0")]
        corrupted: f64,
        /// Which datagrams.
        #[arg(long, value_enum, default_value = "both")]
        direction: Direction,
    },
    /// Lets the device be silent for this time.
    Freeze {
        /// 200ms, 2s.
        #[arg(value_parser = super::duration)]
        time: Duration,
    },
    /// Presses the emergency stop.
    Estop,
    /// Releases the emergency stop and acknowledges.
    Ack,
    /// Switches the arm's drives.
    Drives {
        /// On or off.
        #[arg(value_enum)]
        to: Switch,
    },
    /// Lets an I/O station answer every request with this Modbus exception; 0 ends it.
    Exception {
        /// 1 to 11.
        number: u8,
    },
    /// Lets an I/O station answer this much later.
    Delay {
        /// 30ms.
        #[arg(value_parser = super::duration)]
        time: Duration,
    },
    /// Lets an I/O station leave so many requests without an answer.
    Drop {
        /// How many.
        count: u64,
    },
    /// Ends every fault of the device that was asked for; `fault clear lwr` means the same.
    Clear {
        /// The device.
        device: Option<String>,
    },
    /// SIGKILL: the process is gone at once.
    Kill,
    /// SIGSEGV: the process crashes.
    Segv,
    /// SIGSTOP: the process stands still until `continue`.
    Stop,
    /// SIGCONT.
    Continue,
    /// SIGTERM: the process ends in its own way.
    Exit,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Direction {
    /// Measurements and answers.
    Both,
    /// Measurements.
    ToPc,
    /// Answers.
    FromPc,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Switch {
    On,
    Off,
}

/// What is done to a target.
#[derive(Clone, Debug, PartialEq)]
enum Act {
    Signal(Signal),
    Command(Value),
}

/// Does it.
///
/// # Errors
/// The cell has no simulators, the target is not there, or the simulator refuses.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let (target, effect) = in_order(arguments)?;
    let name = context.cell_name();
    let cell = Cell::find(name).map_err(|error| of_cell(&error))?;
    let cell = cell.ok_or_else(|| no_loader(name, ": there is no such cell"))?;
    let config = running::read(&cell)?;
    let (act, words) = act(&effect);
    match act {
        Act::Signal(signal) => send(&cell, &config, &target, signal, words)?,
        Act::Command(command) => command_simulator(&cell, &config, &target, &command, &words)?,
    }
    let done = json!({"target": target, "what": effect_name(&effect)});
    context.print(&done, |_| match effect {
        Effect::Clear { .. } | Effect::Ack => format!("{target}: faults ended"),
        _ => format!("{target}: done; `rcc-cli events` tells what follows"),
    });
    Ok(())
}

/// `fault clear lwr` means `fault lwr clear`.
fn in_order(Arguments { target, effect }: Arguments) -> Result<(String, Effect), Failure> {
    let after = match &effect {
        Effect::Clear { device } => device.clone(),
        _ => None,
    };
    match (target, after) {
        (Some(target), None) | (None, Some(target)) => Ok((target, effect)),
        _ => Err(Failure::new(
            codes::BAD_REQUEST,
            "one device or process is broken at a time",
            "`rcc-cli fault DEVICE EFFECT`, for example `rcc-cli fault lwr estop`",
        )),
    }
}

fn effect_name(effect: &Effect) -> String {
    act(effect).1
}

/// What an effect does, and its words for the event log.
fn act(effect: &Effect) -> (Act, String) {
    let signal = |signal: Signal| (Act::Signal(signal), format!("gets {signal}"));
    let command = |command: Value, words: String| (Act::Command(command), words);
    match effect {
        Effect::Wall {
            point,
            normal,
            stiffness,
            damping,
        } => command(
            json!({"wall": {"point": point, "normal": normal, "stiffness": stiffness, "damping": damping}}),
            format!("has a wall at {point:?}"),
        ),
        Effect::Force { force, torque } => {
            let torque = torque.clone().unwrap_or_else(|| vec![0.0; 3]);
            command(
                json!({"wrench": {"force": force, "torque": torque}}),
                format!("is pushed with {force:?} N, {torque:?} N m"),
            )
        }
        Effect::Loss { part, direction } => command(
            network(json!({"lost": part}), *direction),
            format!("loses {:.0} % of its datagrams", part * 100.0),
        ),
        Effect::Network {
            lost,
            late,
            duplicated,
            reordered,
            truncated,
            corrupted,
            direction,
        } => {
            let rates = json!({
                "lost": lost, "late": late, "late_steps_max": 5, "duplicated": duplicated,
                "reordered": reordered, "truncated": truncated, "corrupted": corrupted,
            });
            command(network(rates, *direction), "has a bad network".to_owned())
        }
        Effect::Freeze { time } => command(
            json!({"freeze_ms": milliseconds(*time)}),
            format!("is silent for {time:?}"),
        ),
        Effect::Estop => command(json!("estop"), "has its emergency stop pressed".to_owned()),
        Effect::Ack => command(json!("ack"), "is acknowledged".to_owned()),
        Effect::Drives { to } => {
            let on = *to == Switch::On;
            let word = if on { "on" } else { "off" };
            command(
                json!({"drives": {"on": on}}),
                format!("has its drives switched {word}"),
            )
        }
        Effect::Exception { number } => command(
            json!({"exception": number}),
            format!("answers with exception {number}"),
        ),
        Effect::Delay { time } => command(
            json!({"delay_ms": milliseconds(*time)}),
            format!("answers {time:?} later"),
        ),
        Effect::Drop { count } => command(
            json!({"drop": count}),
            format!("leaves {count} requests without an answer"),
        ),
        Effect::Clear { .. } => command(json!("clear"), "is freed of all faults".to_owned()),
        Effect::Kill => signal(Signal::SIGKILL),
        Effect::Segv => signal(Signal::SIGSEGV),
        Effect::Stop => signal(Signal::SIGSTOP),
        Effect::Continue => signal(Signal::SIGCONT),
        Effect::Exit => signal(Signal::SIGTERM),
    }
}

fn network(rates: Value, direction: Direction) -> Value {
    let none = json!({});
    let [to_pc, from_pc] = match direction {
        Direction::Both => [rates.clone(), rates],
        Direction::ToPc => [rates, none],
        Direction::FromPc => [none, rates],
    };
    json!({"network": {"to_pc": to_pc, "from_pc": from_pc}})
}

fn milliseconds(time: Duration) -> u64 {
    u64::try_from(time.as_millis()).unwrap_or(u64::MAX)
}

/// The control port of the simulator that plays a device.
fn control_of(config: &CellConfig, device: &str) -> Option<SocketAddr> {
    let mut simulators = config.simulators.iter();
    let simulator = simulators.find(|one| one.device.as_deref() == Some(device))?;
    simulator.control
}

fn is_simulated(config: &CellConfig, device: &str) -> bool {
    let mut simulators = config.simulators.iter();
    simulators.any(|one| one.device.as_deref() == Some(device))
}

fn not_simulated(what: &str) -> Failure {
    Failure::new(
        codes::NOT_PERMITTED,
        format!("{what} is not simulated in this cell: nothing real is broken on purpose"),
        "start a cell with simulators (`simulators:` with `device:`), for example configs/cells/demo.yaml",
    )
}

fn told(cell: &Cell, target: &str, words: &str) {
    let what = Kind::FaultInjected {
        target: target.to_owned(),
        what: words.to_owned(),
    };
    events::tell(cell, Origin::Cli, "fault", what);
}

fn command_simulator(
    cell: &Cell,
    config: &CellConfig,
    device: &str,
    command: &Value,
    words: &str,
) -> Result<(), Failure> {
    if config.device(device).is_none() {
        return Err(unknown(config, device));
    }
    let address = control_of(config, device).ok_or_else(|| not_simulated(device))?;
    let failed = |error: std::io::Error| {
        Failure::new(
            codes::PROCESS_FAILED,
            format!("the simulator of {device} at {address}: {error}"),
            "not every simulator knows every fault; `rcc-cli fault DEVICE --help` says which is for what",
        )
    };
    let mut simulator = Simulator::connect(address.port()).map_err(failed)?;
    told(cell, device, words);
    let begun = Instant::now();
    loop {
        match simulator.ask(command) {
            Ok(_) => return Ok(()),
            // `clear` and `ack` acknowledge, which an arm that moves refuses.
            Err(error)
                if error.to_string().contains("still moves") && begun.elapsed() < REST_LIMIT =>
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
        format!("this cell has no `{target}`"),
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
    words: String,
) -> Result<(), Failure> {
    let (role, label) = match target.split_once('/') {
        Some(("driver", device)) if config.device(device).is_some() => (Role::Driver, device),
        None if target == "executor" => (Role::Executor, EXECUTOR_LABEL),
        None if target == "loader" => (Role::Loader, "loader"),
        _ => return Err(unknown(config, target)),
    };
    // A driver moves its device only; the others are everybody's.
    let mut concerned = config.devices.iter().map(|device| device.name.as_str());
    let real = concerned
        .find(|device| (role != Role::Driver || *device == label) && !is_simulated(config, device));
    if let Some(real) = real {
        return Err(not_simulated(real));
    }
    let found = cell.announced(role, label).ok().flatten();
    let announced = found
        .filter(rcc_ipc::Announcement::is_alive)
        .ok_or_else(|| {
            Failure::new(
                codes::PROCESS_FAILED,
                format!("{target} does not run"),
                "`rcc-cli status` shows the processes of the cell",
            )
        })?;
    let pid = i32::try_from(announced.pid).map_err(|_| unknown(config, target))?;
    told(cell, target, &words);
    kill(Pid::from_raw(pid), signal).map_err(|error| {
        Failure::new(
            codes::NOT_PERMITTED,
            format!("{target} (pid {pid}): {error}"),
            "work as the cell's user",
        )
    })?;
    // The first one only takes away the handler with which Rust tells of a full stack.
    for _ in 0..SEGV_TRIES {
        if signal != Signal::SIGSEGV || !announced.is_alive() {
            break;
        }
        std::thread::sleep(Duration::from_millis(10));
        // Dead in between: that is what was wanted.
        let _ = kill(Pid::from_raw(pid), signal);
    }
    Ok(())
}

fn percent(text: &str) -> Result<f64, String> {
    let number = text.trim().trim_end_matches('%').trim();
    match number.parse::<f64>() {
        Ok(percent) if (0.0..=100.0).contains(&percent) => Ok(percent / 100.0),
        _ => Err(format!("`{text}` is no part of all: write 10% or 10")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(clap::Parser)]
    struct Line {
        #[command(flatten)]
        arguments: Arguments,
    }

    fn parsed(line: &str) -> (String, Act) {
        let words = std::iter::once("fault").chain(line.split(' '));
        let (target, effect) = in_order(Line::parse_from(words).arguments).unwrap();
        (target, act(&effect).0)
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
            ("lwr freeze 200ms", json!({"freeze_ms": 200})),
            ("lwr drives off", json!({"drives": {"on": false}})),
            ("io exception 6", json!({"exception": 6})),
            ("clear lwr", json!("clear")),
            ("lwr clear", json!("clear")),
        ] {
            let target = if line.starts_with("io") { "io" } else { "lwr" };
            assert_eq!(
                parsed(line),
                (target.to_owned(), Act::Command(command)),
                "{line}"
            );
        }
    }

    #[test]
    fn a_process_gets_a_signal() {
        assert_eq!(
            parsed("driver/lwr kill"),
            ("driver/lwr".into(), Act::Signal(Signal::SIGKILL))
        );
        assert_eq!(
            parsed("executor exit"),
            ("executor".into(), Act::Signal(Signal::SIGTERM))
        );
    }

    #[test]
    fn what_is_no_part_of_all_is_refused() {
        for text in ["", "x", "101%", "-1", "nan"] {
            assert!(percent(text).is_err(), "{text}");
        }
    }
}
