//! Settings of the simulated cabinet with their defaults.
//! Plain data; read only by the clock thread.

use super::robot::ArmKind;
use super::station::{SignalLoopback, StationSignal};
use crate::fri_iiwa::wire::{ClientCommandMode, ControlMode, OperationMode, Version};
use crate::sim::arm::command_stream::StreamRules;
use crate::sim::arm::impedance::{ControlLaw, ImpedanceSettings};
use crate::sim::robot_settings::RobotSettings;

/// Longest time between two answers with which commands are executed, ms (KUKA).
pub const COMMAND_PERIOD_MAX_MS: u32 = 10;

/// Quantity that the motion's overlay lets the client command.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Serialize, serde::Deserialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum OverlayMode {
    /// Joint positions.
    Position,
    /// Joint positions and a wrench; Cartesian impedance control.
    Wrench,
    /// Joint positions and joint torques; joint impedance control.
    Torque,
    /// A Cartesian pose; 2.x.
    CartesianPose,
}

impl OverlayMode {
    /// Returns the mode on the wire.
    #[must_use]
    pub fn on_wire(self) -> ClientCommandMode {
        match self {
            OverlayMode::Position => ClientCommandMode::JointPosition,
            OverlayMode::Wrench => ClientCommandMode::Wrench,
            OverlayMode::Torque => ClientCommandMode::Torque,
            OverlayMode::CartesianPose => ClientCommandMode::CartesianPose,
        }
    }

    /// Returns the control law that the mode needs; `None`: any.
    #[must_use]
    pub fn needed_law(self) -> Option<ControlLaw> {
        match self {
            OverlayMode::Position | OverlayMode::CartesianPose => None,
            OverlayMode::Wrench => Some(ControlLaw::CartesianImpedance),
            OverlayMode::Torque => Some(ControlLaw::JointImpedance),
        }
    }
}

/// Returns the law on the wire.
#[must_use]
pub fn law_on_wire(law: ControlLaw) -> ControlMode {
    match law {
        ControlLaw::Position => ControlMode::Position,
        ControlLaw::CartesianImpedance => ControlMode::CartesianImpedance,
        ControlLaw::JointImpedance => ControlMode::JointImpedance,
    }
}

/// Operating mode, as the selector on the pendant has it.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Serialize, serde::Deserialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum Selector {
    /// Manual, reduced speed.
    T1,
    /// Manual, full speed.
    T2,
    /// Automatic.
    Aut,
}

impl Selector {
    /// Returns the mode on the wire.
    #[must_use]
    pub fn on_wire(self) -> OperationMode {
        match self {
            Selector::T1 => OperationMode::T1,
            Selector::T2 => OperationMode::T2,
            Selector::Aut => OperationMode::Automatic,
        }
    }
}

/// When the application starts a motion with an overlay, and starts it again after a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum MotionStart {
    /// As soon as its conditions hold; after a fault once the arm has been at rest for 0.5 s (our own value).
    Auto,
    /// At a request of the control port only.
    Manual,
}

/// How a motion moves the joints, and what its overlay lets the client command.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ControlSettings {
    /// Controller of the joints.
    pub law: ControlLaw,
    /// Quantity that the client commands.
    pub overlay: OverlayMode,
    /// Springs and dampers.
    pub impedance: ImpedanceSettings,
}

/// Why a motion cannot have this control law and overlay.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum OverlayError {
    /// The overlay needs another law.
    #[error("the overlay {overlay:?} needs {law:?} control")]
    Law {
        /// The overlay.
        overlay: OverlayMode,
        /// Law that it needs.
        law: ControlLaw,
    },
    /// The version has no Cartesian overlay.
    #[error("FRI 1.x has no overlay of Cartesian poses: choose version 2.5 or 2.7")]
    Version,
}

impl OverlayMode {
    /// Checks that a motion with this law can have the overlay in this version.
    ///
    /// # Errors
    /// Returns what it needs.
    pub fn check(self, law: ControlLaw, version: Version) -> Result<(), OverlayError> {
        if self == OverlayMode::CartesianPose && !version.is_second() {
            return Err(OverlayError::Version);
        }
        match self.needed_law() {
            Some(needed) if needed != law => Err(OverlayError::Law {
                overlay: self,
                law: needed,
            }),
            _ => Ok(()),
        }
    }
}

/// All settings of one simulated cabinet.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Version of the wire.
    pub version: Version,
    /// Arm.
    pub arm: ArmKind,
    /// Send period, ms.
    pub period_ms: u32,
    /// Receive multiplier.
    pub multiplier: u32,
    /// Controller of the joints.
    pub law: ControlLaw,
    /// Quantity that the overlay lets the client command.
    pub overlay: OverlayMode,
    /// Springs and dampers in impedance control; the application's, FRI does not command them.
    pub impedance: ImpedanceSettings,
    /// When motions start.
    pub motion: MotionStart,
    /// Answers with which the robot synchronises before it executes commands.
    pub synchronising_answers: u32,
    /// Operating mode at the start.
    pub selector: Selector,
    /// Inputs and outputs of the station.
    pub signals: Vec<StationSignal>,
    /// Outputs that are looped back to inputs.
    pub loopbacks: Vec<SignalLoopback>,
    /// Settings of every simulated arm.
    pub robot: RobotSettings,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            version: Version::V1_14,
            arm: ArmKind::Iiwa7,
            period_ms: 1,
            multiplier: 1,
            law: ControlLaw::Position,
            overlay: OverlayMode::Position,
            impedance: ImpedanceSettings::default_for(ControlLaw::Position),
            motion: MotionStart::Auto,
            synchronising_answers: 10,
            selector: Selector::Aut,
            signals: Vec::new(),
            loopbacks: Vec::new(),
            robot: RobotSettings::within(ArmKind::Iiwa7.limits()),
        }
    }
}

impl Settings {
    /// Returns the send period, s.
    #[must_use]
    pub fn period_s(&self) -> f64 {
        f64::from(self.period_ms) * 1e-3
    }

    /// Returns by what the commanded positions are judged, one message after the other.
    #[must_use]
    pub fn stream_rules(&self) -> StreamRules {
        self.robot.stream_rules(self.period_s(), 1.0)
    }
}
