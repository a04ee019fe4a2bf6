//! Texts of small nets for the demo cell's devices, loaded by the suites.
//! Pure functions.

/// Start position of the simulated arm, J1 to J7, rad (`configs/cells/demo.yaml`).
pub const START: [f64; 7] = [
    0.0,
    -0.523_598_775_598_298_8,
    0.0,
    std::f64::consts::FRAC_PI_2,
    0.0,
    -1.047_197_551_196_597_6,
    0.0,
];

/// Moves the flange on a straight line from the current hold position to `y` (m) at `speed` (m/s); stops on CANCEL.
pub fn line(name: &str, y: f64, speed: f64) -> String {
    motion(name, y, speed, "")
}

/// Like [`line()`], with additional primitives (lines of the section `primitives`).
pub fn motion(name: &str, y: f64, speed: f64, further: &str) -> String {
    format!(
        "net: {name}
primitives:
  cancel: {{type: Cancel}}
  move:
    type: LinearMotion
    parameters:
      device: lwr
      to: {{xyz: [0.538, {y}, 0.384], quat: [0, 1, 0, 0]}}
      velocity: {speed} m/s
      acceleration: 1 m/s^2
      jerk: 10 m/s^3
    inputs: {{stop: cancel.requested}}
  ik: {{type: InverseKinematics, parameters: {{device: lwr}}, inputs: {{pose: move.pose}}}}
  robot: {{type: JointPositionCommand, parameters: {{device: lwr}}, inputs: {{position: ik.joints}}}}
  end: {{type: Termination, inputs: {{done: move.done}}}}
{further}"
    )
}

/// Additional primitives of [`motion`]: J7 turns by 50 rad per metre, which exceeds its velocity limit.
pub const TURNED_AS_WELL: &str = "  \
  turn: {type: Multiply, inputs: {a: move.distance, b: 50 rad/m}}
  turned: {type: SetElement, inputs: {in: ik.joints, index: 6, value: turn.out}}
";

/// Like [`line()`], but ignores CANCEL.
pub fn uncancelable_line(name: &str, y: f64, speed: f64) -> String {
    line(name, y, speed)
        .replace("  cancel: {type: Cancel}\n", "")
        .replace("    inputs: {stop: cancel.requested}\n", "")
}

/// Switches the lamp of the device `io` on until CANCEL; monitors the net's logical time every cycle.
pub fn lamp(name: &str) -> String {
    output(name, "io", "lamp")
}

/// Keeps a digital output true until CANCEL; monitors the net's logical time every cycle.
pub fn output(name: &str, device: &str, channel: &str) -> String {
    format!(
        "net: {name}
primitives:
  cancel: {{type: Cancel}}
  clock: {{type: Time}}
  out: {{type: DigitalOutput, parameters: {{device: {device}, channel: {channel}}}, inputs: {{in: true}}}}
  end: {{type: Termination, inputs: {{done: cancel.requested}}}}
  watch: {{type: Monitor, parameters: {{rate: 1000 Hz}}, inputs: {{value: clock.out}}}}
"
    )
}

/// Commands nothing; monitors the net's logical time every cycle until CANCEL.
pub fn clock(name: &str) -> String {
    format!(
        "net: {name}
primitives:
  cancel: {{type: Cancel}}
  clock: {{type: Time}}
  end: {{type: Termination, inputs: {{done: cancel.requested}}}}
  watch: {{type: Monitor, parameters: {{rate: 1000 Hz}}, inputs: {{value: clock.out}}}}
"
    )
}

/// Commands nothing; monitors a digital input every cycle until CANCEL.
pub fn input(name: &str, device: &str, channel: &str) -> String {
    format!(
        "net: {name}
primitives:
  cancel: {{type: Cancel}}
  in: {{type: DigitalInput, parameters: {{device: {device}, channel: {channel}}}}}
  end: {{type: Termination, inputs: {{done: cancel.requested}}}}
  watch: {{type: Monitor, parameters: {{rate: 1000 Hz}}, inputs: {{value: in.out}}}}
"
    )
}
