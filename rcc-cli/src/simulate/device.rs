//! Model of a device: an optional arm, inputs set by a script or wired to outputs, and outputs that follow commands or
//! are released. Runs in virtual time on the caller's thread.

use bytemuck::Zeroable;
use rcc_config::{DeviceConfig, OnRelease, RobotConfig, SimulatorConfig};
use rcc_core::guard::Guard;
use rcc_core::impedance::{ControlMode, Impedance, ImpedanceLimits};
use rcc_core::message::{CommandImage, DeviceState, Joints, MAGIC, Measurement, SetPoint};
use rcc_core::primitive::ChannelKind;
use rcc_motion::StopLimits;

use super::arguments::{IDEAL_ARM, arguments_of, value_of};
use super::arm::FollowingArm;
use super::contact::FlangeContact;
use super::reading::Reading;

/// A connection from an output to an input of the device; indices among the channels of their kinds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OutputWire {
    digital: bool,
    from: usize,
    to: usize,
    /// SI value of the input = SI value of the output × `scale` + `offset`.
    scale: f64,
    offset: f64,
}

/// Value of an output that is not commanded; `None` keeps the last value.
type ReleaseValue = Option<f64>;

/// A device in virtual time.
#[derive(Debug)]
pub struct SimulatedDevice {
    arm: Option<FollowingArm>,
    contact: Option<FlangeContact>,
    limits: Option<ImpedanceLimits>,
    /// Current impedance of the arm.
    impedance: Impedance,
    measurement: Measurement,
    /// Readings that a script has set; they replace those of the model.
    scripted: Vec<(Reading, f64)>,
    wires: Vec<OutputWire>,
    digital: u64,
    analog: Vec<f64>,
    digital_release: Vec<ReleaseValue>,
    analog_release: Vec<ReleaseValue>,
}

impl SimulatedDevice {
    /// Creates a device at rest, as described by the configuration and its simulators. Digital inputs are false, analog
    /// inputs have the value of raw 0.
    #[must_use]
    pub fn new(
        config: &DeviceConfig,
        simulators: &[SimulatorConfig],
        period_ns: u64,
    ) -> SimulatedDevice {
        let arguments = arguments_of(config, simulators);
        let mut measurement = Measurement::zeroed();
        measurement.magic = MAGIC;
        measurement.quality_permille = 1000;
        measurement.joints = config.model().joints;
        measurement.strategy = strategy(&arguments) as u64;
        let digital_inputs = config.channels_of(ChannelKind::DigitalInput).count();
        measurement.digital_known = low_bits(digital_inputs);
        measurement.period_ns = period_ns;
        measurement.analog.fill(f64::NAN);
        measurement.analog_out.fill(f64::NAN);
        for channel in config.channels_of(ChannelKind::AnalogInput) {
            if let Some(slot) = measurement.analog.get_mut(channel.index as usize) {
                *slot = channel.offset;
            }
        }
        let release = |kind| {
            let channels = config.channels_of(kind);
            let released = channels.map(|channel| match channel.on_release {
                Some(OnRelease::Safe(value)) => Some(value),
                Some(OnRelease::Hold) | None => None,
            });
            released.collect::<Vec<ReleaseValue>>()
        };
        let analog_release = release(ChannelKind::AnalogOutput);
        SimulatedDevice {
            arm: arm(config, &arguments, period_ns),
            contact: FlangeContact::of(config, &arguments),
            limits: config.model().impedance,
            impedance: Impedance::NONE,
            measurement,
            scripted: Vec::new(),
            wires: wires(config, &arguments),
            digital: 0,
            analog: vec![0.0; analog_release.len()],
            digital_release: release(ChannelKind::DigitalOutput),
            analog_release,
        }
    }

    /// Simulates one exchange at `now_ns`; `image` is what the executor wrote in its last cycle.
    pub fn exchange(&mut self, image: Option<&CommandImage>, now_ns: u64) {
        let newest = image.and_then(|image| image.at(image.head.sequence));
        let mut outputs = newest.copied().unwrap_or(SetPoint::NONE);
        if let (Some(arm), Some(image)) = (&mut self.arm, image) {
            arm.exchange(image);
            outputs = *arm.outputs();
        }
        self.update_outputs(&outputs);
        self.update_impedance(&outputs);
        self.apply_wires();
        let m = &mut self.measurement;
        m.sequence += 1;
        m.periods += 1;
        m.stamp_ns = now_ns;
        m.digital_out = self.digital;
        m.digital_out_known = low_bits(self.digital_release.len());
        for (slot, value) in m.analog_out.iter_mut().zip(&self.analog) {
            *slot = *value;
        }
        m.state = DeviceState::Ready as u32;
        if let Some(arm) = &self.arm {
            m.state = arm.state() as u32;
            (m.position, m.hold) = (*arm.position(), *arm.position());
            (m.played_ns, m.settled_ns) = (arm.played_ns(), arm.settled_ns());
        }
        if let Some(contact) = &mut self.contact {
            contact.measure(&self.impedance, m);
        }
        for (reading, value) in &self.scripted {
            if let Some(place) = reading.place(m) {
                *place = *value;
            }
        }
    }

    /// Sets the impedance: that of the followed set-point, or else the last one without added force.
    fn update_impedance(&mut self, outputs: &SetPoint) {
        let strategy = self.measurement.strategy;
        let asked = &outputs.impedance;
        if outputs.has_position == 1 && asked.strategy == strategy {
            self.impedance = *asked;
            return;
        }
        if let (Some(known), Some(limits), true) = (
            ControlMode::from_number(strategy),
            self.limits,
            self.impedance.strategy != strategy,
        ) {
            self.impedance = limits.default_hold(known, self.measurement.joints as usize);
        }
        self.impedance.added = Impedance::NONE.added;
    }

    /// Returns the measurement that its driver would publish.
    #[must_use]
    pub fn measurement(&self) -> &Measurement {
        &self.measurement
    }

    /// Returns the hold position of its arm; `None` without an arm.
    #[must_use]
    pub fn hold(&self) -> Option<Joints> {
        self.arm.as_ref().map(|arm| *arm.position())
    }

    /// Returns what touches and loads the flange; `None` without an arm.
    pub fn contact_mut(&mut self) -> Option<&mut FlangeContact> {
        self.contact.as_mut()
    }

    /// Sets what a sensor reads from now on, SI units, instead of what the model gives; NaN is null.
    pub fn set_reading(&mut self, reading: Reading, value: f64) {
        self.scripted.retain(|(known, _)| *known != reading);
        self.scripted.push((reading, value));
    }

    /// Sets a digital input from now on, also if an output is wired to it; `None` makes it unknown.
    pub fn set_digital(&mut self, index: usize, value: Option<bool>) {
        self.wires.retain(|wire| !wire.digital || wire.to != index);
        self.read_digital(index, value);
    }

    fn read_digital(&mut self, index: usize, value: Option<bool>) {
        set_bit(&mut self.measurement.digital, index, value == Some(true));
        set_bit(&mut self.measurement.digital_known, index, value.is_some());
    }

    /// Sets an analog input from now on, SI units, also if an output is wired to it; NaN makes it unknown.
    pub fn set_analog(&mut self, index: usize, value: f64) {
        self.wires.retain(|wire| wire.digital || wire.to != index);
        self.read_analog(index, value);
    }

    fn read_analog(&mut self, index: usize, value: f64) {
        if let Some(slot) = self.measurement.analog.get_mut(index) {
            *slot = value;
        }
    }

    /// Sets the outputs to commanded values, or releases them.
    fn update_outputs(&mut self, outputs: &SetPoint) {
        for (index, release) in self.digital_release.iter().enumerate() {
            let commanded = outputs.digital_commanded >> index & 1 == 1;
            let value = match (commanded, release) {
                (true, _) => outputs.digital >> index & 1 == 1,
                (false, Some(safe)) => *safe != 0.0,
                (false, None) => continue,
            };
            set_bit(&mut self.digital, index, value);
        }
        let rows = self.analog.iter_mut().zip(&self.analog_release);
        for ((slot, release), commanded) in rows.zip(outputs.analog) {
            match (commanded.is_nan(), release) {
                (false, _) => *slot = commanded,
                (true, Some(safe)) => *slot = *safe,
                (true, None) => {}
            }
        }
    }

    fn apply_wires(&mut self) {
        for index in 0..self.wires.len() {
            let wire = self.wires[index];
            if wire.digital {
                self.read_digital(wire.to, Some(self.digital >> wire.from & 1 == 1));
            } else {
                let value = self.analog.get(wire.from).copied().unwrap_or(f64::NAN);
                self.read_analog(wire.to, value * wire.scale + wire.offset);
            }
        }
    }
}

/// Control strategies as named by `--strategy=`.
pub(super) const STRATEGIES: [(&str, ControlMode); 3] = [
    ("position", ControlMode::Position),
    ("cartesian-impedance", ControlMode::CartesianImpedance),
    ("joint-impedance", ControlMode::JointImpedance),
];

/// Returns the control strategy selected by a simulator's arguments.
fn strategy(arguments: &[&str]) -> ControlMode {
    let chosen = value_of(arguments, "--strategy=");
    let row = STRATEGIES.iter().find(|(word, _)| Some(*word) == chosen);
    row.map_or(ControlMode::Position, |(_, strategy)| *strategy)
}

/// Returns a mask of the `count` lowest bits.
fn low_bits(count: usize) -> u64 {
    1u64.checked_shl(count as u32)
        .map_or(u64::MAX, |bit| bit - 1)
}

fn set_bit(bits: &mut u64, index: usize, value: bool) {
    let bit = 1u64.checked_shl(index as u32).unwrap_or(0);
    *bits = if value { *bits | bit } else { *bits & !bit };
}

/// Returns the start position of an arm: that of its simulator (`--start=`) or driver, or else the middle of its
/// ranges, rad.
fn start(config: &DeviceConfig, robot: &RobotConfig, arguments: &[&str]) -> Joints {
    if config.driver.is(IDEAL_ARM) {
        let given = config.settings.get("start");
        return given
            .and_then(|given| robot.positions(given))
            .unwrap_or_else(|| robot.nearest_to_zero());
    }
    let given = value_of(arguments, "--start=");
    let given: Vec<f64> = given
        .iter()
        .flat_map(|list| list.split(','))
        .filter_map(|number| number.trim().parse().ok())
        .collect();
    let mut position: Joints = [0.0; 8];
    for ((index, slot), joint) in position.iter_mut().enumerate().zip(&robot.joints) {
        let middle = 0.5 * (joint.lower_rad + joint.upper_rad);
        *slot = given.get(index).copied().unwrap_or(middle);
    }
    position
}

/// Creates the arm of a device, if it has one.
fn arm(config: &DeviceConfig, arguments: &[&str], period_ns: u64) -> Option<FollowingArm> {
    let robot = config.robot.as_ref()?;
    let limits = robot.limits();
    let position = start(config, robot, arguments);
    let mut jerk_max = [f64::INFINITY; 8];
    for (slot, joint) in jerk_max.iter_mut().zip(&robot.joints) {
        *slot = joint.jerk_rad_s3;
    }
    let rest = StopLimits {
        velocity_max: limits.velocity_max,
        acceleration_max: limits.acceleration_max,
        jerk_max,
        joints: limits.joints,
    };
    let guard = Guard::new(limits, config.first_tolerance_rad);
    let delay = config.delay_ns.div_ceil(period_ns.max(1));
    Some(FollowingArm::new(
        rest,
        guard,
        position,
        delay,
        period_ns as f64 / 1e9,
    ))
}

/// Returns the wires among a simulator's arguments that connect one output to one input of the device.
/// `--wire-bool=1=2` and `--wire-real=1=2` name addresses; `--wire=coil:0=discrete:0` names kinds and addresses.
fn wires(config: &DeviceConfig, arguments: &[&str]) -> Vec<OutputWire> {
    let plain = |address: &serde_json::Value| match address {
        serde_json::Value::String(text) => text.replace(' ', ":"),
        other => other.to_string(),
    };
    let of = |kind: ChannelKind, address: &str| {
        config
            .channels_of(kind)
            .find(|channel| plain(&channel.address) == address)
    };
    let wire = |argument: &&str| {
        let (option, rest) = argument.split_once('=')?;
        let (from, to) = rest.split_once('=')?;
        let kinds: &[bool] = match option {
            "--wire-bool" => &[true],
            "--wire-real" => &[false],
            "--wire" => &[true, false],
            _ => return None,
        };
        kinds.iter().find_map(|&digital| {
            let (output, input) = if digital {
                (ChannelKind::DigitalOutput, ChannelKind::DigitalInput)
            } else {
                (ChannelKind::AnalogOutput, ChannelKind::AnalogInput)
            };
            let (output, input) = (of(output, from)?, of(input, to)?);
            // Both channels share the same raw number.
            let scale = input.scale / output.scale;
            Some(OutputWire {
                digital,
                from: output.index as usize,
                to: input.index as usize,
                scale,
                offset: input.offset - output.offset * scale,
            })
        })
    };
    arguments.iter().filter_map(wire).collect()
}
