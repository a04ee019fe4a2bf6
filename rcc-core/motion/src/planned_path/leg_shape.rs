//! Turns legs into shapes, one after the other: each with the configuration of the arm along it and the state at its
//! end. Run when a command is made ready; allocates.

use rcc_core::guard::JointLimits;
use rcc_core::kinematics::{Arm, ArmConfiguration, Branch};
use rcc_core::message::{JOINTS_MAX, Joints};
use rcc_core::path::{ArcOrientation, Leg, MotionFault, MotionLimits, PathSegment, RelativeTo};
use rcc_core::pose::Pose;
use rcc_core::rotation;
use rcc_core::vector;

use super::elbow::{self, ElbowProfile};
use super::goal_joints::goal_joints;
use super::joint_follower::JointFollower;
use super::speed_limits::QuantityLimits;
use super::{ArmStart, LegFault, ReducedBlend, STEPS, joint_bounds};
use crate::geometry::chain::{ChainPiece, Shape, ShapePoint};
use crate::geometry::circle::{Circle, CircleOrientation};
use crate::geometry::jet::Jet;
use crate::geometry::line::{JointLine, Line};
use crate::geometry::spline::Spline;
use crate::geometry::{GeometryError, LENGTH_MIN, PathMetric};

/// Metres that one radian of rotation counts where the limits do not define the ratio.
const RADIUS_M: f64 = 0.25;

/// A blend that is smaller by at most this fraction counts as having the requested size.
const ENOUGH: f64 = 1e-6;

/// A speed of the flange along s that differs from 1 by at most this is 1.
const ROUNDING: f64 = 1e-9;

/// A leg as a shape.
#[derive(Debug, Clone)]
pub(super) struct LegShape {
    pub(super) shape: Shape,
    pub(super) leg: u32,
    /// Branch and arm angle along a shape of the flange; `None` for a leg in joint space.
    elbow: Option<ElbowProfile>,
    /// Joints along it at equidistant steps, rad.
    joints: Vec<Joints>,
    pub(super) bounds: QuantityLimits,
    /// The velocity of the leg is to be kept (not only a limit).
    pub(super) given: bool,
    /// Zone of the blend at its end, m.
    zone_m: f64,
}

impl LegShape {
    /// The zones of the blend from this leg to the next: on each of the two.
    pub(super) fn zones(&self, next: Option<&LegShape>, arm: Arm) -> [BlendZone; 2] {
        let Some(next) = next.filter(|_| self.zone_m > 0.0) else {
            return [BlendZone::default(); 2];
        };
        [
            zone(&self.shape, self.zone_m, arm, |way, length| length - way),
            zone(&next.shape, self.zone_m, arm, |way, _| way),
        ]
    }

    /// Branch and arm angle on a piece: the elbow has finished turning before a blend begins.
    pub(super) fn elbow_on(&self, piece: &ChainPiece) -> Option<ElbowProfile> {
        match piece.blend {
            true => self.elbow.map(ElbowProfile::at_end),
            false => self.elbow,
        }
    }

    /// The blend at its end if it is smaller than requested; `made_m` (m) is the zone that the chain made.
    pub(super) fn shortened(&self, made_m: f64) -> Option<ReducedBlend> {
        (made_m < self.zone_m * (1.0 - ENOUGH)).then_some(ReducedBlend {
            leg: self.leg,
            asked_m: self.zone_m,
            made_m,
        })
    }

    /// Joints with derivatives at `s`.
    pub(super) fn jets(
        &self,
        arm_start: ArmStart<'_>,
        shape: &Shape,
        s: f64,
    ) -> Result<[Jet; JOINTS_MAX], MotionFault> {
        if let ShapePoint::Joints(joints) = shape.at(Jet::variable(s)) {
            return Ok(joints);
        }
        let follower = JointFollower {
            arm: arm_start.arm,
            model: arm_start.model,
        };
        let elbow = self.elbow.as_ref().ok_or(MotionFault::NoMotion)?;
        let last = self.joints.len().saturating_sub(1);
        let near = (s / shape.length() * last as f64) as usize;
        let hint = self.joints.get(near.min(last));
        follower.jets((shape, elbow), s, hint.unwrap_or(&arm_start.joints))
    }
}

/// The part of a shape that a blend replaces.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct BlendZone {
    /// Length in s of the shape.
    pub(super) way: f64,
    /// Distance of the flange from the corner (along the shape if it is one of the flange), m.
    pub(super) metres: f64,
}

/// The zone from a corner to where the flange is `zone_m` (m) away from it; at most half of the shape. `place` maps a
/// distance from the corner, and the length, to s of the shape.
fn zone(shape: &Shape, zone_m: f64, arm: Arm, place: impl Fn(f64, f64) -> f64) -> BlendZone {
    let length = shape.length();
    let Shape::Joints(line) = shape else {
        return zone_of_flange(shape, zone_m);
    };
    let flange = |way: f64| arm.forward(&line.at(place(way, length)));
    let corner = flange(0.0);
    let inside = |way: f64| corner.distance_to(&flange(way)) < zone_m;
    let (mut from, mut to) = (0.0, length / 2.0);
    for step in 1..=64 {
        let way = length / 2.0 * f64::from(step) / 64.0;
        if !inside(way) {
            to = way;
            break;
        }
        from = way;
    }
    for _ in 0..48 {
        let middle = 0.5 * (from + to);
        if inside(middle) {
            from = middle;
        } else {
            to = middle;
        }
    }
    BlendZone {
        way: to,
        metres: corner.distance_to(&flange(to)),
    }
}

/// The zone of a shape of the flange. Where rotation or arm angle define s, one unit of s is less than a metre of the
/// flange. A turn on the spot has no metres: its zone is `zone_m` of s, and counts as 0 m.
fn zone_of_flange(shape: &Shape, zone_m: f64) -> BlendZone {
    let half = shape.length() / 2.0;
    match shape.constant_speed() {
        // Rounding of an s that is arc length must not change a path.
        Some(speed) if (speed - 1.0).abs() > ROUNDING && speed > LENGTH_MIN => {
            let way = (zone_m / speed).min(half);
            BlendZone {
                way,
                metres: way * speed,
            }
        }
        Some(speed) if speed <= LENGTH_MIN => BlendZone {
            way: zone_m.min(half),
            metres: 0.0,
        },
        // A spline by chords: s is about a metre where it does not turn on the spot.
        _ => {
            let way = zone_m.min(half);
            BlendZone { way, metres: way }
        }
    }
}

/// Turns all legs into shapes.
///
/// # Errors
/// Returns the fault and its leg if legs do not define a path, or the arm cannot follow them.
pub(super) fn leg_shapes(
    arm_start: ArmStart<'_>,
    legs: &[Leg<'_>],
) -> Result<Vec<LegShape>, LegFault> {
    let mut builder = LegShapeBuilder {
        arm_start,
        pose: arm_start.pose,
        joints: arm_start.joints,
        configuration: None,
        leg_shapes: Vec::new(),
    };
    for (leg, number) in legs.iter().zip(0..) {
        builder.leg(leg, number).map_err(|fault| (number, fault))?;
    }
    builder.equalize_accelerations();
    Ok(builder.leg_shapes)
}

struct LegShapeBuilder<'a> {
    arm_start: ArmStart<'a>,
    pose: Pose,
    joints: Joints,
    /// Configuration along the flange's shapes since the last leg in joint space.
    configuration: Option<ArmConfiguration>,
    leg_shapes: Vec<LegShape>,
}

impl LegShapeBuilder<'_> {
    fn leg(&mut self, leg: &Leg<'_>, number: u32) -> Result<(), MotionFault> {
        let arm = self.arm_start.arm;
        let metric = metric(leg);
        let to = |pose: &Pose| place(&self.pose, pose, leg.relative);
        let (shape, steps) = match leg.segment {
            PathSegment::Joints { to } => return self.joints(leg, number, to),
            PathSegment::JointsToPose {
                to: goal,
                branch,
                status,
                turn,
            } => {
                let of_status = |status| {
                    let branch = arm.branch_of_status(status);
                    branch.map(Branch::index).ok_or(MotionFault::NoStatus)
                };
                let branch = status.map(of_status).transpose()?.or(branch);
                if branch.is_some() && !arm.has_branches() {
                    return Err(MotionFault::NoBranch);
                }
                let (goal, hint) = (to(&goal), self.joints);
                let mut joints = goal_joints(self.arm_start, &goal, (branch, turn), &hint)?;
                joints
                    .iter_mut()
                    .skip(arm.joints())
                    .for_each(|joint| *joint = f64::NAN);
                return self.joints(leg, number, joints);
            }
            PathSegment::Line { to: goal } => {
                let line = Line::new(&self.pose, &to(&goal), metric).map_err(geometry)?;
                (Shape::Line(line), STEPS)
            }
            PathSegment::Circle {
                via,
                to: goal,
                orientation,
                angle,
            } => {
                let via = Pose {
                    position: via,
                    ..Pose::IDENTITY
                };
                let orientation = match orientation {
                    ArcOrientation::Even => CircleOrientation::Even,
                    ArcOrientation::Constant => CircleOrientation::Constant,
                    ArcOrientation::Path => CircleOrientation::Path,
                };
                let (via, goal) = (to(&via).position, to(&goal));
                let circle = Circle::new(&self.pose, via, &goal, (orientation, angle), metric);
                (Shape::Circle(circle.map_err(geometry)?), STEPS)
            }
            PathSegment::Spline { through } => {
                let mut poses = vec![self.pose];
                poses.extend(through.iter().map(to));
                let steps = (through.len() * STEPS / 4).max(STEPS);
                let spline = Spline::new(&poses, metric).map_err(geometry)?;
                (Shape::Spline(spline), steps)
            }
        };
        let configuration = self.configuration;
        let configuration = configuration.unwrap_or_else(|| arm.configuration(&self.joints));
        let follower = JointFollower {
            arm,
            model: self.arm_start.model,
        };
        let (shape, elbow) = self.turning(shape, leg, metric, configuration)?;
        let span = (0.0, shape.length());
        let at = |s| (shape.at(s), elbow.at(s));
        let joints = follower.joints_along(at, span, &self.joints, steps)?;
        if let ShapePoint::Flange(end) = shape.at(shape.length()) {
            self.pose = end.pose();
        }
        self.joints = joints.last().copied().unwrap_or(self.joints);
        self.configuration = Some(elbow.at(shape.length()));
        self.push((leg, number), shape, joints, Some(elbow));
        Ok(())
    }

    /// The arm angle along a shape, turning between the blends at its ends; a line is lengthened in s to the length
    /// that the turn counts.
    fn turning(
        &self,
        mut shape: Shape,
        leg: &Leg<'_>,
        metric: PathMetric,
        configuration: ArmConfiguration,
    ) -> Result<(Shape, ElbowProfile), MotionFault> {
        let constant = ElbowProfile::constant(configuration);
        let ShapePoint::Flange(end) = shape.at(shape.length()) else {
            return Ok((shape, constant));
        };
        let turn = elbow::turn(self.arm_start, leg.elbow, configuration, &end.pose())?;
        if let (Shape::Line(line), true) = (&mut shape, turn != 0.0) {
            line.extend_to(metric.radius_m * turn.abs());
        }
        let length = shape.length();
        let before = self
            .leg_shapes
            .last()
            .map_or(0.0, |leg_shape| leg_shape.zone_m);
        let [before, behind] = [before, leg.blend].map(|zone| zone_of_flange(&shape, zone).way);
        Ok((shape, constant.turning(turn, [before, length - behind])?))
    }

    fn joints(&mut self, leg: &Leg<'_>, number: u32, to: Joints) -> Result<(), MotionFault> {
        // Joints that the arm does not have do not move.
        let count = self.arm_start.arm.joints();
        if to.iter().skip(count).any(|joint| !joint.is_nan()) {
            let joints = count as u8;
            return Err(MotionFault::JointCount { joints });
        }
        let mut goal = self.joints;
        for (place, joint) in goal.iter_mut().zip(to).take(count) {
            *place = joint;
        }
        in_range(&goal, &self.arm_start.model.limits)?;
        let line = JointLine::new(&self.joints, &goal, 1.0).map_err(geometry)?;
        let joints = vec![self.joints, goal];
        (self.joints, self.pose) = (goal, self.arm_start.arm.forward(&goal));
        self.configuration = None;
        self.push((leg, number), Shape::Joints(line), joints, None);
        Ok(())
    }

    fn push(
        &mut self,
        (leg, number): (&Leg<'_>, u32),
        shape: Shape,
        joints: Vec<Joints>,
        elbow: Option<ElbowProfile>,
    ) {
        let row = |limits: MotionLimits| [limits.velocity, limits.acceleration, limits.jerk];
        let mut bounds = [[f64::INFINITY; 3]; super::speed_limits::QUANTITIES];
        if elbow.is_some() {
            (bounds[0], bounds[1]) = (row(leg.line), row(leg.turn));
        }
        let joint = joint_bounds(&self.arm_start.model.limits, leg.scale);
        for (place, joint) in bounds.iter_mut().skip(2).zip(joint) {
            *place = joint;
        }
        self.leg_shapes.push(LegShape {
            given: elbow.is_some()
                && shape.moves()
                && leg.line.velocity.is_finite()
                // A turn on the spot has the angular velocity given for turns.
                && (leg.turn.velocity.is_finite()
                    || shape.constant_speed().is_none_or(|speed| speed > LENGTH_MIN)),
            shape,
            leg: number,
            elbow,
            joints,
            bounds,
            zone_m: leg.blend,
        });
    }

    /// Scales s on lines in joint space such that they allow about the same acceleration of s as the flange's shapes:
    /// the clock has one acceleration limit for the whole path.
    fn equalize_accelerations(&mut self) {
        let max_acceleration = |leg_shape: &LegShape| {
            if leg_shape.shape.length() <= LENGTH_MIN {
                return f64::INFINITY;
            }
            let last = leg_shape.joints.len().saturating_sub(1).max(1);
            let step = leg_shape.shape.length() / last as f64;
            let mut max_acceleration = f64::INFINITY;
            for pair in leg_shape.joints.windows(2) {
                for ((a, b), [_, limit, _]) in
                    pair[0].iter().zip(pair[1]).zip(&leg_shape.bounds[2..])
                {
                    let by = limit * step / (b - a).abs();
                    max_acceleration = if by < max_acceleration {
                        by
                    } else {
                        max_acceleration
                    };
                }
            }
            max_acceleration
        };
        let flange = |leg_shape: &&LegShape| leg_shape.elbow.is_some();
        let of_flange = self.leg_shapes.iter().filter(flange).map(max_acceleration);
        let least = of_flange.fold(f64::INFINITY, f64::min);
        let first = self
            .leg_shapes
            .iter()
            .map(max_acceleration)
            .find(|x| x.is_finite());
        let wanted = if least.is_finite() {
            Some(least)
        } else {
            first
        };
        for leg_shape in &mut self.leg_shapes {
            let by = wanted.map_or(1.0, |wanted| wanted / max_acceleration(leg_shape));
            if let (Shape::Joints(_), [from, to]) = (&leg_shape.shape, leg_shape.joints.as_slice())
                && by.is_finite()
                && by > 0.0
                && let Ok(line) = JointLine::new(from, to, by)
            {
                leg_shape.shape = Shape::Joints(line);
            }
        }
    }
}

/// A pose of a leg in the base frame of the arm.
fn place(from: &Pose, pose: &Pose, relative: Option<RelativeTo>) -> Pose {
    match relative {
        None => *pose,
        Some(RelativeTo::Tool) => from.compose(pose),
        Some(RelativeTo::Base) => Pose {
            position: vector::add(from.position, pose.position),
            orientation: rotation::product(pose.orientation, from.orientation),
        },
    }
}

/// How rotation counts in the length of a leg.
pub(crate) fn metric(leg: &Leg<'_>) -> PathMetric {
    let radius = leg.line.velocity / leg.turn.velocity;
    PathMetric {
        radius_m: if radius.is_finite() && radius > 0.0 {
            radius
        } else {
            RADIUS_M
        },
    }
}

fn in_range(joints: &Joints, limits: &JointLimits) -> Result<(), MotionFault> {
    let bounds = limits.lower.iter().zip(&limits.upper);
    for ((value, (lower, upper)), joint) in joints.iter().zip(bounds).zip(0u8..).take(limits.joints)
    {
        let limit = if value < lower {
            *lower
        } else if value > upper {
            *upper
        } else {
            continue;
        };
        return Err(MotionFault::JointRange {
            fraction: 1.0,
            joint,
            value: *value,
            limit,
        });
    }
    Ok(())
}

fn geometry(error: GeometryError) -> MotionFault {
    match error {
        GeometryError::HalfTurn => MotionFault::AmbiguousRotation,
        GeometryError::Collinear => MotionFault::Collinear,
        GeometryError::NoAngle => MotionFault::NoAngle,
        GeometryError::Coincident { distance_m, .. } => MotionFault::Coincident { distance_m },
        GeometryError::TurnsTooFar { angle_rad, .. } => MotionFault::TurnsTooFar { angle_rad },
        GeometryError::NotFinite => MotionFault::NotFinite,
    }
}
