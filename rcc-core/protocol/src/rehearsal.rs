//! Result of the rehearsal of a net, part of the executor's answer to LOAD and START. Plain data between processes.

use rcc_core::path::Quantity;
use serde::{Deserialize, Serialize};

/// Summary of a rehearsal in which the net broke no limit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RehearsalReport {
    /// Simulated time, s.
    pub time_s: f64,
    /// How the rehearsal ended.
    pub end: RehearsalEnd,
    /// Number of cycles in which the net was evaluated.
    pub evaluations: u64,
    /// The condition of its `Termination` that ended the net, counted from 1 in the order of the text; 0: none did.
    pub outcome: u32,
    /// Highest use of the limits of velocity, acceleration and jerk by a joint.
    pub peaks: [LimitPeak; 3],
    /// Smallest distance to a singularity of a commanded arm, as defined by its kinematics; NaN if unknown.
    pub singularity: f64,
    /// Number of blends that are smaller than requested.
    pub shortened: u32,
    /// The blend with the largest shortfall, if any.
    pub most_shortened: Option<ShortenedBlend>,
    /// The motion that takes most time more than its limits require, if any takes much more.
    pub slowest: Option<SlowMotion>,
    /// Bit i: the net commands joints of device i, and gave it no set-point in any cycle.
    pub uncommanded: u64,
    /// Duration of the rehearsal, ns.
    pub took_ns: u64,
}

/// A blend (`blend`) that is smaller than requested.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ShortenedBlend {
    /// Index of the motion in its net.
    pub motion: u32,
    /// Index of the leg that ends at the blend, from 0.
    pub leg: u32,
    /// Requested blend distance, m.
    pub asked_m: f64,
    /// Actual blend distance, m; 0: the motion stops at the corner.
    pub made_m: f64,
}

/// A motion with a given velocity that takes much longer between two rests than its path and its limits require.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SlowMotion {
    /// Index of the motion in its net.
    pub motion: u32,
    /// Index of the leg with the place that slows it down, from 0.
    pub leg: u32,
    /// Position of that place on the leg, 0 to 1.
    pub fraction: f64,
    /// The quantity that is at its limit there.
    pub quantity: Quantity,
    /// Order of the limit: 1 velocity, 2 acceleration, 3 jerk.
    pub order: u8,
    /// Time between the rests, s.
    pub takes_s: f64,
    /// A time that the same limits allow, s.
    pub possible_s: f64,
}

/// How a rehearsal ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum RehearsalEnd {
    /// The net terminated.
    Finished,
    /// Nothing moves any more: the net waits for an external event, which a rehearsal does not know.
    Waits,
    /// The net was still running when the time or work limit of the rehearsal was reached.
    TooLong,
    /// Its first set-points differ from the current hold positions, or an arm is not at rest: START checks again.
    Elsewhere,
}

/// Use of a limit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LimitPeak {
    /// Device index.
    pub device: u32,
    /// Joint, counted from 1; 0 = no joint moved.
    pub joint: u32,
    /// Value divided by the limit; 1 = the limit is fully used.
    pub share: f64,
}

impl LimitPeak {
    /// Nothing moved.
    pub const NONE: LimitPeak = LimitPeak {
        device: 0,
        joint: 0,
        share: 0.0,
    };
}

/// A violation of an arm's limits that the rehearsal predicts, before anything is commanded.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PredictedViolation {
    /// The violated rule.
    pub rule: RehearsalRule,
    /// Device index.
    pub device: u32,
    /// Joint, counted from 1; for [`RehearsalRule::Workspace`] the axis: 1, 2, 3 = x, y, z; for
    /// [`RehearsalRule::Singularity`] its kind as in [`rcc_core::kinematics::SingularityKind::number`]; else 0.
    pub joint: u32,
    /// Predicted value: rad, rad/s, rad/s², rad/s³; m for the workspace; the distance to a singular position is a sine.
    pub value: f64,
    /// The allowed value.
    pub limit: f64,
    /// Time after START, s.
    pub time_s: f64,
    /// Position of the motion at that time, if one is in progress.
    pub place: Option<LegPosition>,
    /// Effect of going slower.
    pub slower: SlowerMotion,
    /// The singular position that an arm came closest to in the whole rehearsal; `None` if unknown, or if the net
    /// computes no joints from poses, so that a singular position cannot be the reason.
    pub near: Option<NearestSingularity>,
}

/// Whether a net would keep the limits of velocity, acceleration and jerk if everything in it took longer.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum SlowerMotion {
    /// Another limit is violated, or it was not tried.
    Unknown,
    /// It would, as a second rehearsal showed.
    KeepsLimits {
        /// Fraction of its speed, less than 1.
        speed: f64,
    },
    /// It would not at any useful speed: the set-point jumps from one cycle to the next.
    Jumps,
}

/// A singular position.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct NearestSingularity {
    /// Kind of the singularity, as in [`rcc_core::kinematics::SingularityKind::number`].
    pub kind: u32,
    /// Distance, as defined by [`rcc_core::kinematics::Singularity::distance`].
    pub distance: f64,
}

/// Position of a motion on its path.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LegPosition {
    /// Index of the motion in its net.
    pub motion: u32,
    /// Index of the current leg, from 0.
    pub leg: u32,
    /// Fraction of the path (to its end in the rehearsal) that has been travelled, 0 to 1; NaN if unknown.
    pub fraction: f64,
    /// Distance travelled by the flange since the start, m.
    pub distance_m: f64,
}

/// Rules that a rehearsal checks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum RehearsalRule {
    /// A set-point must be finite.
    NotFinite,
    /// Position range of a joint.
    Position,
    /// Maximum velocity of a joint.
    Velocity,
    /// Maximum acceleration of a joint.
    Acceleration,
    /// Maximum jerk of a joint.
    Jerk,
    /// Workspace of the device.
    Workspace,
    /// Minimum distance to a singular position, from the workspace of the device.
    Singularity,
    /// An arm must not be released while it moves: a set-point became null, usually because a pose cannot be reached.
    LetsGo,
    /// Stiffness, damping, or additional force or torque. Value and limit are in the unit of the kind.
    Impedance {
        /// [`rcc_core::guard::ViolationKind`] as a number; its axis or joint is in [`PredictedViolation::joint`], from
        /// 1.
        kind: u32,
    },
    /// The net itself ends with a fault: [`rcc_core::message::FaultCode`] as a number in `value`.
    Fault,
}
