//! What the rehearsal of a net came to: the executor's answer to LOAD and START has it. Plain data between processes.

use serde::{Deserialize, Serialize};

/// What a net did in its rehearsal, when it broke no limit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RehearsalReport {
    /// Virtual time, s.
    pub time_s: f64,
    /// How it ended.
    pub end: RehearsalEnd,
    /// Greatest share of the limit of velocity, acceleration and jerk that a joint used.
    pub peaks: [LimitPeak; 3],
    /// Smallest distance to a singularity of an arm that it commands, as its kinematics define it; NaN = not known.
    pub singularity: f64,
    /// How many roundings of its paths are smaller than asked for.
    pub shortened: u32,
    /// The one of them that lacks most, if any.
    pub most_shortened: Option<ShortenedBlend>,
    /// What the rehearsal took, ns.
    pub took_ns: u64,
}

/// A rounding (`blend`) that is smaller than asked for.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ShortenedBlend {
    /// Index of the motion in its net.
    pub motion: u32,
    /// The leg at whose end it is, from 0.
    pub leg: u32,
    /// What was asked for, m.
    pub asked_m: f64,
    /// What there is, m; 0: the motion rests in the corner.
    pub made_m: f64,
}

/// How a rehearsal ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum RehearsalEnd {
    /// The net said that it is over.
    Finished,
    /// Nothing moved any more: it waits for something outside, which a rehearsal does not know.
    Waits,
    /// It went on when the time or the work of a rehearsal was used up.
    TooLong,
    /// Its first set-points are not where its arms are held now, or an arm does not rest: START compares again.
    Elsewhere,
}

/// How much of a limit was used.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LimitPeak {
    /// Device index.
    pub device: u32,
    /// Joint, counted from 1; 0 = no joint moved.
    pub joint: u32,
    /// Value in parts of the limit; 1 = all of it.
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

/// What a net would do that its arm does not allow, found out before anything is commanded.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PredictedViolation {
    /// Which rule it would break.
    pub rule: RehearsalRule,
    /// Device index.
    pub device: u32,
    /// Joint, counted from 1; of [`RehearsalRule::Workspace`] the axis: 1, 2, 3 = x, y, z; of [`RehearsalRule::Singularity`] its
    /// kind as [`rcc_core::kinematics::SingularityKind::number`] counts; else 0.
    pub joint: u32,
    /// What it would be: rad, rad/s, rad/s², rad/s³; of the workspace m; the distance to a singular position
    /// is a sine.
    pub value: f64,
    /// What is allowed.
    pub limit: f64,
    /// When, in s after START.
    pub time_s: f64,
    /// Where a motion is at that time, if one is under way.
    pub place: Option<LegPosition>,
    /// With so much of its speed the motion would keep all limits of speed, acceleration and jerk; 1 = speed is not the
    /// reason.
    pub speed: f64,
    /// The singular position that an arm came nearest to on the whole way; `None` = not known.
    pub near: Option<NearestSingularity>,
}

/// A singular position.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct NearestSingularity {
    /// As [`rcc_core::kinematics::SingularityKind::number`] counts.
    pub kind: u32,
    /// How far it is, as [`rcc_core::kinematics::Singularity::distance`] says.
    pub distance: f64,
}

/// Where a motion is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LegPosition {
    /// Index of the motion in its net.
    pub motion: u32,
    /// The leg that it is in, from 0.
    pub leg: u32,
    /// Part of the way to where the motion ends (in the rehearsal) that lies behind it, 0 to 1; NaN = not known.
    pub fraction: f64,
    /// Way of the flange since the start, m.
    pub distance_m: f64,
}

/// The rules of a rehearsal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum RehearsalRule {
    /// A set-point is a finite number.
    NotFinite,
    /// Range of a joint.
    Position,
    /// Largest velocity of a joint.
    Velocity,
    /// Largest acceleration of a joint.
    Acceleration,
    /// Largest jerk of a joint.
    Jerk,
    /// The workspace of the device.
    Workspace,
    /// How near to a singular position the workspace of the device lets it come.
    Singularity,
    /// An arm is not let go of while it moves: a set-point that becomes null, mostly of a pose that cannot be reached.
    LetsGo,
    /// Stiffness, damping, or what is added to them. Value and limit are in the unit of the kind.
    Impedance {
        /// [`rcc_core::guard::ViolationKind`] as a number; its axis or joint is in [`PredictedViolation::joint`], from 1.
        kind: u32,
    },
    /// No fault of the net itself, [`rcc_core::message::FaultCode`] as a number in `value`.
    Fault,
}
