//! Settings of the simulated controller with their defaults.
//! Plain data; read only by the clock thread.
//!
//! KUKA publishes neither thresholds of the connection quality, nor tolerances, nor the number of bridged answers:
//! those values are **our own**. The supervised limits are values that users have read from a controller's files.

use super::Joints;
use crate::fri_lwr::wire::Quality;
use crate::sim::arm::command_stream::{StreamRules, SupervisedLimits};
use crate::sim::arm::dynamics::FlangeLoad;
use crate::sim::arm::environment::Wall;
use crate::sim::arm::impedance::ControlLaw;
use crate::sim::quality::QualityThresholds;

/// How the KRL program of the simulated controller enters and leaves command mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum KrlProgram {
    /// KUKA's first and second sample: the PC writes `$FRI_FRM_INT[1]`; 1 and 10 request command mode, 0 and 2 end it, any
    /// other number leaves the last request unchanged. 10, 20 or 30 in `$FRI_FRM_INT[2]` chooses the strategy.
    FirstApp,
    /// The Stanford library: `$FRI_FRM_INT[16]` is 10 to request command mode and 20 to end it, `$FRI_FRM_INT[15]` is the
    /// strategy; `$FRI_TO_INT[16]` is 10 as soon as the program takes requests.
    Stanford,
    /// Centro E. Piaggio: `$FRI_FRM_INT[2]` is 1 to request command mode and 0 to end it, `$FRI_FRM_INT[1]` is the
    /// strategy; `$FRI_TO_INT[2]` is 1 in command mode and 0 in monitor mode.
    Centro,
    /// Command mode as soon as its conditions hold; the PC's integers are ignored.
    Auto,
}

/// Connection quality that the KRL program waits for before it calls friStart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum EntryQuality {
    /// `#OK` or better.
    Ok,
    /// `#PERFECT`.
    Perfect,
}

impl EntryQuality {
    /// Returns the quality on the wire.
    pub fn least(self) -> Quality {
        match self {
            EntryQuality::Ok => Quality::Ok,
            EntryQuality::Perfect => Quality::Perfect,
        }
    }
}

/// Who acknowledges a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Acknowledge {
    /// The KRL program, once the arm has been at rest for a while and the PC mirrors. It never acknowledges an
    /// emergency stop.
    Auto,
    /// Only the command `ack` of the control port.
    Manual,
}

/// Returns the limits of the commanded positions that users read from a controller's `rsidef7.dat` (TUM FRICheck); KUKA
/// does not publish them.
pub fn supervised_limits() -> SupervisedLimits {
    let radians = |degrees: Joints| degrees.map(f64::to_radians);
    SupervisedLimits {
        position: radians([170.0, 120.0, 170.0, 120.0, 170.0, 120.0, 170.0]),
        velocity: radians([120.0, 120.0, 160.0, 160.0, 250.0, 220.0, 220.0]),
        acceleration: radians([1200.0, 1200.0, 1600.0, 1600.0, 2500.0, 4400.0, 4400.0]),
    }
}

/// A KRL output of the PC that is looped back to an input of the PC; both are counted from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KrlLoopback {
    /// Number of `$FRI_FRM_…`, 1 to 16.
    pub from: usize,
    /// Number of `$FRI_TO_…`, 1 to 16.
    pub to: usize,
}

/// All settings of one simulated controller.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Period of both directions, s.
    pub period_s: f64,
    /// Joint positions at the start, rad.
    pub start: Joints,
    /// Convention of the KRL program.
    pub script: KrlProgram,
    /// Quality that it waits for.
    pub entry_quality: EntryQuality,
    /// Control strategy, `$STIFFNESS.STRATEGY`, at the start: 10 position, 20 Cartesian, 30 joint impedance. The KRL
    /// program may change it in monitor mode.
    pub strategy: ControlLaw,
    /// Who acknowledges a fault.
    pub acknowledge: Acknowledge,
    /// How long the arm must be at rest before the KRL program acknowledges, s. The default is our own.
    pub acknowledge_after_s: f64,
    /// Supervised limits before scaling.
    pub limits: SupervisedLimits,
    /// Factor on velocity and acceleration limits (argument of `friStart`), 0 to 1.
    pub safety_limits: f64,
    /// Time constant of the low-pass that the supervised acceleration is taken behind, s; 0: the second difference of the
    /// commanded positions. The rule and the default are our own.
    pub acceleration_filter_s: f64,
    /// Largest difference between the command and the controller's own position at the entry, rad. The default is our
    /// own.
    pub mirror_tolerance_rad: f64,
    /// Number of consecutive missed answers that are bridged with the last velocity; one more stops the arm. The
    /// default is our own.
    pub bridged_misses: u32,
    /// Largest deceleration of a stop, rad/s². The default is our own.
    pub brake_deceleration: f64,
    /// Largest jerk of a stop, rad/s³. The default is our own.
    pub brake_jerk: f64,
    /// Bandwidth of the simulated position control, rad/s. The default is our own.
    pub bandwidth_rad_s: f64,
    /// Thresholds of the quality.
    pub quality: QualityThresholds,
    /// Booleans that are looped back.
    pub boolean_wires: Vec<KrlLoopback>,
    /// Reals that are looped back.
    pub real_wires: Vec<KrlLoopback>,
    /// Obstacle at the start.
    pub wall: Option<Wall>,
    /// Load at the start.
    pub load: Option<FlangeLoad>,
    /// Seed of the random numbers for answers that are dropped on request.
    pub seed: u64,
}

impl Default for Settings {
    #[expect(
        clippy::approx_constant,
        reason = "the start is a pose, given with four digits as on the command line"
    )]
    fn default() -> Self {
        Self {
            period_s: 0.001,
            start: [0.0, 0.5236, 0.0, -1.5708, 0.0, 1.0472, 0.0],
            script: KrlProgram::FirstApp,
            entry_quality: EntryQuality::Ok,
            strategy: ControlLaw::Position,
            acknowledge: Acknowledge::Auto,
            acknowledge_after_s: 0.5,
            limits: supervised_limits(),
            safety_limits: 1.0,
            acceleration_filter_s: 0.01,
            mirror_tolerance_rad: 0.01,
            bridged_misses: 5,
            brake_deceleration: 8.0,
            brake_jerk: 200.0,
            bandwidth_rad_s: 80.0,
            quality: QualityThresholds::default(),
            boolean_wires: Vec::new(),
            real_wires: Vec::new(),
            wall: None,
            load: None,
            seed: 1,
        }
    }
}

impl Settings {
    /// Returns by what the commanded positions are judged.
    pub fn stream_rules(&self) -> StreamRules {
        StreamRules {
            period_s: self.period_s,
            limits: self.limits,
            scale: self.safety_limits,
            acceleration_filter_s: self.acceleration_filter_s,
        }
    }
}
