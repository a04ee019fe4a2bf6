//! The command line of `lwr-sim`. Thresholds that KUKA does not publish are our own, and marked as such.
//! Read once, by the main thread.

use super::settings::{Acknowledge, EntryQuality, KrlLoopback, KrlProgram, Settings};
use super::{JOINTS, Joints};
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
use std::str::FromStr;

/// A simulated controller (KRC) of a KUKA LWR 4+: speaks FRI 1.0 over UDP, sends first, and moves a simulated arm.
#[derive(Clone, Debug, Parser)]
#[command(name = "lwr-sim", version = rcc_protocol::version::version())]
pub struct Options {
    /// Address where the PC (the driver) listens; datagrams from elsewhere are ignored
    #[arg(long, value_name = "ADDRESS:PORT")]
    pub driver: SocketAddr,
    /// Address to send from; port 0 lets the system choose
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:0")]
    pub bind: SocketAddr,
    /// Unix socket of the control port (one JSON object per line), for programs of the same user and of root, in a
    /// folder that only they can write to; files that requests name must be below that folder. Default: no control port
    #[arg(long, value_name = "SOCKET", value_parser = control_socket::path)]
    pub control: Option<PathBuf>,
    /// Period of both directions, ms (KUKA: 1 to 100)
    #[arg(long, value_name = "MS", default_value_t = 1.0)]
    pub period_ms: f64,
    /// How the KRL program enters command mode: with first-app (KUKA's samples) the PC writes `$FRI_FRM_INT[1]`, 1 and 10
    /// request it, 0 and 2 end it; with stanford `$FRI_FRM_INT[16]`, 10 and 20; with centro `$FRI_FRM_INT[2]`, 1 and 0;
    /// with auto it begins as soon as its conditions hold
    #[arg(long, value_enum, default_value = "first-app")]
    pub krl: KrlProgram,
    /// Quality that the KRL program waits for before it enters command mode
    #[arg(long, value_enum, default_value = "ok")]
    pub entry_quality: EntryQuality,
    /// Control strategy that the KRL program has chosen, `$STIFFNESS.STRATEGY` 10, 20 or 30: under impedance control
    /// the arm yields; what the command flags leave out is taken from `$STIFFNESS`. The PC may choose another one in
    /// monitor mode (INT[2], INT[15] or INT[1] in the order of --krl), and so may the control port
    #[arg(long, value_enum, default_value = "position")]
    pub strategy: ControlLaw,
    /// Who acknowledges a fault: the KRL program once the arm has been at rest for 0.5 s and the PC mirrors, or the
    /// control port (the 0.5 s are our own value)
    #[arg(long, value_enum, default_value = "auto")]
    pub ack: Acknowledge,
    /// Joint positions at the start, rad
    #[arg(
        long,
        value_name = "Q1,…,Q7",
        default_value = "0,0.5236,0,-1.5708,0,1.0472,0",
        allow_hyphen_values = true
    )]
    pub start: NumberList<JOINTS>,
    /// Supervised positions, ±degrees (values that users read from a controller's files)
    #[arg(
        long,
        value_name = "J1,…,J7",
        default_value = "170,120,170,120,170,120,170"
    )]
    pub position_limits: NumberList<JOINTS>,
    /// Supervised velocities, degrees/s (values that users read from a controller's files)
    #[arg(
        long,
        value_name = "J1,…,J7",
        default_value = "120,120,160,160,250,220,220"
    )]
    pub velocity_limits: NumberList<JOINTS>,
    /// Supervised accelerations, degrees/s² (values that users read from a controller's files)
    #[arg(
        long,
        value_name = "J1,…,J7",
        default_value = "1200,1200,1600,1600,2500,4400,4400"
    )]
    pub acceleration_limits: NumberList<JOINTS>,
    /// Factor on the supervised velocities and accelerations, above 0 up to 1
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    pub safety_limits: f64,
    /// Time constant of the low-pass behind which the acceleration is supervised, ms; 0 judges the second difference, so
    /// that KUKA's own samples are refused at 1 and 2 ms (our own rule and value: KUKA publishes none)
    #[arg(long, value_name = "MS", default_value_t = 10.0)]
    pub acceleration_filter_ms: f64,
    /// Largest difference to the mirrored position when command mode begins, rad (our own value)
    #[arg(long, value_name = "RAD", default_value_t = 0.01)]
    pub mirror_tolerance: f64,
    /// Consecutive missed answers that are bridged; one more stops the arm (our own value)
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
    /// Smallest answered share of the last 100 cycles for PERFECT, OK and BAD (our own values)
    #[arg(long, value_name = "PERFECT,OK,BAD", default_value = "0.99,0.95,0.8")]
    pub quality: NumberList<3>,
    /// Cycles for which a better quality must last before it takes effect (our own value)
    #[arg(long, value_name = "COUNT", default_value_t = 50)]
    pub quality_raise_cycles: u32,
    /// Loops `$FRI_FRM_BOOL[FROM]` back to `$FRI_TO_BOOL[TO]`
    #[arg(long, value_name = "FROM=TO")]
    pub wire_bool: Vec<KrlLoopback>,
    /// Loops `$FRI_FRM_REA[FROM]` back to `$FRI_TO_REA[TO]`
    #[arg(long, value_name = "FROM=TO")]
    pub wire_real: Vec<KrlLoopback>,
    /// An obstacle: a point of its plane (m), the normal to the free side, stiffness (N/m), damping (N s/m)
    #[arg(long, value_name = "PX,PY,PZ,NX,NY,NZ,K,D", allow_hyphen_values = true)]
    pub wall: Option<NumberList<8>>,
    /// A load at the flange that the controller does not know about: its mass (kg), and its centre in the flange frame
    /// (m)
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

/// Why an option is refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum OptionError {
    /// An invalid loopback.
    #[error("invalid loopback `{0}`: write FROM=TO with numbers from 1 to 16")]
    Wire(String),
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
}

impl FromStr for KrlLoopback {
    type Err = OptionError;

    fn from_str(text: &str) -> Result<Self, OptionError> {
        let number = |part: &str| {
            part.trim()
                .parse()
                .ok()
                .filter(|number| (1..=16).contains(number))
        };
        text.split_once('=')
            .and_then(|(from, to)| {
                Some(Self {
                    from: number(from)?,
                    to: number(to)?,
                })
            })
            .ok_or_else(|| OptionError::Wire(text.to_owned()))
    }
}

impl Options {
    /// Returns the controller's settings.
    ///
    /// # Errors
    /// Returns an error for the first number that is out of range.
    pub fn settings(&self) -> Result<Settings, OptionError> {
        self.check_ranges()?;
        let [perfect, ok, bad] = self.quality.0;
        Ok(Settings {
            period_s: self.period_ms * 1e-3,
            start: self.start.0,
            script: self.krl,
            entry_quality: self.entry_quality,
            strategy: self.strategy,
            acknowledge: self.ack,
            limits: self.limits()?,
            safety_limits: self.safety_limits,
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
            boolean_wires: self.wire_bool.clone(),
            real_wires: self.wire_real.clone(),
            wall: self.wall.map(wall).transpose()?,
            load: self.load,
            seed: self.seed,
            ..Settings::default()
        })
    }

    fn check_ranges(&self) -> Result<(), OptionError> {
        let range = |option, value: f64, range, inside: bool| {
            if inside {
                Ok(())
            } else {
                Err(OptionError::Range {
                    option,
                    value,
                    range,
                })
            }
        };
        range(
            "period-ms",
            self.period_ms,
            "from 1 to 100",
            (1.0..=100.0).contains(&self.period_ms),
        )?;
        let safety = self.safety_limits;
        range(
            "safety-limits",
            safety,
            "above 0 and at most 1",
            safety > 0.0 && safety <= 1.0,
        )?;
        range(
            "acceleration-filter-ms",
            self.acceleration_filter_ms,
            "from 0 to 1000",
            (0.0..=1000.0).contains(&self.acceleration_filter_ms),
        )?;
        for (option, value) in [
            ("mirror-tolerance", self.mirror_tolerance),
            ("brake-deceleration", self.brake_deceleration),
            ("brake-jerk", self.brake_jerk),
            ("bandwidth", self.bandwidth),
        ] {
            range(
                option,
                value,
                "finite and above 0",
                value.is_finite() && value > 0.0,
            )?;
        }
        Ok(())
    }

    /// Returns the supervised limits, after checking the start position against them.
    fn limits(&self) -> Result<SupervisedLimits, OptionError> {
        let radians = |numbers: &NumberList<JOINTS>| -> Joints { numbers.0.map(f64::to_radians) };
        let limits = SupervisedLimits {
            position: radians(&self.position_limits),
            velocity: radians(&self.velocity_limits),
            acceleration: radians(&self.acceleration_limits),
        };
        let start = self.start.0;
        if let Some(joint) = (0..JOINTS).find(|&joint| start[joint].abs() > limits.position[joint])
        {
            return Err(OptionError::Start {
                joint,
                value: start[joint],
                limit: limits.position[joint],
            });
        }
        Ok(limits)
    }
}

fn wall(
    NumberList([px, py, pz, nx, ny, nz, stiffness, damping]): NumberList<8>,
) -> Result<Wall, WallError> {
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
    use crate::sim::number_list::ListError;

    fn parsed(arguments: &[&str]) -> Options {
        let fixed = ["lwr-sim", "--driver", "127.0.0.1:1"];
        Options::try_parse_from(fixed.iter().chain(arguments)).unwrap()
    }

    #[test]
    fn without_options_the_settings_are_the_documented_defaults() {
        assert_eq!(parsed(&[]).settings(), Ok(Settings::default()));
    }

    #[test]
    fn a_value_out_of_range_is_refused_with_its_option() {
        for (arguments, part) in [
            (["--period-ms", "0.5"], "period-ms"),
            (["--safety-limits", "0"], "safety-limits"),
            (["--bandwidth", "nan"], "bandwidth"),
            (["--acceleration-filter-ms", "nan"], "acceleration-filter"),
            (["--start", "0,0,0,-3,0,0,0"], "joint 4"),
            (["--wall", "0,0,0,0,0,0,1,1"], "normal"),
        ] {
            let error = parsed(&arguments).settings().unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        }
    }

    #[test]
    fn a_list_of_the_wrong_length_and_a_wire_out_of_range_are_refused() {
        assert_eq!(
            "1,2".parse::<NumberList<3>>(),
            Err(ListError::Count { want: 3, have: 2 })
        );
        assert_eq!(
            "1,inf,2".parse::<NumberList<3>>(),
            Err(ListError::Number("inf".into()))
        );
        assert_eq!(
            "1=17".parse::<KrlLoopback>(),
            Err(OptionError::Wire("1=17".into()))
        );
        assert_eq!(
            "3=4".parse::<KrlLoopback>(),
            Ok(KrlLoopback { from: 3, to: 4 })
        );
    }
}
