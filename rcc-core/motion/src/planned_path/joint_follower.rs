//! The joints along a shape of the flange: solved step by step, so that they stay in their branch and turn. Used when a
//! motion is built.

use rcc_core::frame::DeviceModel;
use rcc_core::kinematics::{Arm, ArmConfiguration, InverseKinematicsError};
use rcc_core::message::{JOINTS_MAX, Joints};
use rcc_core::path::MotionFault;

use super::elbow::ElbowProfile;
use super::finite_differences::{NEIGHBOURS, derivatives};
use crate::geometry::chain::{Shape, ShapePoint};
use crate::geometry::jet::Jet;

/// A joint that moves further than this from one step to the next (rad) jumps: the path passes a singular position.
const JUMP: f64 = 0.5;

/// Initial step for finite differences at one position, as a fraction of the shape's length.
const NEAR: f64 = 1.0 / 256.0;
/// How often that step may be divided by four.
const CLOSER_MAX: usize = 6;
/// Relative difference below which derivatives count as converged.
const SAME: f64 = 1e-7;

/// An arm that follows a shape.
#[derive(Clone, Copy)]
pub(super) struct JointFollower<'a> {
    pub(super) arm: Arm,
    pub(super) model: &'a DeviceModel,
}

impl JointFollower<'_> {
    /// Returns the joints (rad) at equidistant steps along [from, to] of a shape of the flange with a configuration,
    /// the first close to `start`.
    ///
    /// # Errors
    /// Returns [`MotionFault`] if the arm cannot reach a pose, a joint exceeds its limit, or a joint jumps.
    pub(super) fn joints_along(
        &self,
        at: impl Fn(f64) -> (ShapePoint<f64>, ArmConfiguration),
        (from, to): (f64, f64),
        start: &Joints,
        steps: usize,
    ) -> Result<Vec<Joints>, MotionFault> {
        let (mut joints, mut last) = (Vec::with_capacity(steps + 1), *start);
        for step in 0..=steps {
            #[allow(clippy::cast_precision_loss)] // Some thousands at most.
            let fraction = step as f64 / steps as f64;
            let (ShapePoint::Flange(place), configuration) = at(from + (to - from) * fraction)
            else {
                return Ok(joints);
            };
            let found = self
                .arm
                .inverse_within(&place.pose(), configuration, &last, &self.model.limits)
                .map_err(|error| no_joints(error, fraction))?;
            let mut ways = found.iter().zip(last).zip(0u8..);
            let jump = ways.find(|((now, before), _)| (*now - before).abs() > JUMP);
            if let Some((_, joint)) = jump {
                return Err(MotionFault::Singular { fraction, joint });
            }
            last = found;
            joints.push(found);
        }
        Ok(joints)
    }

    /// Returns the joints at `s` of a shape with their derivatives; `hint` are joints close to them. The step of the
    /// differences is reduced until the result converges: near a singular position joints turn fast.
    ///
    /// # Errors
    /// As [`JointFollower::joints_along`].
    pub(super) fn jets(
        &self,
        (shape, elbow): (&Shape, &ElbowProfile),
        s: f64,
        hint: &Joints,
    ) -> Result<[Jet; JOINTS_MAX], MotionFault> {
        let mut step = shape.length() * NEAR;
        let mut jets = self.jets_by((shape, elbow), s, hint, step)?;
        let mut last = f64::INFINITY;
        for _ in 0..CLOSER_MAX {
            step /= 4.0;
            let closer = self.jets_by((shape, elbow), s, hint, step)?;
            let apart = apart(&jets, &closer);
            // A growing difference is rounding.
            if apart >= last {
                break;
            }
            (jets, last) = (closer, apart);
            if apart < SAME {
                break;
            }
        }
        Ok(jets)
    }

    /// As [`JointFollower::jets`], with this step in s.
    fn jets_by(
        &self,
        (shape, elbow): (&Shape, &ElbowProfile),
        s: f64,
        hint: &Joints,
        step: f64,
    ) -> Result<[Jet; JOINTS_MAX], MotionFault> {
        let (length, steps) = (shape.length(), NEIGHBOURS - 1);
        // `s` is one of the seven sample positions: the fourth, unless the shape begins or ends before.
        let room = |way: f64| ((way / step + 1e-9) as usize).min(steps);
        let before = room(s).min(steps / 2).max(steps - room(length - s));
        let begin = s - step * before as f64;
        let end = begin + step * steps as f64;
        let near = self.joints_along(|s| (shape.at(s), elbow.at(s)), (begin, end), hint, steps)?;
        let jets = derivatives(&near, step);
        jets.get(before).copied().ok_or(MotionFault::NotFinite)
    }
}

/// Difference of the first and second derivatives, relative to the greatest of each.
fn apart(one: &[Jet; JOINTS_MAX], other: &[Jet; JOINTS_MAX]) -> f64 {
    let part = |order: usize| {
        let pairs = one.iter().zip(other);
        let pairs = pairs.map(|(a, b)| (a.derivative(order), b.derivative(order)));
        let (most, apart) = pairs.fold((f64::MIN_POSITIVE, 0.0_f64), |(most, apart), (a, b)| {
            (most.max(a.abs()), apart.max((a - b).abs()))
        });
        apart / most
    };
    part(1).max(part(2))
}

pub(super) fn no_joints(error: InverseKinematicsError, fraction: f64) -> MotionFault {
    match error {
        InverseKinematicsError::Unreachable(_) => MotionFault::Unreachable { fraction },
        InverseKinematicsError::OutOfLimits(out) => MotionFault::JointRange {
            fraction,
            joint: out.joint,
            value: out.value,
            limit: out.limit,
        },
    }
}
