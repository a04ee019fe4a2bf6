//! Samples of one piece of a path: derivatives of flange and joints along it, and the check that no joint leaves its
//! range. Used when a motion is built; allocates.

use rcc_core::guard::JointLimits;
use rcc_core::kinematics::Arm;
use rcc_core::message::{JOINTS_MAX, Joints};
use rcc_core::path::MotionFault;
use rcc_core::pose::Pose;
use rcc_core::vector;

use super::finite_differences::{ROUNDING, derivatives};
use super::joint_follower::JointFollower;
use super::leg_shape::LegShape;
use super::speed_limits::{self, DerivativeSample, widen};
use super::{ArmStart, LegFault, STEPS};
use crate::geometry::LENGTH_MIN;
use crate::geometry::chain::{ChainPiece, Shape, ShapePoint};
use crate::geometry::jet::{Jet, JetScalar};

/// Most steps at which one piece is sampled.
const STEPS_MAX: usize = 4096;

/// If samples exceed the bounds of the coarser ones by less than this factor, sampling ends and the bounds are widened
/// by the factor found.
const NEAR: f64 = 1.05;

/// Number of steps at which a piece is sampled first.
fn steps(piece: &ChainPiece) -> usize {
    match &piece.shape {
        Shape::Spline(spline) => (spline.points().len() * STEPS / 4).clamp(STEPS, STEPS_MAX / 4),
        _ => STEPS,
    }
}

/// Path parameters at equidistant steps.
fn places(piece: &ChainPiece, steps: usize) -> impl Iterator<Item = f64> {
    let (begin, step) = (piece.begin, piece.length() / steps as f64);
    (0..=steps).map(move |number| begin + step * number as f64)
}

/// The samples of a piece.
pub(super) struct PieceSamples {
    /// Derivatives of flange and joints at equidistant steps, ends included.
    pub(super) points: Vec<DerivativeSample>,
    /// Joints with their derivatives at the same steps.
    pub(super) jets: Vec<[Jet; JOINTS_MAX]>,
    /// Joints alone, rad.
    pub(super) joints: Vec<Joints>,
    /// Distance of the flange along the piece, m.
    pub(super) length_m: f64,
    /// Bounds that also hold between the steps.
    pub(super) widened: Vec<DerivativeSample>,
    /// Factor by which values between the steps may exceed the samples, at least 1.
    pub(super) excess: f64,
}

/// Samples a piece; `joints` are close to those at its beginning.
///
/// Doubles the number of steps until the bounds from the previous samples cover the new ones: a curve may be sharp in a
/// short part.
///
/// # Errors
/// Returns the fault and its leg if the arm cannot follow the piece.
pub(super) fn sample_piece(
    arm_start: ArmStart<'_>,
    piece: &ChainPiece,
    leg_shape: &LegShape,
    joints: &Joints,
) -> Result<PieceSamples, LegFault> {
    let sample_at = |steps| match piece.at(piece.begin) {
        ShapePoint::Joints(_) => Ok(at_joints(arm_start.arm, piece, steps)),
        ShapePoint::Flange(_) => at_flange(arm_start, piece, (leg_shape, joints), steps),
    };
    let mut steps = steps(piece);
    let mut coarse = widen(&sample_at(steps)?.points);
    let sampled = loop {
        steps *= 2;
        let mut sampled = sample_at(steps)?;
        sampled.widened = widen(&sampled.points);
        let excess = excess(&coarse, &sampled.points, piece.length() / steps as f64);
        if excess <= NEAR || steps >= STEPS_MAX {
            // Values between these samples exceed them no more than these exceeded the previous bounds.
            for value in sampled.widened.iter_mut().flatten().flatten() {
                *value *= excess;
            }
            sampled.excess = excess;
            break sampled;
        }
        coarse = core::mem::take(&mut sampled.widened);
    };
    let limits = &arm_start.model.limits;
    out_of_range(&sampled, piece.length() / steps as f64, limits)
        .map_err(|fault| (leg_shape.leg, fault.at(|fraction| piece.of_shape(fraction))))?;
    Ok(sampled)
}

/// The greatest ratio of the samples at twice as many steps, `step` apart in s, to the bounds found before; at least 1.
fn excess(coarse: &[DerivativeSample], fine: &[DerivativeSample], step: f64) -> f64 {
    // A derivative below this is rounding.
    let rounding = [step, step * step, step * step * step].map(|power| ROUNDING / power);
    let mut excess = 1.0_f64;
    for (number, sample) in fine.iter().enumerate() {
        let Some(bound) = coarse.get(number / 2) else {
            continue;
        };
        let behind = coarse.get(number.div_ceil(2)).unwrap_or(bound);
        for ((values, here), behind) in sample.iter().zip(bound).zip(behind) {
            let bounds = here.iter().zip(behind).map(|(a, b)| a.max(*b));
            for ((value, bound), rounding) in values.iter().zip(bounds).zip(rounding) {
                if *value > bound + rounding {
                    excess = excess.max(value / bound.max(rounding));
                }
            }
        }
    }
    excess
}

/// Returns a fault if a joint exceeds its limit at a step, or turns back beyond it between two steps: a blend of joints
/// may swing out, and the inverse kinematics is evaluated at the steps only.
fn out_of_range(
    samples: &PieceSamples,
    step: f64,
    limits: &JointLimits,
) -> Result<(), MotionFault> {
    let last = samples.jets.len().saturating_sub(1).max(1);
    for (number, jets) in samples.jets.iter().enumerate() {
        let bounds = limits.lower.iter().zip(&limits.upper);
        let rows = jets.iter().zip(bounds).zip(0u8..).take(limits.joints);
        for ((jet, (lower, upper)), joint) in rows {
            let [slope, bend] = [1, 2].map(|order| jet.derivative(order));
            let way = -slope / bend;
            let inside = match number {
                0 => 0.0..=step,
                number if number == last => -step..=0.0,
                _ => -step..=step,
            };
            let value = match inside.contains(&way) {
                true => jet.value() + slope * way / 2.0,
                false => jet.value(),
            };
            let limit = if value < *lower { *lower } else { *upper };
            if value < *lower - LENGTH_MIN || value > *upper + LENGTH_MIN {
                return Err(MotionFault::JointRange {
                    fraction: number as f64 / last as f64,
                    joint,
                    value,
                    limit,
                });
            }
        }
    }
    Ok(())
}

/// Samples a line or blend in joint space.
fn at_joints(arm: Arm, piece: &ChainPiece, steps: usize) -> PieceSamples {
    let mut samples = PieceSamples {
        points: Vec::with_capacity(steps + 1),
        jets: Vec::with_capacity(steps + 1),
        joints: Vec::with_capacity(steps + 1),
        length_m: 0.0,
        widened: Vec::new(),
        excess: 1.0,
    };
    let mut last: Option<Pose> = None;
    for x in places(piece, steps) {
        let ShapePoint::Joints(jets) = piece.at(Jet::variable(x)) else {
            continue;
        };
        let joints = jets.map(JetScalar::value);
        let pose = arm.forward(&joints);
        samples.length_m += last.map_or(0.0, |last| last.distance_to(&pose));
        last = Some(pose);
        samples.joints.push(joints);
        samples.points.push(sample([[0.0; 3]; 2], &jets));
        samples.jets.push(jets);
    }
    samples
}

/// Samples a shape of the flange, starting with `joints`.
fn at_flange(
    arm_start: ArmStart<'_>,
    piece: &ChainPiece,
    (leg_shape, joints): (&LegShape, &Joints),
    steps: usize,
) -> Result<PieceSamples, LegFault> {
    let follower = JointFollower {
        arm: arm_start.arm,
        model: arm_start.model,
    };
    let elbow = leg_shape.elbow_on(piece);
    let elbow = elbow.ok_or((leg_shape.leg, MotionFault::NoMotion))?;
    let fault = |fault: MotionFault| (leg_shape.leg, fault.at(|fraction| piece.of_shape(fraction)));
    let span = (piece.begin, piece.end);
    let joints = follower
        .joints_along(
            |x| (piece.at(x), elbow.at(piece.on_shape(x))),
            span,
            joints,
            steps,
        )
        .map_err(fault)?;
    let step = piece.length() / steps as f64;
    let mut points: Vec<DerivativeSample> = Vec::with_capacity(steps + 1);
    let mut jets = Vec::new();
    if piece.length() > LENGTH_MIN {
        jets = derivatives(&joints, step);
        for (x, jets) in places(piece, steps).zip(&jets) {
            let ShapePoint::Flange(place) = piece.at(Jet::variable(x)) else {
                continue;
            };
            let rates = place.rates();
            let lengths = [rates.linear, rates.angular].map(|rates| rates.map(vector::norm));
            points.push(sample(lengths, jets));
        }
    }
    let mut speeds = points.iter().map(|[[speed, ..], ..]| speed);
    let sum: f64 = speeds.clone().sum();
    let ends: f64 = speeds.clone().take(1).chain(speeds.next_back()).sum();
    let length_m = (sum - ends / 2.0) * step;
    // Exact where the speed is constant.
    let constant = piece.shape.constant_speed();
    let length_m = constant.map_or(length_m, |speed| speed * piece.length());
    Ok(PieceSamples {
        points,
        jets,
        joints,
        length_m,
        widened: Vec::new(),
        excess: 1.0,
    })
}

fn sample([line, turn]: [[f64; 3]; 2], jets: &[Jet; JOINTS_MAX]) -> DerivativeSample {
    let mut sample = [[0.0; 3]; speed_limits::QUANTITIES];
    (sample[0], sample[1]) = (line, turn);
    for (place, jet) in sample.iter_mut().skip(2).zip(jets) {
        *place = [1, 2, 3].map(|order| jet.derivative(order).abs());
    }
    sample
}
