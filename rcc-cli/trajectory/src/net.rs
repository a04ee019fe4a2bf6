//! Writes the net: a pace that is 1 until CANCEL, the time along the trajectory, and a polynomial for each joint whose
//! coefficients are looked up by the section. Run by whoever imports.

use std::fmt::Write;

use crate::brake::Brake;
use crate::path::TrajectoryPath;

/// Largest jerk of the pace, as a multiple of the change of its rate, 1/s: its phases of jerk take 5 ms.
const PACE_JERK_PER_S: f64 = 200.0;

/// Name, arm, path and stop of a net.
#[derive(Clone, Copy, Debug)]
pub struct NetParts<'a> {
    /// Name of the net.
    pub name: &'a str,
    /// Its description.
    pub description: &'a str,
    /// The arm.
    pub device: &'a str,
    /// The curve; its joints are in the order of the arm.
    pub path: &'a TrajectoryPath,
    /// The stop after CANCEL.
    pub brake: Brake,
}

/// Returns the text of the net, YAML.
#[must_use]
pub fn text(parts: &NetParts<'_>) -> String {
    let NetParts {
        name,
        description,
        device,
        path,
        brake,
    } = *parts;
    let mut out = String::new();
    // Writing to a text cannot fail.
    let mut line = |text: &str| {
        let _ = writeln!(out, "{text}");
    };
    let quoted = description.replace('\\', "\\\\").replace('"', "\\\"");
    line(&format!(
        "net: {name}\ndescription: \"{quoted}\"\nprimitives:"
    ));
    line("  cancel: {type: Cancel}\n  first: {type: FirstCycle}");
    line("  # 1 until CANCEL, then down to 0 as fast as the arm can stop on its path");
    line(&format!(
        "  pace: {{type: ScalarGoal, parameters: {{velocity: {} 1/s, acceleration: {} 1/s^2, jerk: {} 1/s^3, initial: 1}}, \
         inputs: {{goal: \"= if cancel.requested then 0 else 1\"}}}}",
        real(brake.rate_per_s),
        real(brake.change_per_s2),
        real(brake.change_per_s2 * PACE_JERK_PER_S),
    ));
    line("  # Time along the trajectory, and the place in the list of its points");
    let end = real(path.duration_s());
    line(&format!(
        "  time: {{type: Integrator, parameters: {{high: {end} s}}, inputs: {{in: pace.position, reset: first.out}}}}"
    ));
    let times: Vec<String> = path
        .times_s
        .iter()
        .map(|time| format!("{} s", real(*time)))
        .collect();
    let numbers: Vec<String> = (0..path.times_s.len())
        .map(|number| format!("{number}.0"))
        .collect();
    line(&format!(
        "  place: {{type: Lookup, parameters: {{x: [{}], y: [{}]}}, inputs: {{in: time.out}}}}",
        times.join(", "),
        numbers.join(", ")
    ));
    line("  section: {type: Floor, inputs: {in: place.out}}");
    line("  u: {type: Formula, parameters: {expr: \"place.out - to_real(section.out)\"}}");
    let joints = path.end.len();
    for joint in 0..joints {
        line(&format!("  # Joint {}", joint + 1));
        joint_lines(path, joint, &mut line);
    }
    let positions: Vec<String> = (1..=joints).map(|joint| format!("j{joint}.out")).collect();
    line(&format!(
        "  arm: {{type: JointPositionCommand, parameters: {{device: {device}}}, inputs: {{position: [{}]}}}}",
        positions.join(", ")
    ));
    line(&format!(
        "  end: {{type: Termination, inputs: {{done: {{arrived: \"= time.out >= {end} s\", \
         stopped: \"= cancel.requested and pace.done\"}}}}}}"
    ));
    out
}

/// Writes the coefficients of a joint, the last of which hold its end, and their polynomial.
fn joint_lines(path: &TrajectoryPath, joint: usize, line: &mut impl FnMut(&str)) {
    let number = joint + 1;
    let end = path.end.get(joint).copied().unwrap_or(f64::NAN);
    for power in 0..6 {
        let sections = path
            .sections
            .iter()
            .filter_map(|joints| joints.get(joint)?.get(power).copied());
        let values = sections.chain([if power == 0 { end } else { 0.0 }]);
        let values: Vec<String> = values.map(|value| format!("{} rad", real(value))).collect();
        line(&format!(
            "  j{number}_c{power}: {{type: At, inputs: {{in: [{}], index: section.out}}}}",
            values.join(", ")
        ));
    }
    let c = |power: usize| format!("j{number}_c{power}.out");
    let polynomial = (0..5).rev().fold(c(5), |inner, power| {
        format!("{} + u.out * ({inner})", c(power))
    });
    line(&format!(
        "  j{number}: {{type: Formula, parameters: {{expr: \"{polynomial}\"}}}}"
    ));
}

/// Writes a number so that it reads back to the same bits, as a Real.
fn real(value: f64) -> String {
    format!("{value:?}")
}
