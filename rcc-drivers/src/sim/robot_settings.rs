//! Settings that every simulated arm behind FRI has, with their defaults.
//! Plain data; read only by the clock thread.
//!
//! KUKA publishes neither thresholds of the connection quality, nor tolerances, nor the number of bridged answers: those values are
//! **our own**.

use super::arm::Joints;
use super::arm::command_stream::{StreamRules, SupervisedLimits};
use super::arm::dynamics::FlangeLoad;
use super::arm::environment::{Environment, Wall};
use super::quality::QualityThresholds;

/// Settings of one simulated arm.
#[derive(Clone, Debug, PartialEq)]
pub struct RobotSettings {
    /// Joint positions at the start, rad.
    pub start: Joints,
    /// How long the arm must be at rest before a fault is acknowledged, s. The default is our own.
    pub acknowledge_after_s: f64,
    /// Supervised limits.
    pub limits: SupervisedLimits,
    /// Time constant of the low-pass that the supervised acceleration is taken behind, s; 0: the second difference of the
    /// commanded positions. The rule and the default are our own.
    pub acceleration_filter_s: f64,
    /// Largest difference between the command and the robot's own position when commands begin to be executed, rad. The default is
    /// our own.
    pub mirror_tolerance_rad: f64,
    /// Number of consecutive missed answers that are bridged with the last velocity; one more stops the arm. The default is our
    /// own.
    pub bridged_misses: u32,
    /// Largest deceleration of a stop, rad/s². The default is our own.
    pub brake_deceleration: f64,
    /// Largest jerk of a stop, rad/s³. The default is our own.
    pub brake_jerk: f64,
    /// Bandwidth of the simulated position control, rad/s. The default is our own.
    pub bandwidth_rad_s: f64,
    /// Thresholds of the quality.
    pub quality: QualityThresholds,
    /// Obstacle at the start.
    pub wall: Option<Wall>,
    /// Load at the start.
    pub load: Option<FlangeLoad>,
    /// Seed of the random numbers for answers that are dropped on request.
    pub seed: u64,
}

impl RobotSettings {
    /// Returns the defaults for an arm with these limits.
    #[expect(
        clippy::approx_constant,
        reason = "the start is a pose, given with four digits as on the command line"
    )]
    #[must_use]
    pub fn within(limits: SupervisedLimits) -> Self {
        Self {
            start: [0.0, 0.5236, 0.0, -1.5708, 0.0, 1.0472, 0.0],
            acknowledge_after_s: 0.5,
            limits,
            acceleration_filter_s: 0.01,
            mirror_tolerance_rad: 0.01,
            bridged_misses: 5,
            brake_deceleration: 8.0,
            brake_jerk: 200.0,
            bandwidth_rad_s: 80.0,
            quality: QualityThresholds::default(),
            wall: None,
            load: None,
            seed: 1,
        }
    }

    /// Returns by what the commanded positions are judged, with this factor on velocity and acceleration limits.
    #[must_use]
    pub fn stream_rules(&self, period_s: f64, scale: f64) -> StreamRules {
        StreamRules {
            period_s,
            limits: self.limits,
            scale,
            acceleration_filter_s: self.acceleration_filter_s,
        }
    }

    /// Returns what acts on the flange at the start.
    #[must_use]
    pub fn environment(&self) -> Environment {
        Environment {
            wall: self.wall,
            load: self.load,
            injected: [0.0; 6],
        }
    }
}
