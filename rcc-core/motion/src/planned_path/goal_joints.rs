//! The joints at the end of a leg in joint space that ends at a pose. Run when a command is made ready; allocates.

use rcc_core::guard::JointLimits;
use rcc_core::kinematics::{
    Arm, ArmConfiguration, Branch, InverseKinematicsError, turns_by_signs, turns_within,
    within_limits,
};
use rcc_core::message::{JOINTS_MAX, Joints};
use rcc_core::path::MotionFault;
use rcc_core::pose::Pose;

use super::ArmStart;
use super::joint_follower::no_joints;

/// Number of positions all over the range of the joints from which a numeric inverse starts. A solution that four of five
/// starts miss is then missed once in a thousand times.
const SEEDS: u32 = 32;

/// A configuration to solve, and the joints from which a numeric inverse starts.
type Candidate = (ArmConfiguration, Joints);

/// The joints for a pose: in the given branch, or those that are reached soonest. A `SerialArm` of seven axes keeps its
/// redundant joint if it can.
pub(super) fn goal_joints(
    arm_start: ArmStart<'_>,
    pose: &Pose,
    (branch, turn): (Option<u8>, Option<u8>),
    hint: &Joints,
) -> Result<Joints, MotionFault> {
    let (arm, limits) = (&arm_start.arm, &arm_start.model.limits);
    if arm.has_branches() {
        let arm_angle = arm.configuration(hint).arm_angle;
        let wanted = (0..8).filter(|index| branch.is_none_or(|wanted| wanted == *index));
        let candidates = wanted.map(|index| {
            let branch = Branch::from_bits(index);
            (ArmConfiguration { branch, arm_angle }, *hint)
        });
        return soonest(arm_start, pose, turn, hint, candidates);
    }
    let here = arm.configuration(hint);
    let seeds = || (1..=SEEDS).map(|number| seed(limits, number));
    // The hint is the last one: its fault is reported.
    let all = seeds().chain([*hint]).map(|seed| (here, seed));
    let kept = soonest(arm_start, pose, turn, hint, all);
    if kept.is_ok() || !arm.has_arm_angle() {
        return kept;
    }
    let all = seeds().map(|seed| (arm.configuration(&seed), seed));
    soonest(arm_start, pose, turn, hint, all).or(kept)
}

/// The joints of the candidate that are reached soonest from `hint`.
///
/// # Errors
/// Returns the fault of the last candidate if none has joints for the pose.
fn soonest(
    ArmStart { arm, model, .. }: ArmStart<'_>,
    pose: &Pose,
    turn: Option<u8>,
    hint: &Joints,
    candidates: impl Iterator<Item = Candidate>,
) -> Result<Joints, MotionFault> {
    let (mut best, mut fault) = (None, MotionFault::Unreachable { fraction: 1.0 });
    for candidate in candidates {
        match solve(&arm, pose, candidate, (turn, hint), &model.limits) {
            Ok(joints) => {
                let time = time_s(&joints, hint, &model.limits);
                if best.is_none_or(|(least, _)| time < least) {
                    best = Some((time, joints));
                }
            }
            Err(error) => fault = no_joints(error, 1.0),
        }
    }
    best.map(|(_, joints)| joints).ok_or(fault)
}

/// The joints for a pose, in the given turns or in those nearest to `hint`.
fn solve(
    arm: &Arm,
    pose: &Pose,
    (ArmConfiguration { branch, arm_angle }, seed): Candidate,
    (turn, hint): (Option<u8>, &Joints),
    limits: &JointLimits,
) -> Result<Joints, InverseKinematicsError> {
    let joints = arm.inverse(pose, arm_angle, branch, &seed)?;
    match turn {
        None => Ok(turns_within(&joints, hint, limits)?),
        Some(turn) => {
            let joints = turns_by_signs(&joints, turn);
            Ok(within_limits(&joints, limits).map(|()| joints)?)
        }
    }
}

/// The time that the slowest joint needs at least, s.
fn time_s(joints: &Joints, from: &Joints, limits: &JointLimits) -> f64 {
    let ways = joints.iter().zip(from).zip(&limits.velocity_max);
    let times = ways
        .take(limits.joints)
        .map(|((to, from), v)| (to - from).abs() / v);
    times.fold(0.0, f64::max)
}

/// Joint positions within the limits that, with growing number, fill the range of all joints evenly: the additive
/// recurrence with the square roots of primes.
fn seed(limits: &JointLimits, number: u32) -> Joints {
    const PRIMES: [f64; JOINTS_MAX] = [2.0, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0, 19.0];
    let mut joints = [0.0; JOINTS_MAX];
    let ranges = limits.lower.iter().zip(&limits.upper).zip(PRIMES);
    for (joint, ((lower, upper), prime)) in joints.iter_mut().zip(ranges).take(limits.joints) {
        let share = (0.5 + f64::from(number) * prime.sqrt()).fract();
        *joint = lower + (upper - lower) * share;
    }
    joints
}
