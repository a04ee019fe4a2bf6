//! An arm of any supported kind behind one set of functions, which the rest of the core uses. Plain data, `Copy`, no
//! heap; each function matches on the kind once. Used by the loader and by the real-time thread.

use core::fmt;

use super::ArmJacobian;
use super::axes::AXES_MAX;
use super::branch::{ArmConfiguration, BRANCHES, Branch, Unreachable};
use super::links::LinkPoints;
use super::ortho::OrthoParallelArm;
use super::serial::{JointAxis, SerialArm};
use super::singularity::Singularity;
use super::srs::SrsArm;
use super::turns::{OutOfLimits, nearest_turns, turns_within, within_limits};
use crate::joints::{JointLimits, Joints};
use crate::pose::Pose;

/// Largest number of parameters that describe an arm, see [`Arm::parameters`].
pub const PARAMETERS: usize = 2 + 6 * AXES_MAX + 7;

/// Number of parameters that describe an arm in closed form.
const CLOSED_FORM_PARAMETERS: usize = 19;

/// The kinematics of an arm. Joint positions are in rad, those of linear axes in m, in the robot's own directions and zeros, from the base to the
/// flange; elements beyond [`Arm::joints`] are ignored in arguments and 0 in results.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(
    clippy::large_enum_variant,
    reason = "without heap; an arm is copied when a net is made, never in a cycle"
)]
pub enum Arm {
    /// Seven joints: spherical shoulder, elbow hinge, spherical wrist.
    Srs(SrsArm),
    /// Six joints: two parallel axes perpendicular to the first, spherical wrist.
    OrthoParallel(OrthoParallelArm),
    /// One to seven revolute axes in any arrangement, or one to six linear axes; the inverse is numeric and has no branches.
    Serial(SerialArm),
}

impl Arm {
    /// Returns the number of joints: 1 to 7.
    #[must_use]
    pub const fn joints(&self) -> usize {
        match self {
            Arm::Srs(_) => 7,
            Arm::OrthoParallel(_) => 6,
            Arm::Serial(arm) => arm.joints(),
        }
    }

    /// Returns true if the joints are linear axes: their positions are in m.
    #[must_use]
    pub const fn is_linear(&self) -> bool {
        match self {
            Arm::Serial(arm) => arm.is_linear(),
            Arm::Srs(_) | Arm::OrthoParallel(_) => false,
        }
    }

    /// Returns the flange pose in the base frame. NaN in, NaN out.
    #[must_use]
    pub fn forward(&self, joints: &Joints) -> Pose {
        match self {
            Arm::Srs(arm) => arm.forward(&seven(joints)),
            Arm::OrthoParallel(arm) => arm.forward(&six(joints)),
            Arm::Serial(arm) => arm.forward(joints),
        }
    }

    /// Returns base, shoulder, elbow, wrist and flange in the base frame, m, for a [`SerialArm`] base, axes and flange: the
    /// ends of the links as they are drawn. NaN in, NaN out.
    #[must_use]
    pub fn link_points(&self, joints: &Joints) -> LinkPoints {
        match self {
            Arm::Srs(arm) => LinkPoints::of(arm.origins(&seven(joints))),
            Arm::OrthoParallel(arm) => LinkPoints::of(arm.origins(&six(joints))),
            Arm::Serial(arm) => arm.link_points(joints),
        }
    }

    /// Returns the geometric Jacobian. NaN in, NaN out.
    #[must_use]
    pub fn jacobian(&self, joints: &Joints) -> ArmJacobian {
        match self {
            Arm::Srs(arm) => arm.jacobian(&seven(joints)).map(from_seven),
            Arm::OrthoParallel(arm) => arm.jacobian(&six(joints)).map(from_six),
            Arm::Serial(arm) => arm.jacobian(joints),
        }
    }

    /// Returns the branch of joint positions; always the first for a [`SerialArm`], which has none.
    #[must_use]
    pub fn branch(&self, joints: &Joints) -> Branch {
        match self {
            Arm::Srs(arm) => arm.branch(&seven(joints)),
            Arm::OrthoParallel(arm) => arm.branch(&six(joints)),
            Arm::Serial(_) => Branch::default(),
        }
    }

    /// Returns true if poses are reached in branches, false for a [`SerialArm`].
    #[must_use]
    pub const fn has_branches(&self) -> bool {
        !matches!(self, Arm::Serial(_))
    }

    /// Returns true if a pose leaves one degree of freedom, see [`Arm::arm_angle`].
    #[must_use]
    pub fn has_arm_angle(&self) -> bool {
        match self {
            Arm::Srs(_) => true,
            Arm::OrthoParallel(_) => false,
            Arm::Serial(arm) => arm.redundant_joint().is_some(),
        }
    }

    /// Returns the arm angle, rad: for an S-R-S arm in (−π, π], for a [`SerialArm`] of seven axes the position of its
    /// redundant joint; `None` for other arms, where a pose (and a branch) determine the joints.
    #[must_use]
    pub fn arm_angle(&self, joints: &Joints) -> Option<f64> {
        match self {
            Arm::Srs(arm) => Some(arm.arm_angle(&seven(joints))),
            Arm::OrthoParallel(_) => None,
            Arm::Serial(arm) => arm.arm_angle(joints),
        }
    }

    /// Returns branch and arm angle; together with the flange pose they determine the joints (of a [`SerialArm`]: those near
    /// a hint).
    #[must_use]
    pub fn configuration(&self, joints: &Joints) -> ArmConfiguration {
        ArmConfiguration {
            branch: self.branch(joints),
            arm_angle: self.arm_angle(joints).unwrap_or(0.0),
        }
    }

    /// Returns the joints that bring the flange to `pose` (base frame) with an arm angle (rad; ignored where
    /// [`Arm::arm_angle`] is `None`) in a branch (ignored for a [`SerialArm`], whose numeric inverse starts at `hint`), each by the whole turn nearest to `hint`. Where two axes are aligned, one of their joints is taken
    /// from `hint`; near a singularity, a `hint` that reaches the pose by itself in this branch and with this arm angle is
    /// the answer. Joint limits are not checked, see [`Arm::inverse_within`].
    ///
    /// # Errors
    /// Returns `Unreachable` if the wrist is too far from the shoulder or too close to it, the numeric inverse ends
    /// elsewhere, or an argument is null.
    #[inline]
    pub fn inverse(
        &self,
        pose: &Pose,
        arm_angle: f64,
        branch: Branch,
        hint: &Joints,
    ) -> Result<Joints, Unreachable> {
        let found = match self {
            Arm::Srs(arm) => from_seven(arm.inverse(pose, arm_angle, branch, &seven(hint))?),
            Arm::OrthoParallel(arm) => from_six(arm.inverse(pose, branch, &six(hint))?),
            Arm::Serial(arm) => arm.inverse(pose, arm_angle, hint)?,
        };
        // Linear axes have no turns.
        Ok(match self.is_linear() {
            true => found,
            false => nearest_turns(&found, hint),
        })
    }

    /// As [`Arm::inverse`], with each joint by the whole turn that is within its limits and nearest to `hint`.
    ///
    /// # Errors
    /// As [`Arm::inverse`], or the first joint that no whole turn brings within its limits.
    pub fn inverse_within(
        &self,
        pose: &Pose,
        configuration: ArmConfiguration,
        hint: &Joints,
        limits: &JointLimits,
    ) -> Result<Joints, InverseKinematicsError> {
        let ArmConfiguration { branch, arm_angle } = configuration;
        let found = self.inverse(pose, arm_angle, branch, hint)?;
        Ok(match self.is_linear() {
            true => within_limits(&found, limits).map(|()| found)?,
            false => turns_within(&found, hint, limits)?,
        })
    }

    /// Returns the joints of all branches, by [`Branch::index`], as computed by [`Arm::inverse`].
    pub fn all_branches(
        &self,
        pose: &Pose,
        arm_angle: f64,
        hint: &Joints,
    ) -> [Result<Joints, Unreachable>; BRANCHES] {
        core::array::from_fn(|index| {
            self.inverse(pose, arm_angle, Branch::from_bits(index as u8), hint)
        })
    }

    /// The nearest singularity.
    #[must_use]
    pub fn singularity(&self, joints: &Joints) -> Singularity {
        match self {
            Arm::Srs(arm) => arm.singularity(&seven(joints)),
            Arm::OrthoParallel(arm) => arm.singularity(&six(joints)),
            Arm::Serial(arm) => arm.singularity(joints),
        }
    }

    /// Returns KUKA's Status (S) of joint positions, bits 0 to 2; `None` for seven joints, whose Status KUKA defines
    /// differently, and for a [`SerialArm`]. See [`OrthoParallelArm::status`].
    #[must_use]
    pub fn status(&self, joints: &Joints) -> Option<u8> {
        match self {
            Arm::Srs(_) | Arm::Serial(_) => None,
            Arm::OrthoParallel(arm) => Some(arm.status(&six(joints))),
        }
    }

    /// Returns the branch of KUKA's Status (S); `None` for seven joints and for a [`SerialArm`]. Bits from 3 on are ignored.
    #[must_use]
    pub fn branch_of_status(&self, status: u8) -> Option<Branch> {
        match self {
            Arm::Srs(_) | Arm::Serial(_) => None,
            Arm::OrthoParallel(arm) => Some(arm.branch_of_status(status)),
        }
    }

    /// Returns KUKA's Turn (T) of joint positions: bit i is set if joint i + 1 is negative.
    #[must_use]
    pub fn turn(&self, joints: &Joints) -> u8 {
        let negative = joints.iter().take(self.joints()).map(|joint| *joint < 0.0);
        let bits = negative.zip(0..).map(|(bit, place)| u8::from(bit) << place);
        bits.fold(0, |all, bit| all | bit)
    }

    /// Returns the kind as a number and its parameters, for hashes and files: `(1, S-R-S)` shoulder height, upper arm,
    /// forearm, wrist to flange, seven signs; `(2, ortho-parallel)` shoulder height and offset, lateral offset, upper
    /// arm, elbow offset, forearm, wrist to flange, six signs, six zeros; `(3, serial)` the number of axes, the
    /// redundant joint, seven axes with point and direction each, and the flange as in [`Pose::to_slots`]; `(4, linear axes)`
    /// as for 3. Unused elements are 0.
    #[must_use]
    pub fn parameters(&self) -> (u32, [f64; PARAMETERS]) {
        let mut all = [0.0; PARAMETERS];
        let mut put = |lists: [&[f64]; 3]| {
            let values = lists.into_iter().flatten();
            for (place, value) in all.iter_mut().zip(values) {
                *place = *value;
            }
        };
        let kind = match self {
            Arm::Srs(arm) => {
                put([&arm.lengths(), &arm.signs, &[]]);
                1
            }
            Arm::OrthoParallel(arm) => {
                put([&arm.lengths(), &arm.signs, &arm.zeros]);
                2
            }
            Arm::Serial(arm) => {
                let head = [arm.joints(), arm.redundant_joint().unwrap_or(0)];
                let mut axes = [[[0.0; 3]; 2]; AXES_MAX];
                for (place, axis) in axes.iter_mut().zip(arm.axes()) {
                    *place = [axis.point, axis.direction];
                }
                let axes = axes.as_flattened().as_flattened();
                put([&head.map(|n| n as f64), axes, &arm.flange().to_slots()]);
                if arm.is_linear() { 4 } else { 3 }
            }
        };
        (kind, all)
    }

    /// Returns the number of [`Arm::parameters`] that a kind uses.
    #[must_use]
    pub const fn parameter_count(kind: u32) -> usize {
        match kind {
            3 | 4 => PARAMETERS,
            _ => CLOSED_FORM_PARAMETERS,
        }
    }

    /// Creates an arm from [`Arm::parameters`]; `None` for an unknown kind.
    #[must_use]
    pub fn from_parameters(kind: u32, parameters: &[f64; PARAMETERS]) -> Option<Arm> {
        match kind {
            1 => {
                let [
                    shoulder_height,
                    upper_arm,
                    forearm,
                    wrist_to_flange,
                    rest @ ..,
                ] = parameters;
                Some(Arm::Srs(SrsArm {
                    shoulder_height: *shoulder_height,
                    upper_arm: *upper_arm,
                    forearm: *forearm,
                    wrist_to_flange: *wrist_to_flange,
                    signs: *rest.first_chunk()?,
                }))
            }
            2 => {
                let (lengths, rest) = parameters.split_first_chunk::<7>()?;
                let (signs, rest) = rest.split_first_chunk::<6>()?;
                Some(Arm::OrthoParallel(OrthoParallelArm::from_lengths(
                    lengths,
                    *signs,
                    *rest.first_chunk()?,
                )))
            }
            3 | 4 => {
                let ([count, redundant], rest) = parameters.split_first_chunk::<2>()?;
                let (axes, flange) = rest.split_first_chunk::<{ 6 * AXES_MAX }>()?;
                let mut all = [JointAxis {
                    point: [0.0; 3],
                    direction: [0.0; 3],
                }; AXES_MAX];
                for (place, axis) in all.iter_mut().zip(axes.as_chunks::<6>().0) {
                    let [x, y, z, direction @ ..] = *axis;
                    *place = JointAxis {
                        point: [x, y, z],
                        direction,
                    };
                }
                let axes = all.get(..*count as usize)?;
                let flange = Pose::from_slots(*flange.first_chunk()?);
                let arm = match kind {
                    3 => SerialArm::new(axes, flange, *redundant as usize),
                    _ => SerialArm::of_linear_axes(axes, flange),
                };
                arm.map(Arm::Serial)
            }
            _ => None,
        }
    }
}

/// The reason why an arm cannot reach a pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum InverseKinematicsError {
    /// No joint position gives the pose.
    Unreachable(Unreachable),
    /// A joint position gives the pose, but violates the joint limits.
    OutOfLimits(OutOfLimits),
}

impl InverseKinematicsError {
    /// Returns the number for the port `reason` of primitives: 1 an input is null, 2 too far, 3 too close, 4 joint
    /// limit, 5 no solution of the numeric inverse; 0 is reserved for no fault.
    #[must_use]
    pub fn reason(&self) -> i64 {
        match self {
            InverseKinematicsError::Unreachable(Unreachable::NotFinite) => 1,
            InverseKinematicsError::Unreachable(Unreachable::TooFar { .. }) => 2,
            InverseKinematicsError::Unreachable(Unreachable::TooClose { .. }) => 3,
            InverseKinematicsError::OutOfLimits(_) => 4,
            InverseKinematicsError::Unreachable(Unreachable::NoSolution { .. }) => 5,
        }
    }

    /// Returns the joint at its limit, from 1; 0 for other faults.
    #[must_use]
    pub fn joint(&self) -> i64 {
        match self {
            InverseKinematicsError::Unreachable(_) => 0,
            InverseKinematicsError::OutOfLimits(out) => i64::from(out.joint) + 1,
        }
    }
}

impl From<Unreachable> for InverseKinematicsError {
    fn from(unreachable: Unreachable) -> Self {
        Self::Unreachable(unreachable)
    }
}

impl From<OutOfLimits> for InverseKinematicsError {
    fn from(out: OutOfLimits) -> Self {
        Self::OutOfLimits(out)
    }
}

impl fmt::Display for InverseKinematicsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unreachable(unreachable) => unreachable.fmt(f),
            Self::OutOfLimits(out) => out.fmt(f),
        }
    }
}

impl core::error::Error for InverseKinematicsError {}

fn seven(&[q1, q2, q3, q4, q5, q6, q7, _]: &Joints) -> [f64; 7] {
    [q1, q2, q3, q4, q5, q6, q7]
}

fn six(&[q1, q2, q3, q4, q5, q6, _, _]: &Joints) -> [f64; 6] {
    [q1, q2, q3, q4, q5, q6]
}

fn from_seven([q1, q2, q3, q4, q5, q6, q7]: [f64; 7]) -> Joints {
    [q1, q2, q3, q4, q5, q6, q7, 0.0]
}

fn from_six([q1, q2, q3, q4, q5, q6]: [f64; 6]) -> Joints {
    [q1, q2, q3, q4, q5, q6, 0.0, 0.0]
}
