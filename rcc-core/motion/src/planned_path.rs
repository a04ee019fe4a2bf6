//! A planned path: the curve of the flange or joints, the joints along it, and the limits of its path clock. Built off
//! the real-time thread, which evaluates flange and joints at a path position without allocation and in a bounded
//! number of steps.

use rcc_core::axis::AxisState;
use rcc_core::frame::DeviceModel;
use rcc_core::guard::JointLimits;
use rcc_core::kinematics::{Arm, ArmConfiguration};
use rcc_core::message::{JOINTS_MAX, Joints};
use rcc_core::path::MotionFault;
use rcc_core::pose::Pose;
use rcc_core::types::NULL_REAL;
use rcc_core::vector;

use crate::geometry::chain::{Chain, ChainPiece, ShapePoint};
use crate::geometry::jet::{Jet, JetScalar};
use elbow::ElbowProfile;
use time_law::TimeLaw;

mod elbow;
mod finite_differences;
mod goal_joints;
mod joint_follower;
mod leg_shape;
mod path_builder;
mod piece_samples;
mod sampled_path;
mod section;
mod slow_section;
pub(crate) mod speed_limits;
mod time_law;
mod time_optimal;

pub(crate) use leg_shape::metric;
pub(crate) use path_builder::build;
pub(crate) use section::{LawStops, MotionSection};
pub use section::{PlannedSection, TimeScaling};
pub use slow_section::SlowSection;

/// Steps per piece at which a path is first sampled when its motion is built.
const STEPS: usize = 128;

/// Input for the inverse kinematics along a piece of the flange.
#[derive(Debug, Clone)]
struct InverseHints {
    /// Branch and arm angle.
    elbow: ElbowProfile,
    /// Joints at equidistant steps: they select the turn of each joint, and its value in a singular position.
    joints: Box<[Joints]>,
}

/// The arm and its state at the start of a path.
#[derive(Clone, Copy)]
pub(crate) struct ArmStart<'a> {
    /// Kinematics and limits of the arm.
    pub(crate) model: &'a DeviceModel,
    /// Kinematics, taken from `model`.
    pub(crate) arm: Arm,
    /// Joints at the start, rad.
    pub(crate) joints: Joints,
    /// Flange at the start, in the base frame of the arm.
    pub(crate) pose: Pose,
}

/// Index of a leg and its fault.
pub(crate) type LegFault = (u32, MotionFault);

impl<'a> ArmStart<'a> {
    /// The start of an arm that is held at `hold` (rad); or, with `from`, of an arm whose flange is at `from`, in the
    /// branch and with the arm angle of `hold` and the joints nearest to it.
    ///
    /// # Errors
    /// Returns [`MotionFault`] if the arm cannot reach `from` that way.
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

/// The data of a piece that the cycle needs.
#[derive(Debug, Clone)]
struct PieceKinematics {
    /// `None` for a piece that is interpolated in joint space.
    inverse_hints: Option<InverseHints>,
    /// Distance of the flange along all previous pieces, m.
    distance_before_m: f64,
    /// Distance of the flange along this piece, m.
    length_m: f64,
}

/// How a section maps clock values to the path parameter s: directly, or through a time law.
#[derive(Debug, Clone)]
struct TimedSection {
    /// Clock value at which the section begins.
    begin: f64,
    /// Path parameter s at which it begins.
    begin_s: f64,
    time_law: Option<TimeLaw>,
}

/// State of the arm at a path position.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PathPoint {
    /// Flange in the base frame of the arm.
    pub(crate) pose: Pose,
    /// Joints, rad; null if the arm cannot reach the pose, which was checked when the motion was built.
    pub(crate) joints: Joints,
    /// Index of the leg.
    pub(crate) leg: u32,
    /// Distance of the flange from the start, m.
    pub(crate) distance: f64,
    /// Metres of the flange per unit of the clock.
    pub(crate) metres_per_s: f64,
    /// Derivative of `metres_per_s` by the clock value, as far as a time law accelerates.
    pub(crate) speed_slope: f64,
}

/// A planned path with its time laws.
#[derive(Debug, Clone)]
pub(crate) struct PlannedPath {
    arm: Arm,
    chain: Chain,
    parts: Box<[PieceKinematics]>,
    /// Index of the leg of each link of the chain.
    legs: Box<[u32]>,
    /// Empty if all clocks count s directly.
    timed_sections: Box<[TimedSection]>,
    shortened: Box<[ReducedBlend]>,
    slow: Box<[SlowSection]>,
}

/// A blend that is smaller than requested.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReducedBlend {
    /// Index of the leg at whose end it is.
    pub leg: u32,
    /// Requested zone, m.
    pub asked_m: f64,
    /// Actual zone, m; 0: the motion stops in the corner, or a leg beside it turns on the spot.
    pub made_m: f64,
}

impl PlannedPath {
    /// The blends that are smaller than requested.
    pub(crate) fn shortened(&self) -> &[ReducedBlend] {
        &self.shortened
    }

    /// The sections that take much longer than their limits require.
    pub(crate) fn slow(&self) -> &[SlowSection] {
        &self.slow
    }

    /// Path parameter s with its first two derivatives by the clock, at clock value `x`.
    fn s_at(&self, x: f64) -> [f64; 3] {
        let Some(timed_section) = self.timed_section(x) else {
            return [x, 1.0, 0.0];
        };
        let offset = x - timed_section.begin;
        match &timed_section.time_law {
            None => [timed_section.begin_s + offset, 1.0, 0.0],
            Some(time_law) => {
                let Jet([_, slope, bend, _]) = time_law.at(Jet::variable(offset));
                [time_law.position(offset), slope, bend]
            }
        }
    }

    /// The state at clock value `x`.
    pub(crate) fn at(&self, x: f64) -> PathPoint {
        self.point_at(self.s_at(x))
    }

    /// The state at path parameter `s`, without the time law.
    pub(crate) fn at_path_parameter(&self, s: f64) -> PathPoint {
        self.point_at([s, 1.0, 0.0])
    }

    /// Path parameter with velocity and acceleration, at clock value `x` with this velocity and acceleration of the
    /// clock.
    pub(crate) fn path_state_at(&self, x: f64, [velocity, acceleration]: [f64; 2]) -> AxisState {
        let [position, slope, bend] = self.s_at(x);
        AxisState {
            position,
            velocity: slope * velocity,
            acceleration: slope * acceleration + bend * velocity * velocity,
        }
    }

    /// Clock value at path parameter `s`, in the section that begins at clock value `begin`.
    pub(crate) fn clock_value_at(&self, begin: f64, s: f64) -> f64 {
        let timed_section = self.timed_section(begin);
        let time_law = timed_section.and_then(|timed_section| timed_section.time_law.as_ref());
        time_law.map_or(begin, |time_law| begin + time_law.inverse(s))
    }

    /// Path parameter at which the section that contains clock value `x` begins.
    pub(crate) fn section_begin_s(&self, x: f64) -> f64 {
        self.timed_section(x)
            .map_or(0.0, |timed_section| timed_section.begin_s)
    }

    fn timed_section(&self, x: f64) -> Option<&TimedSection> {
        let number = self
            .timed_sections
            .partition_point(|timed_section| timed_section.begin <= x);
        self.timed_sections.get(number.saturating_sub(1))
    }

    fn point_at(&self, [s, slope, bend]: [f64; 3]) -> PathPoint {
        let number = self.chain.number(s);
        let nowhere = PathPoint {
            pose: Pose::NULL,
            joints: [NULL_REAL; JOINTS_MAX],
            leg: 0,
            distance: 0.0,
            metres_per_s: 0.0,
            speed_slope: 0.0,
        };
        let pieces = self.chain.pieces().get(number);
        let (Some(piece), Some(part)) = (pieces, self.parts.get(number)) else {
            return nowhere;
        };
        let (pose, joints) = self.pose_and_joints(piece, part, s);
        let fraction = fraction_of(s - piece.begin, piece.length());
        let metres_per_s = self.metres_per_s(piece, s);
        PathPoint {
            pose,
            joints,
            leg: self.legs.get(piece.link).copied().unwrap_or(0),
            distance: part.distance_before_m + part.length_m * fraction,
            metres_per_s: metres_per_s * slope,
            speed_slope: metres_per_s * bend,
        }
    }

    fn pose_and_joints(
        &self,
        piece: &ChainPiece,
        part: &PieceKinematics,
        s: f64,
    ) -> (Pose, Joints) {
        let null = [NULL_REAL; JOINTS_MAX];
        match (piece.at(s), &part.inverse_hints) {
            (ShapePoint::Flange(point), Some(inverse_hints)) => {
                let pose = point.pose();
                let ArmConfiguration { branch, arm_angle } =
                    inverse_hints.elbow.at(piece.on_shape(s));
                let hint = inverse_hints.near(fraction_of(s - piece.begin, piece.length()));
                let joints = self.arm.inverse(&pose, arm_angle, branch, &hint);
                (pose, joints.unwrap_or(null))
            }
            (ShapePoint::Flange(point), None) => (point.pose(), null),
            (ShapePoint::Joints(joints), _) => (self.arm.forward(&joints), joints),
        }
    }

    /// Speed of the flange per unit of s, |dx/ds|.
    fn metres_per_s(&self, piece: &ChainPiece, s: f64) -> f64 {
        if let Some(constant) = piece.shape.constant_speed() {
            return constant;
        }
        match piece.at(Jet::variable(s)) {
            ShapePoint::Flange(point) => vector::norm(point.position.map(|x: Jet| x.derivative(1))),
            ShapePoint::Joints(jets) => flange_speed(self.arm, &jets),
        }
    }
}

impl InverseHints {
    /// The joints at the step nearest to a fraction of the piece.
    fn near(&self, fraction: f64) -> Joints {
        let last = self.joints.len().saturating_sub(1);
        // A fraction is in [0, 1]; NaN becomes 0.
        let step = (fraction * last as f64 + 0.5) as usize;
        let near = self.joints.get(step.min(last));
        near.copied().unwrap_or([0.0; JOINTS_MAX])
    }
}

/// Speed of the flange per unit of s, |dx/ds|, on a line of joints.
pub(crate) fn flange_speed(arm: Arm, jets: &[Jet; JOINTS_MAX]) -> f64 {
    let rows = arm.jacobian(&jets.map(JetScalar::value));
    let [x, y, z, ..] = rows.map(|row| {
        let products = row.iter().zip(jets);
        products.map(|(slope, jet)| slope * jet.derivative(1)).sum()
    });
    vector::norm([x, y, z])
}

fn fraction_of(offset: f64, length: f64) -> f64 {
    if length > 0.0 { offset / length } else { 0.0 }
}

/// Velocity, acceleration and jerk of each joint, as `[v, a, j]`; infinite beyond the joints.
pub(crate) fn joint_bounds(limits: &JointLimits, scale: f64) -> [[f64; 3]; JOINTS_MAX] {
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
mod serial;
#[cfg(test)]
mod six_axis;
#[cfg(test)]
pub(crate) mod tests;
