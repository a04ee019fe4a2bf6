//! The messages of the ROS types that viewers know. Each function writes one message into `out`; times are nanoseconds
//! since 1970, UTC. Pure.

use rcc_core::pose::Pose;

use crate::cdr::CdrWriter;

const NS_PER_S: u64 = 1_000_000_000;

fn stamp(out: &mut CdrWriter, ns: u64) {
    // ROS has 31 bits of seconds: until 2038.
    out.i32(i32::try_from(ns / NS_PER_S).unwrap_or(i32::MAX));
    out.u32((ns % NS_PER_S) as u32);
}

fn header(out: &mut CdrWriter, ns: u64, frame: &str) {
    stamp(out, ns);
    out.string(frame);
}

fn pose_fields(out: &mut CdrWriter, pose: &Pose) {
    out.f64s(&pose.to_slots());
}

/// `sensor_msgs/JointState`: position (rad) and effort (N·m) of each named joint, without velocities.
pub fn joint_state(
    out: &mut CdrWriter,
    ns: u64,
    names: &[String],
    [position, effort]: [&[f64]; 2],
) {
    out.clear();
    header(out, ns, "");
    out.length(names.len());
    for name in names {
        out.string(name);
    }
    for values in [position, &[], effort] {
        // Another length than that of `name` is an error for viewers; an empty one is not.
        let values = values.get(..names.len()).unwrap_or_default();
        out.length(values.len());
        out.f64s(values);
    }
}

/// `tf2_msgs/TFMessage`: parent, name and pose of each frame.
pub fn transforms(out: &mut CdrWriter, ns: u64, frames: &[(String, String, Pose)]) {
    out.clear();
    out.length(frames.len());
    for (parent, child, pose) in frames {
        header(out, ns, parent);
        out.string(child);
        pose_fields(out, pose);
    }
}

/// `geometry_msgs/PoseStamped`.
pub fn pose_stamped(out: &mut CdrWriter, ns: u64, frame: &str, pose: &Pose) {
    out.clear();
    header(out, ns, frame);
    pose_fields(out, pose);
}

/// `geometry_msgs/WrenchStamped`: `[fx fy fz tx ty tz]`, N and N·m.
pub fn wrench_stamped(out: &mut CdrWriter, ns: u64, frame: &str, wrench: &[f64; 6]) {
    out.clear();
    header(out, ns, frame);
    out.f64s(wrench);
}

/// Level of a diagnosis, as ROS counts them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum DiagnosticLevel {
    /// All is well.
    Ok = 0,
    /// Worth a look.
    Warning = 1,
    /// It does not work.
    Error = 2,
    /// Nothing has been heard.
    Stale = 3,
}

/// The state of one part of a cell.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnostic {
    /// Level.
    pub level: DiagnosticLevel,
    /// Name of the part, such as `executor`.
    pub name: String,
    /// One sentence.
    pub message: String,
    /// Figures by name.
    pub values: Vec<(String, String)>,
}

/// `diagnostic_msgs/DiagnosticArray`.
pub fn diagnostics(out: &mut CdrWriter, ns: u64, parts: &[Diagnostic]) {
    out.clear();
    header(out, ns, "");
    out.length(parts.len());
    for part in parts {
        out.u8(part.level as u8);
        out.string(&part.name);
        out.string(&part.message);
        out.string("");
        out.length(part.values.len());
        for (key, value) in &part.values {
            out.string(key);
            out.string(value);
        }
    }
}

/// Level of a log message, as ROS counts them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum LogLevel {
    /// Information.
    Info = 20,
    /// Warning.
    Warning = 30,
    /// Error.
    Error = 40,
}

/// `rcl_interfaces/Log`: a sentence and the name of its source.
pub fn log(out: &mut CdrWriter, ns: u64, level: LogLevel, [name, sentence]: [&str; 2]) {
    out.clear();
    stamp(out, ns);
    out.u8(level as u8);
    out.string(name);
    out.string(sentence);
    out.string("");
    out.string("");
    out.u32(0);
}

/// `std_msgs/String`.
pub fn text(out: &mut CdrWriter, text: &str) {
    out.clear();
    out.string(text);
}
