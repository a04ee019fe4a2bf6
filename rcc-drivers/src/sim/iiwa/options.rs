//! The command line of `iiwa-sim`. Thresholds that KUKA does not publish are our own, and marked as such.
//! Read once, by the main thread.

use super::JOINTS;
use super::control::{SpringError, springs};
use super::robot::ArmKind;
use super::settings::{MotionStart, OverlayError, OverlayMode, Selector, Settings};
use super::station::{SignalLoopback, StationSignal};
use crate::fri_iiwa::wire::{IO_MAX, Version};
use crate::sim::arm::command_stream::SupervisedLimits;
use crate::sim::arm::dynamics::FlangeLoad;
use crate::sim::arm::environment::{Wall, WallError};
use crate::sim::arm::impedance::ControlLaw;
use crate::sim::control_socket;
use crate::sim::number_list::NumberList;
use crate::sim::quality::QualityThresholds;
use clap::Parser;
use std::net::SocketAddr;
use std::path::PathBuf;

/// A simulated Sunrise Cabinet with a KUKA LBR iiwa or LBR Med: speaks FRI 1.11 to 2.7 over UDP, sends first, and moves a
/// simulated arm. Its application opens a session and holds the position with an FRI overlay.
#[derive(Clone, Debug, Parser)]
#[command(name = "iiwa-sim", version = rcc_protocol::version::version())]
pub struct Options {
    /// Address where the client (the driver) listens; datagrams from elsewhere are ignored. A KUKA client that is given a
    /// host name answers to that host and its own port: bind the same port on another loopback address then
    #[arg(long, value_name = "ADDRESS:PORT")]
    pub driver: SocketAddr,
    /// Address to send from; port 0 lets the system choose
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:0")]
    pub bind: SocketAddr,
    /// Unix socket of the control port (one JSON object per line), for programs of the same user and of root, in a
    /// folder that only they can write to; files that requests name must be below that folder. Default: no control port
    #[arg(long, value_name = "SOCKET", value_parser = control_socket::path)]
    pub control: Option<PathBuf>,
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
    /// What the overlay lets the client command: wrench needs --law=cartesian-impedance, torque --law=joint-impedance,
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
    /// Joint positions at the start, rad
    #[arg(
        long,
        value_name = "Q1,…,Q7",
        default_value = "0,0.5236,0,-1.5708,0,1.0472,0",
        allow_hyphen_values = true
    )]
    pub start: NumberList<JOINTS>,
    /// Supervised accelerations, degrees/s². Default: ten times the velocities (our own values: KUKA publishes none)
    #[arg(long, value_name = "A1,…,A7")]
    pub acceleration_limits: Option<NumberList<JOINTS>>,
    /// Time constant of the low-pass behind which the acceleration is supervised, ms; 0 judges the second difference (our
    /// own rule and value)
    #[arg(long, value_name = "MS", default_value_t = 10.0)]
    pub acceleration_filter_ms: f64,
    /// Largest difference to the interpolated position while the robot synchronises, rad (our own value)
    #[arg(long, value_name = "RAD", default_value_t = 0.01)]
    pub mirror_tolerance: f64,
    /// Consecutive missed answers that are bridged; one more ends the motion (our own value)
    #[arg(long, value_name = "COUNT", default_value_t = 5)]
    pub bridge: u32,
    /// Largest deceleration of a stop, rad/s² (our own value)
    #[arg(long, value_name = "RAD/S²", default_value_t = 8.0)]
    pub brake_deceleration: f64,
    /// Largest jerk of a stop, rad/s³ (our own value)
    #[arg(long, value_name = "RAD/S³", default_value_t = 200.0)]
    pub brake_jerk: f64,
    /// Bandwidth of the simulated position control, rad/s: the arm lags 2 v / bandwidth behind (our own value)
    #[arg(long, value_name = "RAD/S", default_value_t = 80.0)]
    pub bandwidth: f64,
    /// Smallest share of the last 100 answers for EXCELLENT, GOOD and FAIR (our own values)
    #[arg(
        long,
        value_name = "EXCELLENT,GOOD,FAIR",
        default_value = "0.99,0.95,0.8"
    )]
    pub quality: NumberList<3>,
    /// Answers for which a better quality must last before it takes effect (our own value)
    #[arg(long, value_name = "COUNT", default_value_t = 50)]
    pub quality_raise_cycles: u32,
    /// An input or output of the station: boolean, digital or analog, and input or output as the client sees it; at most
    /// ten
    #[arg(long, value_name = "GROUP.NAME=TYPE:DIRECTION")]
    pub io: Vec<StationSignal>,
    /// Loops an output of the station back to an input
    #[arg(long, value_name = "OUTPUT=INPUT")]
    pub wire_io: Vec<SignalLoopback>,
    /// An obstacle: a point of its plane (m), the normal to the free side, stiffness (N/m), damping (N s/m)
    #[arg(long, value_name = "PX,PY,PZ,NX,NY,NZ,K,D", allow_hyphen_values = true)]
    pub wall: Option<NumberList<8>>,
    /// A load at the flange that the cabinet does not know about: its mass (kg), and its centre in the flange frame (m)
    #[arg(long, value_name = "KG[,X,Y,Z]", allow_hyphen_values = true)]
    pub load: Option<FlangeLoad>,
    /// Appends every exchanged pair of datagrams to this file as comma-separated values
    #[arg(long, value_name = "FILE")]
    pub trace: Option<PathBuf>,
    /// Seed of the random numbers for answers that are dropped on request
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// SCHED_FIFO priority of the clock thread, if the system permits it: a real controller is punctual
    #[arg(long, value_name = "1..99", value_parser = clap::value_parser!(u8).range(1..=99))]
    pub priority: Option<u8>,
    /// Ends when the thread that started it ends
    #[arg(long)]
    pub parent_death: bool,
}

fn version(text: &str) -> Result<Version, String> {
    text.parse()
        .map_err(|()| "write 1.11, 1.14, 1.15, 1.16, 2.5 or 2.7".to_owned())
}

/// Why an option is refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum OptionError {
    /// A number is out of range.
    #[error("invalid value {value} for --{option}: it must be {range}")]
    Range {
        /// Name of the option.
        option: &'static str,
        /// Given.
        value: f64,
        /// Allowed.
        range: &'static str,
    },
    /// The start position is outside the supervised range.
    #[error("--start: joint {} at {value} rad is outside ±{limit} rad", joint + 1)]
    Start {
        /// Index of the joint.
        joint: usize,
        /// Given, rad.
        value: f64,
        /// Allowed, rad.
        limit: f64,
    },
    /// The wall is invalid.
    #[error("--wall: {0}")]
    Wall(#[from] WallError),
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
        self.check_ranges()?;
        self.check_signals()?;
        self.overlay.check(self.law, self.fri)?;
        let [perfect, ok, bad] = self.quality.0;
        Ok(Settings {
            version: self.fri,
            arm: self.arm,
            period_ms: self.period_ms,
            multiplier: self.multiplier,
            start: self.start.0,
            law: self.law,
            overlay: self.overlay,
            impedance: springs(self.law, self.stiffness.as_deref(), self.damping)?,
            motion: self.motion,
            synchronising_answers: self.synchronising,
            selector: self.mode,
            limits: self.limits()?,
            acceleration_filter_s: self.acceleration_filter_ms * 1e-3,
            mirror_tolerance_rad: self.mirror_tolerance,
            bridged_misses: self.bridge,
            brake_deceleration: self.brake_deceleration,
            brake_jerk: self.brake_jerk,
            bandwidth_rad_s: self.bandwidth,
            quality: QualityThresholds {
                perfect,
                ok,
                bad,
                raise_cycles: self.quality_raise_cycles,
            },
            signals: self.io.clone(),
            loopbacks: self.wire_io.clone(),
            wall: self.wall.map(wall).transpose()?,
            load: self.load,
            seed: self.seed,
            ..Settings::default()
        })
    }

    fn check_ranges(&self) -> Result<(), OptionError> {
        let filter = self.acceleration_filter_ms;
        let positive = |value: f64| value.is_finite() && value > 0.0;
        let above = "finite and above 0";
        let rows = [
            (
                "acceleration-filter-ms",
                filter,
                "from 0 to 1000",
                (0.0..=1000.0).contains(&filter),
            ),
            (
                "mirror-tolerance",
                self.mirror_tolerance,
                above,
                positive(self.mirror_tolerance),
            ),
            (
                "brake-deceleration",
                self.brake_deceleration,
                above,
                positive(self.brake_deceleration),
            ),
            (
                "brake-jerk",
                self.brake_jerk,
                above,
                positive(self.brake_jerk),
            ),
            ("bandwidth", self.bandwidth, above, positive(self.bandwidth)),
        ];
        match rows.into_iter().find(|row| !row.3) {
            None => Ok(()),
            Some((option, value, range, _)) => Err(OptionError::Range {
                option,
                value,
                range,
            }),
        }
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

    /// Returns the supervised limits, after checking the start position against them.
    fn limits(&self) -> Result<SupervisedLimits, OptionError> {
        let mut limits = self.arm.limits();
        if let Some(NumberList(accelerations)) = self.acceleration_limits {
            limits.acceleration = accelerations.map(f64::to_radians);
        }
        let start = self.start.0;
        let outside = |joint: &usize| start[*joint].abs() > limits.position[*joint];
        match (0..JOINTS).find(outside) {
            None => Ok(limits),
            Some(joint) => Err(OptionError::Start {
                joint,
                value: start[joint],
                limit: limits.position[joint],
            }),
        }
    }
}

fn wall(numbers: NumberList<8>) -> Result<Wall, WallError> {
    let [px, py, pz, nx, ny, nz, stiffness, damping] = numbers.0;
    Wall {
        point: [px, py, pz],
        normal: [nx, ny, nz],
        stiffness,
        damping,
    }
    .checked()
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
