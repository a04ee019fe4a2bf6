//! States and values of the robot as channels: analog and digital inputs whose address is a word of this file, not a name of
//! the station.
//! Read at start; evaluated by the host's thread.

use rcc_config::{ChannelConfig, DeviceConfig};
use rcc_core::primitive::ChannelKind::{AnalogInput, DigitalInput};

use super::robot_state::RobotState;
use crate::fri_iiwa::wire::{JOINTS, SafetyState, SessionState};
use rcc_driver_kit::driver::{Inputs, channels, to_si};

/// A value of the robot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RobotValue {
    /// Position that the motion itself commands, rad; joint from 0.
    Interpolated(usize),
    /// Position that is commanded in total, rad; 1.x.
    Commanded(usize),
    /// Torque that the robot's controller commands, N·m.
    CommandedTorque(usize),
    /// Redundancy of the measured position, rad; 2.x.
    Redundancy,
    /// Tracking performance, 0 to 1.
    Tracking,
    /// State of the session, 0 to 4.
    Session,
    /// Rating of the connection, 0 to 3.
    Quality,
    /// State of the safety controller, 0 to 3.
    Safety,
    /// Operating mode, 0 to 2.
    Operation,
    /// Controller of the joints, 0 to 3.
    Control,
    /// Client command mode of the overlay, 0 to 4.
    CommandMode,
    /// The lowest state of a drive, 0 to 2.
    Drives,
    /// Send period, s.
    SendPeriod,
    /// Receive multiplier.
    ReceiveMultiplier,
}

/// The addresses, but for those with the number of a joint.
const WORDS: [(&str, RobotValue); 11] = [
    ("redundancy", RobotValue::Redundancy),
    ("tracking", RobotValue::Tracking),
    ("session", RobotValue::Session),
    ("quality", RobotValue::Quality),
    ("safety", RobotValue::Safety),
    ("operation", RobotValue::Operation),
    ("control", RobotValue::Control),
    ("command mode", RobotValue::CommandMode),
    ("drives", RobotValue::Drives),
    ("send period", RobotValue::SendPeriod),
    ("receive multiplier", RobotValue::ReceiveMultiplier),
];

/// A condition of the robot's state.
type Condition = fn(&RobotState) -> bool;

/// Conditions that a digital input shows.
const CONDITIONS: [(&str, Condition); 3] = [
    ("commanding", |robot| {
        robot.session == SessionState::CommandingActive
    }),
    ("drives active", RobotState::drives_active),
    ("safety normal", |robot| {
        robot.safety == SafetyState::Normal as i32
    }),
];

impl RobotValue {
    /// Returns the value with this address.
    #[must_use]
    pub fn parse(address: &str) -> Option<Self> {
        if let Some((_, value)) = WORDS.iter().find(|row| row.0 == address) {
            return Some(*value);
        }
        let (words, number) = address.rsplit_once(' ')?;
        let joint = number.parse::<usize>().ok()?.checked_sub(1)?;
        let value = match words {
            "interpolated" => Self::Interpolated(joint),
            "commanded" => Self::Commanded(joint),
            "commanded torque" => Self::CommandedTorque(joint),
            _ => return None,
        };
        (joint < JOINTS).then_some(value)
    }

    /// Returns the value; NaN if the robot does not tell it at present.
    fn of(self, robot: &RobotState) -> f64 {
        let number = |number: i32| {
            if number < 0 {
                f64::NAN
            } else {
                f64::from(number)
            }
        };
        let joint = |joints: Option<&rcc_core::message::Joints>, joint: usize| {
            joints.and_then(|joints| joints.get(joint)).copied()
        };
        let found = match self {
            Self::Interpolated(at) => joint(robot.interpolated.as_ref(), at),
            Self::Commanded(at) => joint(robot.commanded.as_ref(), at),
            Self::CommandedTorque(at) => joint(Some(&robot.commanded_torque), at),
            Self::Redundancy => robot.measured_redundancy.and_then(|found| found.value),
            Self::Tracking => Some(robot.tracking),
            Self::Session => Some(number(robot.session as i32)),
            Self::Quality => Some(number(robot.quality as i32)),
            Self::Safety => Some(number(robot.safety)),
            Self::Operation => Some(number(robot.operation)),
            Self::Control => Some(number(robot.control)),
            Self::CommandMode => Some(number(robot.command_mode)),
            Self::Drives => robot.drives.iter().min().map(|drive| number(*drive)),
            Self::SendPeriod => Some(robot.period_ns as f64 * 1e-9),
            Self::ReceiveMultiplier => Some(f64::from(robot.multiplier)),
        };
        found.filter(|value| value.is_finite()).unwrap_or(f64::NAN)
    }
}

/// Returns true if the address is one of this file, for an analog or a digital input.
#[must_use]
pub fn is_robot_value(channel: &ChannelConfig) -> bool {
    let address = channel.address.as_str().unwrap_or_default();
    match channel.kind {
        AnalogInput => RobotValue::parse(address).is_some(),
        DigitalInput => CONDITIONS.iter().any(|row| row.0 == address),
        _ => false,
    }
}

/// The channels of a device that show values of the robot.
#[derive(Clone, Debug)]
pub struct RobotValues {
    analog: Vec<(usize, RobotValue, ChannelConfig)>,
    digital: Vec<(usize, Condition)>,
}

impl RobotValues {
    /// Finds the channels; all others are the station's.
    #[must_use]
    pub fn new(device: &DeviceConfig) -> Self {
        let address = |channel: &ChannelConfig| channel.address.as_str().unwrap_or("").to_owned();
        let analog = channels(device, AnalogInput).into_iter().enumerate();
        let analog = analog.filter_map(|(index, channel)| {
            let value = RobotValue::parse(&address(channel))?;
            Some((index, value, channel.clone()))
        });
        let digital = channels(device, DigitalInput).into_iter().enumerate();
        let digital = digital.filter_map(|(index, channel)| {
            let address = address(channel);
            let row = CONDITIONS.iter().find(|row| row.0 == address)?;
            Some((index, row.1))
        });
        Self {
            analog: analog.collect(),
            digital: digital.collect(),
        }
    }

    /// Copies the values; without a robot they stay unknown.
    pub fn fill(&self, robot: Option<&RobotState>, inputs: &mut Inputs) {
        let Some(robot) = robot else {
            return;
        };
        for (index, value, config) in &self.analog {
            if let Some(place) = inputs.analog.get_mut(*index) {
                *place = to_si(config, value.of(robot));
            }
        }
        for (index, holds) in &self.digital {
            inputs.digital |= u64::from(holds(robot)) << index;
            inputs.digital_known |= 1 << index;
        }
    }
}
