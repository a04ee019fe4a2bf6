//! The command line of `iiwa-sim`. Thresholds that KUKA does not publish are our own, and marked as such.
//! Read once, by the main thread.

use super::JOINTS;
use super::control::{SpringError, springs};
use super::robot::ArmKind;
use super::settings::{MotionStart, OverlayError, OverlayMode, Selector, Settings};
use super::station::{SignalLoopback, StationSignal};
use crate::fri_iiwa::wire::{IO_MAX, Version};
use crate::sim::arm::command_stream::SupervisedLimits;
use crate::sim::arm::impedance::ControlLaw;
use crate::sim::number_list::NumberList;
use crate::sim::robot_options::{RobotOptionError, RobotOptions};
use clap::Parser;

/// A simulated Sunrise Cabinet with a KUKA LBR iiwa or LBR Med: speaks FRI 1.11 to 2.7 over UDP, sends first, and moves a
/// simulated arm. Its application opens a session and holds the position with an FRI overlay.
#[derive(Clone, Debug, Parser)]
#[command(name = "iiwa-sim", version = rcc_protocol::version::version())]
pub struct Options {
    /// What every simulated arm has.
    #[command(flatten)]
    pub robot: RobotOptions,
    /// Version of FRI: 1.11, 1.14, 1.15, 1.16, 2.5 or 2.7
    #[arg(long, value_name = "VERSION", value_parser = version)]
    pub fri: Version,
    /// Arm
    #[arg(long, value_enum, default_value = "iiwa7")]
    pub arm: ArmKind,
    /// Send period, ms
    #[arg(long, value_name = "1..100", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=100))]
    pub period_ms: u32,
    /// Receive multiplier: the client answers each such message; commanding needs an answer every 10 ms
    #[arg(long, value_name = "1..100", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=100))]
    pub multiplier: u32,
    /// Controller of the joints while a motion runs: under impedance control the arm yields; the springs are the
    /// application's, FRI does not command them
    #[arg(long, value_enum, default_value = "position")]
    pub law: ControlLaw,
    /// Quantity that the client commands: wrench needs --law=cartesian-impedance, torque --law=joint-impedance,
    /// cartesian-pose version 2.5 or 2.7
    #[arg(long, value_enum, default_value = "position")]
    pub overlay: OverlayMode,
    /// Stiffness: seven numbers for joints (N·m/rad), six for x y z rx ry rz (N/m, N·m/rad). Default: 1000 for a joint,
    /// 2000 and 200
    #[arg(long, value_name = "K,…", value_delimiter = ',')]
    pub stiffness: Option<Vec<f64>>,
    /// Damping ratio of each spring. Default: 0.7
    #[arg(long, value_name = "RATIO")]
    pub damping: Option<f64>,
    /// When the application starts a motion: as soon as its conditions hold, and again 0.5 s after a fault (our own
    /// value), or at a request of the control port
    #[arg(long, value_enum, default_value = "auto")]
    pub motion: MotionStart,
    /// Answers with which the robot synchronises before it executes commands (our own value)
    #[arg(long, value_name = "COUNT", default_value_t = 10)]
    pub synchronising: u32,
    /// Operating mode; in T1 the flange may not be faster than 250 mm/s
    #[arg(long, value_enum, default_value = "aut")]
    pub mode: Selector,
    /// Supervised accelerations, degrees/s². Default: ten times the velocities (our own values: KUKA publishes none)
    #[arg(long, value_name = "A1,…,A7")]
    pub acceleration_limits: Option<NumberList<JOINTS>>,
    /// An input or output of the station: boolean, digital or analog, and input or output as the client sees it; at most
    /// ten
    #[arg(long, value_name = "GROUP.NAME=TYPE:DIRECTION")]
    pub io: Vec<StationSignal>,
    /// Loops an output of the station back to an input
    #[arg(long, value_name = "OUTPUT=INPUT")]
    pub wire_io: Vec<SignalLoopback>,
}

fn version(text: &str) -> Result<Version, String> {
    text.parse()
        .map_err(|()| "write 1.11, 1.14, 1.15, 1.16, 2.5 or 2.7".to_owned())
}

/// Why an option is refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum OptionError {
    /// An option that every simulated arm has.
    #[error(transparent)]
    Robot(#[from] RobotOptionError),
    /// The overlay does not fit the control law or the version.
    #[error("--overlay: {0}")]
    Overlay(#[from] OverlayError),
    /// The springs are out of range.
    #[error("--stiffness, --damping: {0}")]
    Springs(#[from] SpringError),
    /// Inputs and outputs in a version without them, or too many of them.
    #[error("--io: a message of this version has {0} inputs and outputs at most")]
    Signals(usize),
    /// The same name twice.
    #[error("--io: `{0}` is given twice")]
    Twice(String),
    /// A loopback of unknown signals.
    #[error("--wire-io: the station has no signal `{0}` of this direction: give it with --io")]
    Loopback(String),
}

impl Options {
    /// Returns the cabinet's settings.
    ///
    /// # Errors
    /// Returns an error for the first option that does not fit.
    pub fn settings(&self) -> Result<Settings, OptionError> {
        self.check_signals()?;
        self.overlay.check(self.law, self.fri)?;
        Ok(Settings {
            version: self.fri,
            arm: self.arm,
            period_ms: self.period_ms,
            multiplier: self.multiplier,
            law: self.law,
            overlay: self.overlay,
            impedance: springs(self.law, self.stiffness.as_deref(), self.damping)?,
            motion: self.motion,
            synchronising_answers: self.synchronising,
            selector: self.mode,
            signals: self.io.clone(),
            loopbacks: self.wire_io.clone(),
            robot: self.robot.settings(self.limits())?,
        })
    }

    fn check_signals(&self) -> Result<(), OptionError> {
        use crate::fri_iiwa::wire::IoDirection::{Input, Output};
        let most = if self.fri.has_io() { IO_MAX } else { 0 };
        if self.io.len() > most {
            return Err(OptionError::Signals(most));
        }
        for (place, signal) in self.io.iter().enumerate() {
            if self.io[..place]
                .iter()
                .any(|other| other.name == signal.name)
            {
                return Err(OptionError::Twice(signal.name.clone()));
            }
        }
        let is_known = |name: &str, direction| {
            let mut signals = self.io.iter();
            signals.any(|signal| signal.name == name && signal.direction == direction)
        };
        for SignalLoopback { output, input } in &self.wire_io {
            for (name, direction) in [(output, Output), (input, Input)] {
                if !is_known(name, direction) {
                    return Err(OptionError::Loopback(name.clone()));
                }
            }
        }
        Ok(())
    }

    fn limits(&self) -> SupervisedLimits {
        let mut limits = self.arm.limits();
        if let Some(NumberList(accelerations)) = self.acceleration_limits {
            limits.acceleration = accelerations.map(f64::to_radians);
        }
        limits
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(more: &[&str]) -> Options {
        let always = ["iiwa-sim", "--driver=127.0.0.1:1"];
        let words = always.iter().chain(more);
        Options::try_parse_from(words).unwrap_or_else(|error| panic!("{error}"))
    }

    #[test]
    fn the_defaults_are_those_of_the_settings() {
        let settings = parsed(&["--fri=1.15"]).settings();
        assert_eq!(settings, Ok(Settings::default()));
    }

    #[test]
    fn what_does_not_fit_is_refused_by_name() {
        for (more, words) in [
            (&["--fri=2.7", "--bandwidth=nan"][..], "--bandwidth"),
            (&["--fri=2.7", "--start=0,0,0,-3,0,0,0"], "joint 4"),
            (&["--fri=2.7", "--overlay=wrench"], "CartesianImpedance"),
            (
                &["--fri=2.7", "--overlay=torque", "--law=cartesian-impedance"],
                "JointImpedance",
            ),
            (&["--fri=1.16", "--overlay=cartesian-pose"], "FRI 1.x"),
            (&["--fri=1.11", "--io=A.b=boolean:input"], "has 0 inputs"),
            (
                &[
                    "--fri=2.7",
                    "--io=A.b=boolean:input",
                    "--io=A.b=analog:input",
                ],
                "twice",
            ),
            (
                &["--fri=2.7", "--io=A.b=boolean:input", "--wire-io=A.b=A.b"],
                "--wire-io",
            ),
            (
                &["--fri=2.7", "--law=joint-impedance", "--stiffness=1,2"],
                "7 springs",
            ),
            (&["--fri=2.7", "--wall=0,0,0,0,0,0,1,1"], "--wall"),
        ] {
            let error = parsed(more).settings().expect_err(words).to_string();
            assert!(error.contains(words), "{error}");
        }
        for more in [
            "--fri=3.0",
            "--period-ms=0",
            "--multiplier=101",
            "--io=NoGroup=boolean:input",
        ] {
            let words = ["iiwa-sim", "--driver=127.0.0.1:1", "--fri=2.7", more];
            assert!(Options::try_parse_from(words).is_err(), "{more}");
        }
    }
}
