//! A path that a net asked for, built: its curve, the joints along it, and how fast it may be gone along.
//! Built off the real-time thread; asked by it where flange and joints are at s, without a heap and in bounded steps.

use rcc_core::frame::DeviceModel;
use rcc_core::guard::JointLimits;
use rcc_core::kinematics::{Arm, ArmConfiguration};
use rcc_core::message::{JOINTS_MAX, Joints};
use rcc_core::path::MotionFault;
use rcc_core::pose::Pose;
use rcc_core::types::NULL_REAL;
use rcc_core::vector;

use crate::geometry::chain::{Chain, ChainPiece, ShapePoint};
use crate::geometry::jet::{Jet, Scalar};
use crate::jerk_profile::KinematicState;
use crate::path_clock::PathBounds;
use elbow::ElbowProfile;
use speed_limits::BrakingLimits;
use time_law::TimeLaw;

mod elbow;
mod finite_differences;
mod joint_follower;
mod leg_shape;
mod path_builder;
mod piece_samples;
pub(crate) mod speed_limits;
mod time_law;
mod time_optimal;

pub(crate) use path_builder::{ArmStart, build};

/// Steps in which a piece is looked at when its motion is built.
const STEPS: usize = 128;

/// What makes the joints of a pose along a piece.
#[derive(Debug, Clone)]
struct InverseHints {
    /// Branch and arm angle.
    elbow: ElbowProfile,
    /// Joints at even steps: which turns they are at, and what they do in a singular position.
    joints: Box<[Joints]>,
}

impl<'a> ArmStart<'a> {
    /// An arm that is held at `hold`; or that is at `from` with the joints that are near `hold`, on its branch and with its
    /// arm angle.
    ///
    /// # Errors
    /// The arm cannot be at `from` that way.
    pub(crate) fn starting(
        model: &'a DeviceModel,
        arm: Arm,
        hold: Joints,
        from: Option<Pose>,
    ) -> Result<Self, MotionFault> {
        let there =
            |pose| arm.inverse_within(&pose, arm.configuration(&hold), &hold, &model.limits);
        let joints = from.map_or(Ok(hold), there);
        let joints = joints.map_err(|error| joint_follower::no_joints(error, 0.0))?;
        Ok(Self {
            model,
            arm,
            joints,
            pose: from.unwrap_or_else(|| arm.forward(&joints)),
        })
    }
}

/// A piece with what the cycle needs to know of it.
#[derive(Debug, Clone)]
struct PieceKinematics {
    /// `None` for a piece of joints.
    hints: Option<InverseHints>,
    /// Way of the flange before it, m.
    begin_m: f64,
    /// Its own way, m.
    way_m: f64,
}

/// From rest to rest.
#[derive(Debug, Clone)]
pub(crate) struct MotionSection {
    /// What the clocks have counted where it begins.
    pub(crate) begin: f64,
    /// What its clock counts from its beginning to its end.
    pub(crate) length: f64,
    /// What its clock keeps.
    pub(crate) bounds: PathBounds,
    /// Of a section with a law, which rests at both ends by itself, so that its clock passes them: what a clock keeps that
    /// counts the way itself and stops.
    pub(crate) stops: Option<Box<[BrakingLimits]>>,
}

/// What a clock counts in a section: s of the chain, or the time of a law.
#[derive(Debug, Clone)]
struct TimedSection {
    /// What the clocks have counted where it begins.
    begin: f64,
    /// s of the chain where it begins.
    begin_s: f64,
    time_law: Option<TimeLaw>,
}

/// Where a motion is.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PathPoint {
    /// Flange in the arm's base.
    pub(crate) pose: Pose,
    /// rad; null if the flange cannot be brought there, which was looked at when the motion was built.
    pub(crate) joints: Joints,
    /// The leg that it is on.
    pub(crate) leg: u32,
    /// Way of the flange since the start, m.
    pub(crate) distance: f64,
    /// Metres of the flange per unit of what the clock counts.
    pub(crate) metres_per_s: f64,
    /// How that changes by what the clock counts, where a law accelerates.
    pub(crate) rise: f64,
}

/// A path.
#[derive(Debug, Clone)]
pub(crate) struct PlannedPath {
    arm: Arm,
    chain: Chain,
    parts: Box<[PieceKinematics]>,
    /// The leg of each link of the chain.
    legs: Box<[u32]>,
    /// None where all clocks count s of the chain.
    timed_sections: Box<[TimedSection]>,
    shortened: Box<[ReducedBlend]>,
}

/// A rounding that is smaller than asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReducedBlend {
    /// The leg at whose end it is.
    pub leg: u32,
    /// What was asked for, m.
    pub asked_m: f64,
    /// What there is, m; 0: the motion rests in the corner.
    pub made_m: f64,
}

impl PlannedPath {
    /// The roundings that are smaller than asked for.
    pub(crate) fn shortened(&self) -> &[ReducedBlend] {
        &self.shortened
    }

    /// s of the chain with its first two derivatives, where the clocks have counted `x`.
    fn s_at(&self, x: f64) -> [f64; 3] {
        let Some(timed_section) = self.timed_section(x) else {
            return [x, 1.0, 0.0];
        };
        let way = x - timed_section.begin;
        match &timed_section.time_law {
            None => [timed_section.begin_s + way, 1.0, 0.0],
            Some(time_law) => {
                let Jet([_, slope, bend, _]) = time_law.at(Jet::variable(way));
                [time_law.place(way), slope, bend]
            }
        }
    }

    /// Where the motion is, where the clocks have counted `x`.
    pub(crate) fn at(&self, x: f64) -> PathPoint {
        self.place(self.s_at(x))
    }

    /// Where the motion is at s of the chain, whatever a law makes of it.
    pub(crate) fn on_way(&self, s: f64) -> PathPoint {
        self.place([s, 1.0, 0.0])
    }

    /// s of the chain where the clocks have counted `x` and go on at `velocity` and `acceleration`.
    pub(crate) fn way_at(&self, x: f64, [velocity, acceleration]: [f64; 2]) -> KinematicState {
        let [position, slope, bend] = self.s_at(x);
        KinematicState {
            position,
            velocity: slope * velocity,
            acceleration: slope * acceleration + bend * velocity * velocity,
        }
    }

    /// What the clocks have counted at s of the chain, in the stretch that begins where they have counted `begin`.
    pub(crate) fn counted(&self, begin: f64, s: f64) -> f64 {
        let timed_section = self.timed_section(begin);
        let time_law = timed_section.and_then(|timed_section| timed_section.time_law.as_ref());
        time_law.map_or(begin, |time_law| begin + time_law.inverse(s))
    }

    /// s of the chain where the stretch begins that the clocks are in at `x`.
    pub(crate) fn begins_at(&self, x: f64) -> f64 {
        self.timed_section(x)
            .map_or(0.0, |timed_section| timed_section.begin_s)
    }

    fn timed_section(&self, x: f64) -> Option<&TimedSection> {
        let number = self
            .timed_sections
            .partition_point(|timed_section| timed_section.begin <= x);
        self.timed_sections.get(number.saturating_sub(1))
    }

    fn place(&self, [s, slope, bend]: [f64; 3]) -> PathPoint {
        let number = self.chain.number(s);
        let nowhere = PathPoint {
            pose: Pose::NULL,
            joints: [NULL_REAL; JOINTS_MAX],
            leg: 0,
            distance: 0.0,
            metres_per_s: 0.0,
            rise: 0.0,
        };
        let pieces = self.chain.pieces().get(number);
        let (Some(piece), Some(part)) = (pieces, self.parts.get(number)) else {
            return nowhere;
        };
        let (pose, joints) = self.pose_and_joints(piece, part, s);
        let fraction = part_of(s - piece.begin, piece.length());
        let metres_per_s = self.metres_per_s(piece, s);
        PathPoint {
            pose,
            joints,
            leg: self.legs.get(piece.link).copied().unwrap_or(0),
            distance: part.begin_m + part.way_m * fraction,
            metres_per_s: metres_per_s * slope,
            rise: metres_per_s * bend,
        }
    }

    fn pose_and_joints(
        &self,
        piece: &ChainPiece,
        part: &PieceKinematics,
        s: f64,
    ) -> (Pose, Joints) {
        let null = [NULL_REAL; JOINTS_MAX];
        match (piece.at(s), &part.hints) {
            (ShapePoint::Flange(place), Some(hints)) => {
                let pose = place.pose();
                let ArmConfiguration { branch, arm_angle } = hints.elbow.at(piece.on_shape(s));
                let hint = hints.near(part_of(s - piece.begin, piece.length()));
                let joints = self.arm.inverse(&pose, arm_angle, branch, &hint);
                (pose, joints.unwrap_or(null))
            }
            (ShapePoint::Flange(place), None) => (place.pose(), null),
            (ShapePoint::Joints(joints), _) => (self.arm.forward(&joints), joints),
        }
    }

    /// |dx/ds| of the flange.
    fn metres_per_s(&self, piece: &ChainPiece, s: f64) -> f64 {
        if let Some(constant) = piece.shape.constant_speed() {
            return constant;
        }
        match piece.at(Jet::variable(s)) {
            ShapePoint::Flange(place) => vector::norm(place.position.map(|x: Jet| x.derivative(1))),
            ShapePoint::Joints(jets) => {
                let rows = self.arm.jacobian(&jets.map(Scalar::value));
                let [x, y, z, ..] = rows.map(|row| {
                    let products = row.iter().zip(jets);
                    products.map(|(slope, jet)| slope * jet.derivative(1)).sum()
                });
                vector::norm([x, y, z])
            }
        }
    }
}

impl InverseHints {
    /// The joints of the step next to a fraction of the piece.
    fn near(&self, fraction: f64) -> Joints {
        let last = self.joints.len().saturating_sub(1);
        // A fraction is in [0, 1]; NaN becomes 0.
        let step = (fraction * last as f64 + 0.5) as usize;
        let near = self.joints.get(step.min(last));
        near.copied().unwrap_or([0.0; JOINTS_MAX])
    }
}

fn part_of(way: f64, length: f64) -> f64 {
    if length > 0.0 { way / length } else { 0.0 }
}

/// Velocity, acceleration and jerk of each joint, as `[v, a, j]`; infinite beyond the joints.
fn joint_bounds(limits: &JointLimits, scale: f64) -> [[f64; 3]; JOINTS_MAX] {
    core::array::from_fn(|joint| {
        if joint < limits.joints {
            [
                limits.velocity_max[joint] * scale,
                limits.acceleration_max[joint] * scale,
                limits.jerk_max[joint] * scale,
            ]
        } else {
            [f64::INFINITY; 3]
        }
    })
}

#[cfg(test)]
mod six_axis;
#[cfg(test)]
pub(crate) mod tests;
