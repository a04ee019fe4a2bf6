//! Settings of the simulated controller with their defaults.
//! Plain data; read only by the clock thread.
//!
//! The supervised limits are values that users have read from a controller's files.

use super::Joints;
use crate::fri_lwr::wire::Quality;
use crate::sim::arm::command_stream::{StreamRules, SupervisedLimits};
use crate::sim::arm::impedance::ControlLaw;
use crate::sim::robot_settings::RobotSettings;

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

/// The side that acknowledges a fault.
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
    /// Convention of the KRL program.
    pub script: KrlProgram,
    /// Quality that it waits for.
    pub entry_quality: EntryQuality,
    /// Control strategy, `$STIFFNESS.STRATEGY`, at the start: 10 position, 20 Cartesian, 30 joint impedance. The KRL
    /// program may change it in monitor mode.
    pub strategy: ControlLaw,
    /// The side that acknowledges a fault.
    pub acknowledge: Acknowledge,
    /// Factor on velocity and acceleration limits (argument of `friStart`), 0 to 1.
    pub safety_limits: f64,
    /// Booleans that are looped back.
    pub boolean_wires: Vec<KrlLoopback>,
    /// Reals that are looped back.
    pub real_wires: Vec<KrlLoopback>,
    /// Settings of every simulated arm.
    pub robot: RobotSettings,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            period_s: 0.001,
            script: KrlProgram::FirstApp,
            entry_quality: EntryQuality::Ok,
            strategy: ControlLaw::Position,
            acknowledge: Acknowledge::Auto,
            safety_limits: 1.0,
            boolean_wires: Vec::new(),
            real_wires: Vec::new(),
            robot: RobotSettings::within(supervised_limits()),
        }
    }
}

impl Settings {
    /// Returns by what the commanded positions are judged.
    pub fn stream_rules(&self) -> StreamRules {
        self.robot.stream_rules(self.period_s, self.safety_limits)
    }
}
