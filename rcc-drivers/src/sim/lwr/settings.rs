//! Everything about the simulated controller that can be chosen, with the values it has when nothing is chosen.
//! Plain data; read by the clock thread only.
//!
//! KUKA publishes neither thresholds for the connection's quality nor tolerances nor the number of bridged answers:
//! those numbers are **ours**. The supervised limits are what others have read out of a controller's files.

use super::Joints;
use super::environment::Wall;

/// How the KRL program on the simulated controller decides about command mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum KrlProgram {
    /// The convention of KUKA's first sample: the PC writes `$FRI_FRM_INT[1]`; 1 and 10 ask for command mode,
    /// 0 and 2 end it, any other number leaves the last request as it is.
    FirstApp,
    /// Command mode as soon as its conditions hold; the PC's integers mean nothing.
    Auto,
}

/// The control strategy that the KRL program has chosen before it opened the interface, `$STIFFNESS.STRATEGY`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum KrlStrategy {
    /// 10: the joints are where they are commanded to.
    Position,
    /// 20: the flange hangs on impedance at the commanded pose.
    CartesianImpedance,
    /// 30: each joint hangs on a spring at its commanded position.
    JointImpedance,
}

/// Who acknowledges a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Acknowledge {
    /// The KRL program, once the arm has rested for a while and the PC mirrors. An emergency stop is never
    /// acknowledged in this way.
    Auto,
    /// Only the command `ack` of the control port.
    Manual,
}

/// SupervisedLimits that the controller supervises on the commanded positions, each in both directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SupervisedLimits {
    /// rad.
    pub position: Joints,
    /// rad/s.
    pub velocity: Joints,
    /// rad/s².
    pub acceleration: Joints,
}

impl Default for SupervisedLimits {
    /// Read by others from a controller's `rsidef7.dat` (TUM FRICheck), not published by KUKA.
    fn default() -> Self {
        let radians = |degrees: Joints| degrees.map(f64::to_radians);
        Self {
            position: radians([170.0, 120.0, 170.0, 120.0, 170.0, 120.0, 170.0]),
            velocity: radians([120.0, 120.0, 160.0, 160.0, 250.0, 220.0, 220.0]),
            acceleration: radians([1200.0, 1200.0, 1600.0, 1600.0, 2500.0, 4400.0, 4400.0]),
        }
    }
}

/// When the connection has which quality. All numbers are ours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct QualityThresholds {
    /// Least answered part of the last 100 cycles for PERFECT; mean delay + 2 × jitter must be below half a period.
    pub perfect: f64,
    /// Least answered part for OK.
    pub ok: f64,
    /// Least answered part for BAD; below it is UNACCEPTABLE.
    pub bad: f64,
    /// Cycles for which a better quality must have lasted before it is believed; a worse one counts at once.
    pub raise_cycles: u32,
}

impl Default for QualityThresholds {
    fn default() -> Self {
        Self {
            perfect: 0.99,
            ok: 0.95,
            bad: 0.80,
            raise_cycles: 50,
        }
    }
}

/// One KRL output of the PC that is wired back to an input of the PC; both are counted from 1.
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
    /// KRL program.
    pub script: KrlProgram,
    /// Control strategy.
    pub strategy: KrlStrategy,
    /// Who acknowledges.
    pub acknowledge: Acknowledge,
    /// For how long the arm must rest before the KRL program acknowledges, s. Ours.
    pub acknowledge_after_s: f64,
    /// Supervised limits before scaling.
    pub limits: SupervisedLimits,
    /// Factor on velocity and acceleration limits (argument of `friStart`), 0 to 1.
    pub safety_limits: f64,
    /// Largest difference between the command and the controller's own position at the entry, rad. Ours.
    pub mirror_tolerance_rad: f64,
    /// Missed answers in a row that are bridged with the last velocity; one more stops the arm. Ours.
    pub bridged_misses: u32,
    /// Largest deceleration of a stop, rad/s². Ours.
    pub brake_deceleration: f64,
    /// Largest jerk of a stop, rad/s³. Ours.
    pub brake_jerk: f64,
    /// Bandwidth of the simulated position control, rad/s. Ours.
    pub bandwidth_rad_s: f64,
    /// Thresholds of the quality.
    pub quality: QualityThresholds,
    /// Booleans that are wired back.
    pub boolean_wires: Vec<KrlLoopback>,
    /// Reals that are wired back.
    pub real_wires: Vec<KrlLoopback>,
    /// Obstacle at the start.
    pub wall: Option<Wall>,
    /// Seed of the answers that are dropped on request.
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
            strategy: KrlStrategy::Position,
            acknowledge: Acknowledge::Auto,
            acknowledge_after_s: 0.5,
            limits: SupervisedLimits::default(),
            safety_limits: 1.0,
            mirror_tolerance_rad: 0.01,
            bridged_misses: 5,
            brake_deceleration: 8.0,
            brake_jerk: 200.0,
            bandwidth_rad_s: 80.0,
            quality: QualityThresholds::default(),
            boolean_wires: Vec::new(),
            real_wires: Vec::new(),
            wall: None,
            seed: 1,
        }
    }
}
