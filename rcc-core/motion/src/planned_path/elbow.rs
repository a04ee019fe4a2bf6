//! The arm angle along a shape of the flange. Chosen when a motion is built; evaluated in the cycle.
//!
//! It changes by the polynomial of seventh degree whose first three derivatives are 0 at both ends, so velocity,
//! acceleration and jerk are continuous with the neighbouring shapes.

use std::f64::consts::{PI, TAU};

use rcc_core::kinematics::{Arm, ArmConfiguration, Branch};
use rcc_core::path::{self, MotionFault};
use rcc_core::pose::Pose;

use super::ArmStart;
use crate::geometry::LENGTH_MIN;

/// Branch and arm angle along a shape.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ElbowProfile {
    branch: Branch,
    /// Arm angle at the beginning, rad.
    angle: f64,
    /// Change of the arm angle, rad.
    turn: f64,
    /// Beginning and end of the change, s of the shape.
    span: [f64; 2],
}

impl ElbowProfile {
    /// A constant configuration.
    pub(super) fn constant(
        ArmConfiguration { branch, arm_angle }: ArmConfiguration,
    ) -> ElbowProfile {
        ElbowProfile {
            branch,
            angle: arm_angle,
            turn: 0.0,
            span: [0.0; 2],
        }
    }

    /// Changes the arm angle by `turn` (rad) on `span` of the shape.
    ///
    /// # Errors
    /// Returns [`MotionFault::NoRoomForElbow`] if the span has no length.
    pub(super) fn turning(self, turn: f64, span: [f64; 2]) -> Result<ElbowProfile, MotionFault> {
        let [from, to] = span;
        if turn != 0.0 && to - from <= LENGTH_MIN {
            return Err(MotionFault::NoRoomForElbow);
        }
        Ok(ElbowProfile { turn, span, ..self })
    }

    /// The configuration at the end, constant.
    pub(super) fn at_end(self) -> ElbowProfile {
        ElbowProfile {
            angle: self.angle + self.turn,
            turn: 0.0,
            ..self
        }
    }

    /// The configuration at `s` of the shape.
    pub(super) fn at(&self, s: f64) -> ArmConfiguration {
        let [from, to] = self.span;
        let arm_angle = match self.turn {
            0.0 => self.angle,
            turn => self.angle + turn * smooth((s - from) / (to - from)),
        };
        ArmConfiguration {
            branch: self.branch,
            arm_angle,
        }
    }
}

/// Smooth step from 0 to 1 as u goes from 0 to 1; NaN stays NaN.
fn smooth(u: f64) -> f64 {
    // Constant bounds: `clamp` cannot panic.
    let u = u.clamp(0.0, 1.0);
    let u2 = u * u;
    u2 * u2 * (35.0 + u * (-84.0 + u * (70.0 - 20.0 * u)))
}

/// Change of the arm angle (rad) from the configuration `here` to the wanted one at `end`.
pub(super) fn turn(
    arm_start: ArmStart<'_>,
    wanted: path::ElbowMotion,
    here: ArmConfiguration,
    end: &Pose,
) -> Result<f64, MotionFault> {
    let arm = match (wanted, arm_start.arm) {
        (path::ElbowMotion::Stays, _) => return Ok(0.0),
        (_, Arm::Srs(arm)) => arm,
        // The redundant joint is no rotation in a circle: it turns straight to its goal.
        (path::ElbowMotion::To(goal), Arm::Serial(arm)) if arm.redundant_joint().is_some() => {
            let finite = goal.is_finite().then_some(goal - here.arm_angle);
            return finite.ok_or(MotionFault::NotFinite);
        }
        (_, Arm::OrthoParallel(_) | Arm::Serial(_)) => return Err(MotionFault::NoArmAngle),
    };
    let angle = here.arm_angle;
    if let path::ElbowMotion::To(goal) = wanted {
        let finite = goal.is_finite().then_some(goal);
        return Ok(shorter_way_round(
            finite.ok_or(MotionFault::NotFinite)? - angle,
        ));
    }
    let found = arm.arm_angles(end, here.branch, &arm_start.model.limits);
    let angles = found.map_err(|_| MotionFault::Unreachable { fraction: 1.0 })?;
    if let Some([lower, upper]) = angles.around(angle) {
        return Ok((lower + upper) / 2.0 - angle);
    }
    // The arm angle cannot stay: use the nearest interval, the shorter way round.
    let ways = angles.intervals().iter().map(|[lower, upper]| {
        let [to_lower, to_upper] = [lower - angle, upper - angle].map(shorter_way_round);
        let middle = (upper - lower) / 2.0;
        if to_lower.abs() < to_upper.abs() {
            (to_lower.abs(), to_lower + middle)
        } else {
            (to_upper.abs(), to_upper - middle)
        }
    });
    let nearest = ways.min_by(|(a, _), (b, _)| a.total_cmp(b));
    // No interval exists: [`JointFollower::joints_along`](super::joint_follower::JointFollower::joints_along) then
    // reports which joint exceeds its limit, and where.
    Ok(nearest.map_or(0.0, |(_, way)| way))
}

/// The same rotation the shorter way round, in [-π, π].
fn shorter_way_round(turn: f64) -> f64 {
    let turn = turn.rem_euclid(TAU);
    if turn > PI { turn - TAU } else { turn }
}

#[cfg(test)]
mod tests {
    use rcc_core::path::{Leg, PathSegment};
    use rcc_testing::arms::{HOLD as START, lwr};
    use rcc_testing::{Random, Rng};

    use super::super::tests::{free, motion, run, start};
    use super::*;

    fn angle(joints: &rcc_core::message::Joints) -> f64 {
        lwr().arm.unwrap().configuration(joints).arm_angle
    }

    fn line(to: Pose, elbow: path::ElbowMotion) -> Leg<'static> {
        Leg {
            elbow,
            ..Leg::new(PathSegment::Line { to })
        }
    }

    #[test]
    fn a_line_ends_with_the_arm_angle_that_is_wanted_and_keeps_all_limits() {
        let to = start().compose(&Pose::from_xyz_rpy([0.05, -0.1, 0.02], [0.1, 0.0, 0.2]));
        for turn in [0.7, -0.6] {
            let goal = angle(&START) + turn;
            let done = run(
                motion(&[line(to, path::ElbowMotion::To(goal))]).unwrap(),
                free,
            );
            done.judge(1.0);
            assert!((angle(&done.last().joints) - goal).abs() < 1e-9);
            assert!(done.last().pose.distance_to(&to) < 1e-9);
        }
    }

    #[test]
    fn the_elbow_turns_while_the_flange_stays() {
        let goal = angle(&START) + 0.5;
        let done = run(
            motion(&[line(start(), path::ElbowMotion::To(goal))]).unwrap(),
            free,
        );
        done.judge(1.0);
        assert!((angle(&done.last().joints) - goal).abs() < 1e-9);
        for state in &done.states {
            assert!(state.pose.distance_to(&start()) < 1e-12);
        }
    }

    #[test]
    fn where_the_arm_angle_cannot_stay_the_middle_of_its_range_is_reachable() {
        let (mut refused, mut went_on) = (0, 0);
        let mut random = Rng::with_seed(11);
        for _ in 0..1000 {
            let mut around = |by: f64| random.uniform(-by, by);
            let way = [around(0.4), around(0.4), around(0.4)];
            let turn = [around(1.2), around(1.2), around(1.2)];
            let to = start().compose(&Pose::from_xyz_rpy(way, turn));
            let stays = motion(&[line(to, path::ElbowMotion::Stays)]);
            let Err((_, MotionFault::JointRange { .. })) = stays else {
                continue;
            };
            // Poses that the arm cannot reach with any arm angle are not counted.
            let Arm::Srs(arm) = lwr().arm.unwrap() else {
                panic!("seven joints")
            };
            let branch = Arm::Srs(arm).branch(&START);
            let there = arm.arm_angles(&to, branch, &lwr().limits);
            if there.is_ok_and(|angles| !angles.intervals().is_empty()) {
                refused += 1;
            } else {
                continue;
            }
            if let Ok(set) = motion(&[line(to, path::ElbowMotion::Middle)]) {
                run(set, free).judge(1.0);
                went_on += 1;
            }
        }
        assert!(
            2 * went_on > refused && went_on > 30,
            "{went_on} of {refused}"
        );
    }

    #[test]
    fn blends_that_leave_no_room_for_the_elbow_are_reported() {
        let corner = start().compose(&Pose::from_xyz_rpy([0.0, 0.1, 0.0], [0.0; 3]));
        let end = corner.compose(&Pose::from_xyz_rpy([0.1, 0.0, 0.0], [0.0; 3]));
        let goal = path::ElbowMotion::To(angle(&START) + 0.3);
        let rounded = |to, blend| Leg {
            blend,
            ..line(to, goal)
        };
        let last = end.compose(&Pose::from_xyz_rpy([0.0, 0.1, 0.0], [0.0; 3]));
        let legs = |blend| {
            [
                line(corner, path::ElbowMotion::Stays),
                rounded(end, blend),
                line(last, path::ElbowMotion::Stays),
            ]
            .map(|leg| Leg { blend, ..leg })
        };
        assert_eq!(
            motion(&legs(0.06)).err(),
            Some((1, MotionFault::NoRoomForElbow))
        );
        let done = run(motion(&legs(0.02)).unwrap(), free);
        done.judge(1.0);
        assert!((angle(&done.last().joints) - angle(&START) - 0.3).abs() < 1e-9);
    }

    #[test]
    fn the_elbow_turns_smoothly_and_is_where_it_is_wanted_at_the_end() {
        let here = ArmConfiguration {
            branch: Branch::from_bits(3),
            arm_angle: 0.4,
        };
        let elbow = ElbowProfile::constant(here)
            .turning(-1.2, [0.1, 0.5])
            .unwrap();
        for (s, want) in [
            (0.0, 0.4),
            (0.1, 0.4),
            (0.3, -0.2),
            (0.5, -0.8),
            (0.7, -0.8),
        ] {
            assert!((elbow.at(s).arm_angle - want).abs() < 1e-15, "{s}");
        }
        assert_eq!(elbow.at_end().at(0.3).arm_angle, elbow.at(0.5).arm_angle);
        // No step at the ends: the change grows with the fourth power of the distance.
        for u in [1e-3, 1e-2] {
            assert!(smooth(u) < 36.0 * u.powi(4) && 1.0 - smooth(1.0 - u) < 36.0 * u.powi(4));
        }
        assert_eq!(
            ElbowProfile::constant(here).turning(0.1, [0.3, 0.3]),
            Err(MotionFault::NoRoomForElbow)
        );
    }

    #[test]
    fn a_turn_goes_the_shorter_way_round() {
        for (turn, want) in [
            (0.5, 0.5),
            (-0.5, -0.5),
            (6.0, 6.0 - TAU),
            (-6.0, TAU - 6.0),
        ] {
            assert!((shorter_way_round(turn) - want).abs() < 1e-15, "{turn}");
        }
    }
}
