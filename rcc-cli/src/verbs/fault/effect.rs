//! The faults that there are, as arguments and as what they do: a command for a simulator, or a signal.
//! Pure.

use std::time::Duration;

use nix::sys::signal::Signal;
use serde_json::{Value, json};

/// What happens.
#[derive(clap::Subcommand, Clone, Debug, PartialEq)]
pub enum FaultEffect {
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
        direction: DatagramDirection,
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
        direction: DatagramDirection,
    },
    /// Lets the device be silent for this time.
    Freeze {
        /// 200ms, 2s.
        #[arg(value_parser = crate::verbs::duration)]
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
        to: OnOff,
    },
    /// Lets an I/O station answer every request with this Modbus exception; 0 ends it.
    Exception {
        /// 1 to 11.
        number: u8,
    },
    /// Lets an I/O station answer this much later.
    Delay {
        /// 30ms.
        #[arg(value_parser = crate::verbs::duration)]
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

/// Whose datagrams.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum DatagramDirection {
    /// Measurements and answers.
    Both,
    /// Measurements.
    ToPc,
    /// Answers.
    FromPc,
}

/// A switch.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum OnOff {
    /// On.
    On,
    /// Off.
    Off,
}

/// What is done to a target.
#[derive(Clone, Debug, PartialEq)]
pub enum FaultAction {
    /// A signal for a process.
    Signal(Signal),
    /// A command for a simulator.
    Command(Value),
}

/// What an effect does, and its words for the event log.
pub fn action(effect: &FaultEffect) -> (FaultAction, String) {
    let signal = |signal: Signal| (FaultAction::Signal(signal), format!("gets {signal}"));
    match effect {
        FaultEffect::Kill => signal(Signal::SIGKILL),
        FaultEffect::Segv => signal(Signal::SIGSEGV),
        FaultEffect::Stop => signal(Signal::SIGSTOP),
        FaultEffect::Continue => signal(Signal::SIGCONT),
        FaultEffect::Exit => signal(Signal::SIGTERM),
        device => {
            let (command, words) = command(device);
            (FaultAction::Command(command), words)
        }
    }
}

/// What a simulator is told.
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

/// As [`command`], for the effects that need few words.
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
            format!("answers {time:?} later"),
        ),
        FaultEffect::Drop { count } => (
            json!({"drop": count}),
            format!("leaves {count} requests without an answer"),
        ),
        FaultEffect::Clear { .. } => (json!("clear"), "is freed of all faults".to_owned()),
        // Signals never come here.
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
