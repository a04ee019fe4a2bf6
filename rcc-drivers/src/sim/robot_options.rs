//! The options that every simulated arm behind FRI has. Thresholds that KUKA does not publish are our own, and marked as such.
//! Read once, by the main thread.

use super::arm::command_stream::SupervisedLimits;
use super::arm::dynamics::FlangeLoad;
use super::arm::environment::{Wall, WallError};
use super::arm::{JOINTS, Joints};
use super::control_socket;
use super::number_list::NumberList;
use super::quality::QualityThresholds;
use super::robot_program::Common;
use super::robot_settings::RobotSettings;
use std::net::SocketAddr;
use std::path::PathBuf;

/// Options of one simulated arm.
#[derive(Clone, Debug, clap::Args)]
pub struct RobotOptions {
    /// Address where the PC (the driver) listens; datagrams from elsewhere are ignored. A KUKA client for the iiwa that is given
    /// a host name answers to that host and its own port: bind the same port on another loopback address then
    #[arg(long, value_name = "ADDRESS:PORT")]
    pub driver: SocketAddr,
    /// Address to send from; port 0 lets the system choose
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:0")]
    pub bind: SocketAddr,
    /// Unix socket of the control port (one JSON object per line), for programs of the same user and of root, in a
    /// folder that only they can write to; files that requests name must be below that folder. Default: no control port
    #[arg(long, value_name = "SOCKET", value_parser = control_socket::path)]
    pub control: Option<PathBuf>,
    /// Joint positions at the start, rad
    #[arg(
        long,
        value_name = "Q1,…,Q7",
        default_value = "0,0.5236,0,-1.5708,0,1.0472,0",
        allow_hyphen_values = true
    )]
    pub start: NumberList<JOINTS>,
    /// Time constant of the low-pass behind which the acceleration is supervised, ms; 0 judges the second difference, so
    /// that KUKA's own samples are refused at 1 and 2 ms (our own rule and value: KUKA publishes none)
    #[arg(long, value_name = "MS", default_value_t = 10.0)]
    pub acceleration_filter_ms: f64,
    /// Largest difference to the mirrored position when commands begin to be executed, rad (our own value)
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
    /// Smallest share of the last 100 answers for PERFECT, OK and BAD, or EXCELLENT, GOOD and FAIR (our own values)
    #[arg(long, value_name = "BEST,GOOD,FAIR", default_value = "0.99,0.95,0.8")]
    pub quality: NumberList<3>,
    /// Answers for which a better quality must last before it takes effect (our own value)
    #[arg(long, value_name = "COUNT", default_value_t = 50)]
    pub quality_raise_cycles: u32,
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

/// Why one of these options is refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RobotOptionError {
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

/// A number of an option, and whether it is in its range: name, value, range in words, inside.
pub type RangeRow = (&'static str, f64, &'static str, bool);

/// Checks numbers of options.
///
/// # Errors
/// Returns an error for the first that is out of range.
pub fn check_ranges(rows: impl IntoIterator<Item = RangeRow>) -> Result<(), RobotOptionError> {
    match rows.into_iter().find(|row| !row.3) {
        None => Ok(()),
        Some((option, value, range, _)) => Err(RobotOptionError::Range {
            option,
            value,
            range,
        }),
    }
}

impl RobotOptions {
    /// Returns the settings of an arm with these limits.
    ///
    /// # Errors
    /// Returns an error for the first number that is out of range.
    pub fn settings(&self, limits: SupervisedLimits) -> Result<RobotSettings, RobotOptionError> {
        let filter = self.acceleration_filter_ms;
        let positive = |option, value: f64| {
            let inside = value.is_finite() && value > 0.0;
            (option, value, "finite and above 0", inside)
        };
        check_ranges([
            (
                "acceleration-filter-ms",
                filter,
                "from 0 to 1000",
                (0.0..=1000.0).contains(&filter),
            ),
            positive("mirror-tolerance", self.mirror_tolerance),
            positive("brake-deceleration", self.brake_deceleration),
            positive("brake-jerk", self.brake_jerk),
            positive("bandwidth", self.bandwidth),
        ])?;
        check_start(&self.start.0, &limits)?;
        let [perfect, ok, bad] = self.quality.0;
        Ok(RobotSettings {
            start: self.start.0,
            acceleration_filter_s: filter * 1e-3,
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
            wall: self.wall.map(wall).transpose()?,
            load: self.load,
            seed: self.seed,
            ..RobotSettings::within(limits)
        })
    }

    /// Returns what the program of this name needs to run.
    #[must_use]
    pub fn common(&self, program: &'static str) -> Common<'_> {
        Common {
            program,
            driver: self.driver,
            bind: self.bind,
            control: self.control.as_deref(),
            trace: self.trace.as_deref(),
            priority: self.priority,
            parent_death: self.parent_death,
        }
    }
}

fn check_start(start: &Joints, limits: &SupervisedLimits) -> Result<(), RobotOptionError> {
    let outside = |joint: &usize| start[*joint].abs() > limits.position[*joint];
    match (0..JOINTS).find(outside) {
        None => Ok(()),
        Some(joint) => Err(RobotOptionError::Start {
            joint,
            value: start[joint],
            limit: limits.position[joint],
        }),
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
