//! Writes the robot file of an imported robot, with a comment for everything that the URDF does not give. Runs once per
//! import.

use std::fmt::Write;

use rcc_core::kinematics::{Arm, SerialArm};

use crate::Imported;

/// Time in which the chosen acceleration reaches full speed, s.
const ACCELERATION_TIME_S: f64 = 0.3;
/// Time in which the chosen jerk reaches full acceleration, s.
const JERK_TIME_S: f64 = 0.1;
/// Speed if the URDF gives none, rad/s.
const VELOCITY_DEFAULT_RAD_S: f64 = 1.0;

/// Writes a line; writing to a String cannot fail.
macro_rules! put {
    ($text:expr, $($more:tt)*) => { { let _ = writeln!($text, $($more)*); } };
}

/// Returns the text of a robot file, see docs/robots.md.
#[must_use]
pub fn yaml(imported: &Imported, source: &str) -> String {
    let Imported {
        name,
        chain,
        arm,
        not_closed,
        difference,
    } = imported;
    let mut text = String::new();
    put!(
        text,
        "# Made by `rcc-cli robot import {source}` from link `{}` to link `{}`.",
        chain.base,
        chain.tip
    );
    put!(
        text,
        "# Forward kinematics of both agree to {difference:.0e} m and rad at 1000 random joint positions."
    );
    if let Some(reason) = not_closed {
        put!(
            text,
            "# Its inverse kinematics is numeric, because no closed form fits: {reason}."
        );
    }
    put!(text, "robot: {}", quoted(name));
    put!(text, "\nkinematics:");
    match arm {
        Arm::Srs(arm) => {
            put!(text, "  type: srs");
            put!(
                text,
                "  shoulder_height: {} m",
                rounded(arm.shoulder_height)
            );
            put!(text, "  upper_arm: {} m", rounded(arm.upper_arm));
            put!(text, "  forearm: {} m", rounded(arm.forearm));
            put!(
                text,
                "  wrist_to_flange: {} m",
                rounded(arm.wrist_to_flange)
            );
            put!(text, "  signs: {:?}", arm.signs.map(|sign| sign as i32));
        }
        Arm::OrthoParallel(arm) => {
            put!(text, "  type: ortho-parallel");
            put!(
                text,
                "  shoulder_height: {} m",
                rounded(arm.shoulder_height)
            );
            put!(
                text,
                "  shoulder_offset: {} m",
                rounded(arm.shoulder_offset)
            );
            put!(text, "  lateral_offset: {} m", rounded(arm.lateral_offset));
            put!(text, "  upper_arm: {} m", rounded(arm.upper_arm));
            put!(text, "  elbow_offset: {} m", rounded(arm.elbow_offset));
            put!(text, "  forearm: {} m", rounded(arm.forearm));
            put!(
                text,
                "  wrist_to_flange: {} m",
                rounded(arm.wrist_to_flange)
            );
            put!(text, "  signs: {:?}", arm.signs.map(|sign| sign as i32));
            let zeros = arm
                .zeros
                .map(|zero| format!("deg({})", rounded(zero.to_degrees())));
            put!(text, "  zeros: [{}]", zeros.join(", "));
        }
        Arm::Serial(arm) => serial(&mut text, arm),
    }
    put!(
        text,
        "\n# The URDF gives no limits of acceleration and jerk: chosen for full speed after {ACCELERATION_TIME_S} s and full acceleration after {JERK_TIME_S} s."
    );
    put!(
        text,
        "# Compare every number with the data sheet before the arm moves."
    );
    put!(text, "joints:");
    for revolute in &chain.revolute_joints {
        let [lower, upper] = revolute
            .range
            .unwrap_or([-180_f64, 180.0].map(f64::to_radians));
        let velocity = revolute.velocity.unwrap_or(VELOCITY_DEFAULT_RAD_S);
        let degrees = |value: f64| rounded(value.to_degrees());
        let mut missing = Vec::new();
        if revolute.range.is_none() {
            missing.push("no limits in the URDF: assumed one turn");
        }
        if revolute.velocity.is_none() {
            missing.push("no speed in the URDF: assumed");
        }
        let comment = match missing.is_empty() {
            true => String::new(),
            false => format!("  # {}", missing.join("; ")),
        };
        put!(
            text,
            "  {}: {{position: [deg({}), deg({})], velocity: {} deg/s, acceleration: {} deg/s^2, jerk: {} deg/s^3}}{comment}",
            quoted(&revolute.name),
            degrees(lower),
            degrees(upper),
            degrees(velocity),
            degrees(velocity / ACCELERATION_TIME_S),
            degrees(velocity / ACCELERATION_TIME_S / JERK_TIME_S),
        );
    }
    text
}

/// Writes the kinematics of an arm by its axes.
fn serial(text: &mut String, arm: &SerialArm) {
    put!(text, "  type: serial");
    if let Some(joint) = arm.redundant_joint() {
        put!(
            text,
            "  # The joint that moves most while the flange stays: it keeps its position on lines and arcs."
        );
        put!(text, "  redundant_joint: {}", joint + 1);
    }
    put!(text, "  axes:  # with all joints at 0");
    let lengths = |values: [f64; 3]| values.map(|x| format!("{} m", rounded(x))).join(", ");
    for axis in arm.axes() {
        // Nearly all digits: a direction is multiplied by the length of the arm.
        let direction = axis.direction.map(|x| (x * 1e15).round() / 1e15 + 0.0);
        put!(
            text,
            "    - {{point: [{}], direction: {direction:?}}}",
            lengths(axis.point)
        );
    }
    let flange = arm.flange();
    let angles = rcc_core::rotation::to_rpy(flange.orientation);
    let angles = angles.map(|angle| format!("deg({})", rounded(angle.to_degrees())));
    put!(
        text,
        "  flange: {{xyz: [{}], rpy: [{}]}}",
        lengths(flange.position),
        angles.join(", ")
    );
}

/// Rounds to 12 decimals, to remove the rounding errors of angle conversions and sums.
fn rounded(value: f64) -> f64 {
    (value * 1e12).round() / 1e12 + 0.0
}

/// Quotes a name for YAML if necessary.
fn quoted(name: &str) -> String {
    let plain = name
        .chars()
        .all(|c| c.is_alphanumeric() || matches!(c, '_' | '-' | ' ' | '+'));
    if plain && name.starts_with(|c: char| c.is_alphabetic()) {
        name.to_owned()
    } else {
        format!("{name:?}")
    }
}
