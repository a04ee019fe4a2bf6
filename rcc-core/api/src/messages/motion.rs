//! Messages about motions that cannot be built: why a leg is impossible, and the remedy. Pure.

use std::f64::consts::PI;

use rcc_core::counted::Counted;
use rcc_core::path::{AfterUntilFault, LEGS_MAX, MotionFault, Quantity};

use super::violation::angle;

/// Describes why a leg of a motion is impossible, and the remedy; `joint_name` names joints, counted from 1. The joints are linear
/// axes if `linear` is set.
pub(super) fn motion(
    fault: MotionFault,
    joint_name: impl Fn(u32) -> String,
    linear: bool,
) -> (String, String) {
    let joint_value = |value: f64, per: &str| match linear {
        true => format!("{value:.6} m{per}"),
        false => angle(value, per),
    };
    let position = |fraction: f64| format!("at {:.0} % of its path", fraction * 100.0);
    let joint = |joint: u8| joint_name(u32::from(joint) + 1);
    match fault {
        MotionFault::AmbiguousRotation => (
            "it turns by 180°, and both directions are equally short".to_owned(),
            "split it into two motions, or change the orientation slightly".to_owned(),
        ),
        MotionFault::Limits => (
            "its limits leave no margin for a curve of the path".to_owned(),
            "choose limits in usual proportions, for example 0.25 m/s, 1 m/s^2, 10 m/s^3"
                .to_owned(),
        ),
        MotionFault::NoMotion => (
            "the plan has no such motion".to_owned(),
            "this is a bug in the loader: report it with the net".to_owned(),
        ),
        MotionFault::NotFinite => (
            "a pose, a joint or an angle of it is null".to_owned(),
            "give `to` (as many joints as the arm has) or `pose`".to_owned(),
        ),
        MotionFault::Legs { count } => (
            format!("the path has {}", Counted(u64::from(count), "leg")),
            format!("give 1 to {LEGS_MAX} legs; each point of a spline counts as one"),
        ),
        MotionFault::JointCount { joints } => (
            format!("it gives more joint angles than the arm has joints ({joints})"),
            "give one angle per joint, A1 first".to_owned(),
        ),
        MotionFault::Collinear => (
            "start, via and end of the arc lie on a line".to_owned(),
            "move the via point aside, or use a line".to_owned(),
        ),
        MotionFault::NoAngle => (
            "the `angle` of the arc is 0".to_owned(),
            "leave it out to end at `to`; deg(360) is a whole circle".to_owned(),
        ),
        MotionFault::Coincident { distance_m } => (
            format!("two points of it are {distance_m:.1e} m apart"),
            "points of an arc or spline must differ by 1 µm or more".to_owned(),
        ),
        MotionFault::TurnsTooFar { angle_rad } => (
            format!("a point of the spline is turned by {angle_rad:.2} rad from the middle one"),
            "at most 4 rad are possible: split it into two splines".to_owned(),
        ),
        MotionFault::NoArmAngle => (
            "it turns the elbow, but this arm allows no other: `arm_angle` is for seven joints, `elbow: middle` for seven joints of type srs"
                .to_owned(),
            "remove `arm_angle` and `elbow`".to_owned(),
        ),
        MotionFault::NoBranch => (
            "it gives a `branch`, but the inverse kinematics of this arm is numeric and has no branches"
                .to_owned(),
            "remove `branch`: the joint positions reached soonest are selected; or give the joint positions"
                .to_owned(),
        ),
        MotionFault::NoRoomForElbow => (
            "the roundings at its ends leave no length in which the elbow could turn".to_owned(),
            "make `blend` smaller here or on the leg before, or turn the elbow on another leg"
                .to_owned(),
        ),
        MotionFault::NoStatus => (
            "it gives a `status`, which is defined only for KUKA's arms with six joints".to_owned(),
            "for seven joints give the `branch` instead (`ArmAngle` computes it from joint positions); for an arm with numeric inverse kinematics nothing"
                .to_owned(),
        ),
        MotionFault::NotAtRest => (
            "it has `wait` or `until`, or follows `until`, where a `blend` keeps the arm moving".to_owned(),
            "remove `blend` from the leg before `wait`, from the leg with `until`, and from the leg after it".to_owned(),
        ),
        MotionFault::AfterUntil { fraction, fault } => after_until(fraction, fault, joint),
        MotionFault::Unreachable { fraction } => (
            format!("the arm cannot reach it {}", position(fraction)),
            "move the points closer to the arm, or use a `ptp` in another branch".to_owned(),
        ),
        MotionFault::JointRange {
            fraction,
            joint: which,
            value,
            limit,
        } => (
            format!(
                "{} would be at {} {}, its limit is {}",
                joint(which),
                joint_value(value, ""),
                position(fraction),
                joint_value(limit, "")
            ),
            format!(
                "{}for a `ptp`, choose another goal, `branch` or `turn`; for another path, start in another branch (use a `ptp` to \
                 joints first) or, with seven joints, let the elbow turn (`elbow: middle`, or `arm_angle`)",
                // No joint can turn twice around: such values are usually degrees.
                if value.abs() > 4.0 * PI && !linear {
                    "bare angles are in rad, write `deg(30)` for degrees; "
                } else {
                    ""
                }
            ),
        ),
        MotionFault::Singular {
            fraction,
            joint: which,
        } => (
            format!(
                "it passes through a singularity {}: {} would jump",
                position(fraction),
                joint(which)
            ),
            "go around it, or use a `ptp`".to_owned(),
        ),
        MotionFault::TooFast {
            fraction,
            quantity,
            order,
            value,
            limit,
            possible,
        } => {
            let what = match quantity {
                Quantity::Line => "the flange".to_owned(),
                Quantity::Turn => "the rotation of the flange".to_owned(),
                Quantity::Joint(which) => joint(which),
            };
            let per = ["/s", "/s²", "/s³"][usize::from(order.clamp(1, 3)) - 1];
            let quantity_text = |value: f64| match quantity {
                Quantity::Line => format!("{value:.3} m{per}"),
                Quantity::Turn => angle(value, per),
                Quantity::Joint(_) => joint_value(value, per),
            };
            let rest = match value > limit {
                true => "",
                false => ", and the remaining margin is too small to decelerate",
            };
            (
                format!(
                    "at the given speed {what} would reach {} {}; its limit is {}{rest}",
                    quantity_text(value),
                    position(fraction),
                    quantity_text(limit)
                ),
                format!(
                    "at most {:.0} % of this speed is possible; without `velocity` the motion is as fast as the joints allow",
                    (possible * 100.0).floor()
                ),
            )
        }
    }
}

/// Describes why a leg cannot begin where `until` may end the leg before it.
fn after_until(
    fraction: f64,
    fault: AfterUntilFault,
    joint: impl Fn(u8) -> String,
) -> (String, String) {
    let from = format!(
        "`until` may end the leg before it at {:.0} % of its path, and from there",
        fraction * 100.0
    );
    let another = "use a `ptp`, or another goal";
    let (what, remedy) = match fault {
        AfterUntilFault::Shape => (
            "a leg after one with `until` begins anywhere on it, which an arc or a spline cannot".to_owned(),
            "use a `ptp` or a `lin`",
        ),
        AfterUntilFault::Relative => (
            "it is relative to its beginning, which is not known while `until` may end the leg before it".to_owned(),
            "give the goal in the arm's base",
        ),
        AfterUntilFault::Elbow => (
            "the elbow turns on it or on the leg before it, which `until` may end".to_owned(),
            "turn the elbow on another leg, or use a `ptp`",
        ),
        AfterUntilFault::Start => (
            "a `lin` after a leg with `until` needs a leg before it that is no `ptp` and begins at rest at a known place".to_owned(),
            "use a `ptp`",
        ),
        AfterUntilFault::Unreachable => (format!("{from} a pose on the line is out of reach"), another),
        AfterUntilFault::JointRange { joint: which } => {
            (format!("{from} {} would exceed its range", joint(which)), another)
        }
        AfterUntilFault::Singular { joint: which } => (
            format!("{from} the line passes through a singularity: {} would jump", joint(which)),
            another,
        ),
        AfterUntilFault::TooFast { possible } => (
            format!("{from} at most {:.0} % of its speed is possible", (possible * 100.0).floor()),
            "lower `velocity`, or leave it out: the leg is then as fast as the joints allow",
        ),
        AfterUntilFault::Other => (format!("{from} no line leads to its goal"), another),
    };
    (what, remedy.to_owned())
}
