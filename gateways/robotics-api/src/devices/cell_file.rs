//! The files of the gateway's own cell: one robot file for each arm, with limits that fit the library's motions, and
//! the cell with ideal arms and simulated I/O stations. Pure functions.

use std::fmt::Write as _;
use std::path::PathBuf;

use super::{ArmGeometry, ArmSpec, DeviceKind, DeviceSpec, IoSpec};

/// How often the library's own maximum an arm may go at most. The library plans each joint for its maximum; a straight
/// line moves single joints faster, and the simulators of the library accepted that.
const VELOCITY_FACTOR: f64 = 2.0;
/// As [`VELOCITY_FACTOR`], of accelerations: a set-point of a line begins and ends with a step of it.
const ACCELERATION_FACTOR: f64 = 10.0;

/// Options of the gateway's own cell.
#[derive(Clone, Debug, PartialEq)]
pub struct CellOptions {
    /// Name of the cell.
    pub name: String,
    /// Period of the cell, ms.
    pub period_ms: u32,
    /// Time that set-points wait in the drivers, ms.
    pub delay_ms: u32,
}

/// Returns the robot file of an arm. `recognised` is the section `kinematics` of an arm that `rcc-cli robot import`
/// recognised.
#[must_use]
pub fn robot_file(name: &str, arm: &ArmSpec, recognised: &str, period_ms: u32) -> String {
    let mut text =
        format!("# Written by rcc-robotics-api for the device '{name}'.\nrobot: simulated arm\n");
    match arm.geometry {
        ArmGeometry::Srs {
            lengths: [shoulder, upper, fore, flange],
            signs,
        } => {
            // Writing into a String cannot fail.
            let _ = writeln!(
                text,
                "kinematics:\n  type: srs\n  shoulder_height: {shoulder:?} m\n  upper_arm: {upper:?} m\n  forearm: {fore:?} m\n  \
                 wrist_to_flange: {flange:?} m\n  signs: {signs:?}"
            );
        }
        ArmGeometry::Dh(_) => text.push_str(recognised),
    }
    let _ = writeln!(
        text,
        "# velocity: {VELOCITY_FACTOR} times what the library plans for. acceleration: {ACCELERATION_FACTOR} times.\n\
         # jerk: the whole acceleration may begin, end and reverse within a period: the library plans no jerk.\njoints:"
    );
    for (number, joint) in (1..).zip(&arm.joints) {
        let velocity = joint.velocity * VELOCITY_FACTOR;
        let acceleration = joint.acceleration * ACCELERATION_FACTOR;
        let jerk = 2.0 * acceleration * 1000.0 / f64::from(period_ms);
        let _ = writeln!(
            text,
            "  A{number}: {{position: [{:?} rad, {:?} rad], velocity: {velocity:?} rad/s, acceleration: {acceleration:?} rad/s^2, \
             jerk: {jerk:?} rad/s^3}}",
            joint.least, joint.greatest
        );
    }
    text
}

/// Returns the cell's file; each device comes with its name in the cell, and each arm with its robot file.
#[must_use]
pub fn cell_file(
    options: &CellOptions,
    devices: &[(String, &DeviceSpec, Option<PathBuf>)],
) -> String {
    let CellOptions {
        name,
        period_ms,
        delay_ms,
    } = options;
    let mut text = format!(
        "# Written by rcc-robotics-api: the devices that the library created.\ncell: {name}\nperiod: {period_ms} ms\n\
         stale_after: 1 s\nexecutor: {{priority: 80}}\n"
    );
    let stations: Vec<(&String, &IoSpec)> = devices
        .iter()
        .filter_map(|(name, spec, _)| match &spec.kind {
            DeviceKind::Io(io) => Some((name, io)),
            DeviceKind::Arm(_) => None,
        })
        .collect();
    if !stations.is_empty() {
        let ports: Vec<String> = stations
            .iter()
            .map(|(name, _)| format!("{name}: auto tcp"))
            .collect();
        // Writing into a String cannot fail.
        let _ = writeln!(text, "ports: {{{}}}\nsimulators:", ports.join(", "));
        stations
            .iter()
            .for_each(|(name, io)| simulator(&mut text, name, io));
    }
    text.push_str(match devices.is_empty() {
        true => "devices: {}\n",
        false => "devices:\n",
    });
    for (name, spec, robot) in devices {
        match (&spec.kind, robot) {
            (DeviceKind::Arm(arm), Some(robot)) => {
                let home: Vec<String> = arm
                    .joints
                    .iter()
                    .map(|joint| format!("{:?}", joint.home))
                    .collect();
                let _ = writeln!(
                    text,
                    "  {name}:\n    driver: ideal-arm\n    robot: {}\n    first_tolerance: deg(0.1)\n    delay: {delay_ms} ms\n    \
                     command_timeout: 1 s\n    settings: {{period: {period_ms} ms, start: [{}]}}",
                    robot.display(),
                    home.join(", ")
                );
            }
            (DeviceKind::Io(io), _) => station(&mut text, name, io),
            (DeviceKind::Arm(_), None) => {}
        }
    }
    text
}

/// Greatest value of an analog output, which has no unit: the library names none. A larger one is refused.
const ANALOG_OUT_MAX: u32 = 1_000_000;

/// Writes a station whose outputs are wired to the inputs of the same number.
fn simulator(text: &mut String, name: &str, io: &IoSpec) {
    let _ = writeln!(
        text,
        "  {name}-sim:\n    program: io-sim\n    device: {name}\n    arguments:\n      - --bind=127.0.0.1:${{{name}}}\n      - --parent-death"
    );
    for number in 0..io.digin.min(io.digout) {
        let _ = writeln!(text, "      - --wire=coil:{number}=discrete:{number}");
    }
    // Two registers each.
    for register in 0..2 * io.anin.min(io.anout) {
        let _ = writeln!(text, "      - --wire=holding:{register}=input:{register}");
    }
}

fn station(text: &mut String, name: &str, io: &IoSpec) {
    let _ = writeln!(
        text,
        "  {name}:\n    driver: modbus\n    settings: {{server: \"127.0.0.1:${{{name}}}\", unit: 1, period: 10 ms, timeout: 1 s}}\n    channels:"
    );
    // The library's outputs belong to no net: they keep their value when a net ends.
    for number in 0..io.digin {
        let _ = writeln!(
            text,
            "      digin{number}: {{kind: digital input, address: discrete {number}}}"
        );
    }
    for number in 0..io.digout {
        let _ = writeln!(
            text,
            "      digout{number}: {{kind: digital output, address: coil {number}, on_release: hold}}"
        );
    }
    for number in 0..io.anin {
        let _ = writeln!(
            text,
            "      anin{number}: {{kind: analog input, address: input {} f32 CDAB}}",
            2 * number
        );
    }
    for number in 0..io.anout {
        let _ = writeln!(
            text,
            "      anout{number}: {{kind: analog output, address: holding {} f32 CDAB, range: [-{ANALOG_OUT_MAX}, {ANALOG_OUT_MAX}], on_release: hold}}",
            2 * number
        );
    }
}
