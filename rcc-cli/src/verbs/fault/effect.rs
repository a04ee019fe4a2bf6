//! The injectable faults: their arguments, and the simulator command or signal that each stands for. Pure.

use std::time::Duration;

use nix::sys::signal::Signal;
use rcc_core::counted::Counted;
use serde_json::{Value, json};

use crate::simulate::wall::{WALL_DAMPING, WALL_STIFFNESS};

/// Fault to inject.
#[derive(clap::Subcommand, Clone, Debug, PartialEq)]
pub enum FaultEffect {
    /// Place an obstacle in the arm's way: a plane given by a point and its outward normal
    Wall {
        /// Point of the plane, base frame, m
        #[arg(long, num_args = 3, value_names = ["X", "Y", "Z"], allow_negative_numbers = true, required = true)]
        point: Vec<f64>,
        /// Normal that points away from the obstacle
        #[arg(long, num_args = 3, value_names = ["X", "Y", "Z"], allow_negative_numbers = true, required = true)]
        normal: Vec<f64>,
        /// Stiffness, N/m
        #[arg(long, default_value_t = WALL_STIFFNESS)]
        stiffness: f64,
        /// Damping, N s/m
        #[arg(long, default_value_t = WALL_DAMPING)]
        damping: f64,
    },
    /// Load the flange with a mass that the controller does not know about
    Load {
        /// Mass, kg
        mass: f64,
        /// Centre of mass in the flange frame, m
        #[arg(long, num_args = 3, value_names = ["X", "Y", "Z"], allow_negative_numbers = true)]
        centre: Option<Vec<f64>>,
    },
    /// Push the flange with a force and torque in base axes
    Force {
        /// Force, N
        #[arg(num_args = 3, value_names = ["X", "Y", "Z"], allow_negative_numbers = true, required = true)]
        force: Vec<f64>,
        /// Torque, N m
        #[arg(long, num_args = 3, value_names = ["X", "Y", "Z"], allow_negative_numbers = true)]
        torque: Option<Vec<f64>>,
    },
    /// Drop a percentage of the datagrams
    Loss {
        /// Percentage: 10% or 10
        #[arg(value_parser = percent)]
        part: f64,
        /// Affected datagrams
        #[arg(long, value_enum, default_value = "both")]
        direction: DatagramDirection,
    },
    /// Disturb the network; each rate is a percentage of the datagrams, 10% or 10
    Network {
        /// Lost
        #[arg(long, value_parser = percent, default_value = "0")]
        lost: f64,
        /// Late by up to 5 cycles
        #[arg(long, value_parser = percent, default_value = "0")]
        late: f64,
        /// Duplicated
        #[arg(long, value_parser = percent, default_value = "0")]
        duplicated: f64,
        /// Reordered with the next one
        #[arg(long, value_parser = percent, default_value = "0")]
        reordered: f64,
        /// Truncated
        #[arg(long, value_parser = percent, default_value = "0")]
        truncated: f64,
        /// Corrupted
        #[arg(long, value_parser = percent, default_value = "0")]
        corrupted: f64,
        /// Affected datagrams
        #[arg(long, value_enum, default_value = "both")]
        direction: DatagramDirection,
    },
    /// Silence the device for some time
    Freeze {
        /// Duration: 200ms, 2s
        #[arg(value_parser = crate::duration::duration)]
        time: Duration,
    },
    /// Press the emergency stop
    Estop,
    /// Release the emergency stop and acknowledge
    Ack,
    /// Switch the arm's drives
    Drives {
        /// on or off
        #[arg(value_enum)]
        to: OnOff,
    },
    /// Answer every I/O request with this Modbus exception; 0 ends it
    Exception {
        /// Exception code, 1 to 11
        number: u8,
    },
    /// Delay the answers of an I/O station
    Delay {
        /// Delay: 30ms
        #[arg(value_parser = crate::duration::duration)]
        time: Duration,
    },
    /// Ignore some requests to an I/O station
    Drop {
        /// Number of requests
        count: u64,
    },
    /// Clear all injected faults of the device; also written `fault clear lwr`
    Clear {
        /// Device
        device: Option<String>,
    },
    /// Kill the process (SIGKILL)
    Kill,
    /// Crash the process (SIGSEGV)
    Segv,
    /// Suspend the process until `continue` (SIGSTOP)
    Stop,
    /// Continue the process (SIGCONT)
    Continue,
    /// Ask the process to end (SIGTERM)
    Exit,
}

/// Affected datagrams.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum DatagramDirection {
    /// Measurements and answers
    Both,
    /// Measurements
    ToPc,
    /// Answers
    FromPc,
}

/// State of a switch.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum OnOff {
    /// On
    On,
    /// Off
    Off,
}

/// Action on a target.
#[derive(Clone, Debug, PartialEq)]
pub enum FaultAction {
    /// Signal to send to a process.
    Signal(Signal),
    /// Command to send to a simulator.
    Command(Value),
}

/// Returns the action of an effect, and its description for the event log.
pub fn action(effect: &FaultEffect) -> (FaultAction, String) {
    let signal = |signal: Signal| (FaultAction::Signal(signal), format!("gets {signal}"));
    match effect {
        FaultEffect::Kill => signal(Signal::SIGKILL),
        FaultEffect::Segv => signal(Signal::SIGSEGV),
        FaultEffect::Stop => signal(Signal::SIGSTOP),
        FaultEffect::Continue => signal(Signal::SIGCONT),
        FaultEffect::Exit => signal(Signal::SIGTERM),
        device => {
            let (command, description) = command(device);
            (FaultAction::Command(command), description)
        }
    }
}

/// Returns the simulator command of an effect, and its description.
fn command(effect: &FaultEffect) -> (Value, String) {
    match effect {
        FaultEffect::Wall {
            point,
            normal,
            stiffness,
            damping,
        } => (
            json!({"wall": {"point": point, "normal": normal, "stiffness": stiffness, "damping": damping}}),
            format!("has a wall at {point:?}"),
        ),
        FaultEffect::Load { mass, centre } => {
            let centre = centre.clone().unwrap_or_else(|| vec![0.0; 3]);
            (
                json!({"load": {"mass": mass, "centre": centre}}),
                format!("carries {mass} kg"),
            )
        }
        FaultEffect::Force { force, torque } => {
            let torque = torque.clone().unwrap_or_else(|| vec![0.0; 3]);
            (
                json!({"wrench": {"force": force, "torque": torque}}),
                format!("is pushed with {force:?} N, {torque:?} N m"),
            )
        }
        FaultEffect::Loss { part, direction } => (
            network(json!({"lost": part}), *direction),
            format!("loses {:.0} % of its datagrams", part * 100.0),
        ),
        FaultEffect::Network {
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
            (network(rates, *direction), "has a bad network".to_owned())
        }
        other => short_command(other),
    }
}

/// Like [`command`], for the simpler effects.
fn short_command(effect: &FaultEffect) -> (Value, String) {
    match effect {
        FaultEffect::Freeze { time } => (
            json!({"freeze_ms": milliseconds(*time)}),
            format!("is silent for {time:?}"),
        ),
        FaultEffect::Estop => (json!("estop"), "has its emergency stop pressed".to_owned()),
        FaultEffect::Ack => (json!("ack"), "is acknowledged".to_owned()),
        FaultEffect::Drives { to } => {
            let on = *to == OnOff::On;
            let word = if on { "on" } else { "off" };
            (
                json!({"drives": {"on": on}}),
                format!("has its drives switched {word}"),
            )
        }
        FaultEffect::Exception { number } => (
            json!({"exception": number}),
            format!("answers with exception {number}"),
        ),
        FaultEffect::Delay { time } => (
            json!({"delay_ms": milliseconds(*time)}),
            format!("answers {time:?} late"),
        ),
        FaultEffect::Drop { count } => (
            json!({"drop": count}),
            format!("ignores {}", Counted(*count, "request")),
        ),
        FaultEffect::Clear { .. } => (json!("clear"), "has all faults cleared".to_owned()),
        // Signals are handled by [`action`].
        _ => (Value::Null, String::new()),
    }
}

fn network(rates: Value, direction: DatagramDirection) -> Value {
    let none = json!({});
    let [to_pc, from_pc] = match direction {
        DatagramDirection::Both => [rates.clone(), rates],
        DatagramDirection::ToPc => [rates, none],
        DatagramDirection::FromPc => [none, rates],
    };
    json!({"network": {"to_pc": to_pc, "from_pc": from_pc}})
}

fn milliseconds(time: Duration) -> u64 {
    u64::try_from(time.as_millis()).unwrap_or(u64::MAX)
}

fn percent(text: &str) -> Result<f64, String> {
    let number = text.trim().trim_end_matches('%').trim();
    match number.parse::<f64>() {
        Ok(percent) if (0.0..=100.0).contains(&percent) => Ok(percent / 100.0),
        _ => Err(format!("invalid percentage `{text}`: write 10% or 10")),
    }
}
