//! A path that a net asked for, built: its curve, the joints along it, and how fast it may be gone along.
//! Built off the real-time thread; asked by it where flange and joints are at s, without a heap and in bounded steps.

use rcc_core::guard::JointLimits;
use rcc_core::kinematics::{Arm, Configuration};
use rcc_core::message::{JOINTS_MAX, Joints};
use rcc_core::pose::Pose;
use rcc_core::types::NULL_REAL;
use rcc_core::vector;

use crate::geometry::chain::{Chain, Piece, Where};
use crate::geometry::jet::{Jet, Scalar};
use crate::path_clock::PathBounds;

pub(crate) mod bounds;
mod build;
mod draft;
mod sampling;
mod walk;

pub(crate) use build::{Traveller, build};

/// Steps in which a piece is looked at when its motion is built.
const STEPS: usize = 128;

/// What makes the joints of a pose along a piece.
#[derive(Debug, Clone)]
struct Guide {
    /// Branch and arm angle.
    configuration: Configuration,
    /// Joints at even steps: which turns they are at, and what they do in a singular position.
    joints: Box<[Joints]>,
}

/// A piece with what the cycle needs to know of it.
#[derive(Debug, Clone)]
struct Part {
    /// `None` for a piece of joints, and for one of which only poses are asked for.
    guide: Option<Guide>,
    /// Way of the flange before it, m.
    begin_m: f64,
    /// Its own way, m.
    way_m: f64,
}

/// From rest to rest.
#[derive(Debug, Clone)]
pub(crate) struct Section {
    /// s of the path where it begins.
    pub(crate) begin: f64,
    /// What its clock keeps.
    pub(crate) bounds: PathBounds,
}

/// Where a motion is.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Place {
    /// Flange in the arm's base.
    pub(crate) pose: Pose,
    /// rad; null if only poses are asked for.
    pub(crate) joints: Joints,
    /// The leg that it is on.
    pub(crate) leg: u32,
    /// Way of the flange since the start, m.
    pub(crate) distance: f64,
    /// Metres of the flange per unit of s.
    pub(crate) metres_per_s: f64,
}

/// A path.
#[derive(Debug, Clone)]
pub(crate) struct Track {
    arm: Arm,
    chain: Chain,
    parts: Box<[Part]>,
    /// The leg of each link of the chain.
    legs: Box<[u32]>,
}

impl Track {
    /// Its length in s.
    pub(crate) fn length(&self) -> f64 {
        self.chain.length()
    }

    /// Where the motion is at s.
    pub(crate) fn at(&self, s: f64) -> Place {
        let number = self.chain.number(s);
        let nowhere = Place {
            pose: Pose::NULL,
            joints: [NULL_REAL; JOINTS_MAX],
            leg: 0,
            distance: 0.0,
            metres_per_s: 0.0,
        };
        let pieces = self.chain.pieces().get(number);
        let (Some(piece), Some(part)) = (pieces, self.parts.get(number)) else {
            return nowhere;
        };
        let (pose, joints) = self.pose_and_joints(piece, part, s);
        let fraction = part_of(s - piece.begin, piece.length());
        Place {
            pose,
            joints,
            leg: self.legs.get(piece.link).copied().unwrap_or(0),
            distance: part.begin_m + part.way_m * fraction,
            metres_per_s: self.metres_per_s(piece, s),
        }
    }

    fn pose_and_joints(&self, piece: &Piece, part: &Part, s: f64) -> (Pose, Joints) {
        let null = [NULL_REAL; JOINTS_MAX];
        match (piece.at(s), &part.guide) {
            (Where::Flange(place), Some(guide)) => {
                let pose = place.pose();
                let Configuration { branch, arm_angle } = guide.configuration;
                let hint = guide.near(part_of(s - piece.begin, piece.length()));
                let joints = self.arm.inverse(&pose, arm_angle, branch, &hint);
                (pose, joints.unwrap_or(null))
            }
            (Where::Flange(place), None) => (place.pose(), null),
            (Where::Joints(joints), _) => (self.arm.forward(&joints), joints),
        }
    }

    /// |dx/ds| of the flange.
    fn metres_per_s(&self, piece: &Piece, s: f64) -> f64 {
        if let Some(constant) = piece.shape.constant_speed() {
            return constant;
        }
        match piece.at(Jet::variable(s)) {
            Where::Flange(place) => vector::norm(place.position.map(|x: Jet| x.derivative(1))),
            Where::Joints(jets) => {
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

impl Guide {
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
mod tests;
