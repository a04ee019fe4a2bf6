//! Checks what C has written, so that nothing goes on that is not finite, out of range or unknown.
//! Pure; run by the host's thread after each exchange.

use rcc_driver_kit::driver::{Exchange, Inputs, to_si};
use rcc_driver_kit::host::reason::Reason;
use rcc_driver_kit::rcc_config::ChannelConfig;
use rcc_driver_kit::rcc_core::impedance::ControlMode;
use rcc_driver_kit::rcc_core::message::{JOINTS_MAX, Joints};
use thiserror::Error;

use crate::ffi::{RawExchange, RawInputs};

/// Longest period of a device, s.
const PERIOD_MAX_S: f64 = 3600.0;

/// A value of C that is not passed on.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum InvalidValue {
    /// The device is lost for it.
    #[error("joint {joint}: its {what} is {value}")]
    Joint {
        /// From 1.
        joint: usize,
        /// Name of the value.
        what: &'static str,
        /// The value.
        value: f64,
    },
    /// The device is lost for it.
    #[error("rcc_exchange.{field} is {value}")]
    Exchange {
        /// Name of the field.
        field: &'static str,
        /// The value.
        value: f64,
    },
    /// The device is lost for it.
    #[error("it is not commandable, and rcc_exchange.reason does not say why")]
    NoReason,
    /// The value is unknown.
    #[error("rcc_inputs.{field}[{index}] is {value}: unknown")]
    Input {
        /// Name of the field.
        field: &'static str,
        /// Index in it.
        index: usize,
        /// The value.
        value: f64,
    },
}

/// The reference of a check: the device, and the reasons of its driver.
#[derive(Debug)]
pub struct Expected<'a> {
    /// Joints of the arm; 0 for plain I/O.
    pub joints: usize,
    /// Digital inputs of the configuration.
    pub digital_inputs: usize,
    /// Analog inputs, in the order of their index.
    pub analog_inputs: &'a [ChannelConfig],
    /// All reasons of the driver.
    pub reasons: &'a [Reason],
}

/// Returns the exchange, with `late` and `refused` as C counts them.
///
/// # Errors
/// Returns the first value for which the device is lost.
pub fn exchange(
    expected: &Expected<'_>,
    inputs: &RawInputs,
    raw: &RawExchange,
) -> Result<Exchange, InvalidValue> {
    let of = |field, value| Err(InvalidValue::Exchange { field, value });
    let mut mirror = [0.0; JOINTS_MAX];
    for (joint, place) in mirror.iter_mut().enumerate().take(expected.joints) {
        let position = joint_value(joint, "position", inputs.position.get(joint))?;
        *place = match raw.mirror.get(joint) {
            Some(own) if own.is_nan() => position,
            own => joint_value(joint, "mirror", own)?,
        };
    }
    let is_period = raw.period_s > 0.0 && raw.period_s <= PERIOD_MAX_S;
    let is_reason = |number| expected.reasons.iter().any(|row| row.0 == number);
    match raw {
        _ if !is_period => of("period_s", raw.period_s),
        RawExchange { ticks: 0, .. } => of("ticks", 0.0),
        RawExchange {
            quality: 1001.., ..
        } => of("quality", f64::from(raw.quality)),
        _ if raw.reason != 0 && !is_reason(raw.reason) => of("reason", f64::from(raw.reason)),
        RawExchange {
            commandable: 0,
            reason: 0,
            ..
        } => Err(InvalidValue::NoReason),
        _ => Ok(Exchange {
            commandable: raw.commandable != 0,
            startable: raw.commandable != 0 && raw.reason == 0,
            strategy: ControlMode::Position,
            mirror,
            ticks: raw.ticks,
            // At least 1: a shorter period would be less than a nanosecond.
            period_ns: ((raw.period_s * 1e9).round() as u64).max(1),
            quality_permille: raw.quality,
            reason: raw.reason,
            late: raw.late,
            refused: raw.refused,
        }),
    }
}

fn joint_value(joint: usize, what: &'static str, value: Option<&f64>) -> Result<f64, InvalidValue> {
    let value = value.copied().unwrap_or(f64::NAN);
    match value.is_finite() {
        true => Ok(value),
        false => Err(InvalidValue::Joint {
            joint: joint + 1,
            what,
            value,
        }),
    }
}

/// Returns the inputs in SI units, and the first value that is neither known nor unknown, which is unknown now. Positions were
/// checked by [`exchange`].
pub fn inputs(expected: &Expected<'_>, raw: &RawInputs) -> (Inputs, Option<InvalidValue>) {
    let mut invalid = None;
    let mut tell = |field, index, value| {
        invalid.get_or_insert(InvalidValue::Input {
            field,
            index,
            value,
        });
    };
    let mut inputs = Inputs::NONE;
    let joints = expected.joints;
    inputs.position[..joints.min(JOINTS_MAX)]
        .copy_from_slice(&raw.position[..joints.min(JOINTS_MAX)]);
    inputs.torque = known("torque", &raw.torque, joints, &mut tell);
    inputs.external_torque = known("external_torque", &raw.external_torque, joints, &mut tell);
    let missing = raw.wrench.iter().position(|value| !value.is_finite());
    inputs.wrench = match missing {
        None => raw.wrench,
        Some(index) => {
            if raw.wrench.iter().any(|value| !value.is_nan()) {
                tell("wrench", index, raw.wrench[index]);
            }
            [f64::NAN; 6]
        }
    };
    for (index, value) in raw.digital.iter().enumerate().take(expected.digital_inputs) {
        match value {
            0 | 1 => {
                inputs.digital |= u64::from(*value == 1) << index;
                inputs.digital_known |= 1 << index;
            }
            -1 => {}
            _ => tell("digital", index, f64::from(*value)),
        }
    }
    let analog = inputs.analog.iter_mut().zip(expected.analog_inputs);
    for (index, ((place, channel), value)) in analog.zip(raw.analog).enumerate() {
        *place = to_si(channel, value);
        if !place.is_finite() {
            *place = f64::NAN;
            if !value.is_nan() {
                tell("analog", index, value);
            }
        }
    }
    (inputs, invalid)
}

/// Returns joint values, NaN where they are unknown.
fn known(
    field: &'static str,
    raw: &Joints,
    joints: usize,
    tell: &mut impl FnMut(&'static str, usize, f64),
) -> Joints {
    let mut values = [f64::NAN; JOINTS_MAX];
    for (index, (place, value)) in values.iter_mut().zip(raw).enumerate().take(joints) {
        match value.is_infinite() {
            true => tell(field, index, *value),
            false => *place = *value,
        }
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::c_driver::{UNKNOWN_INPUTS, USUAL_EXCHANGE};

    const ARM: Expected<'static> = Expected {
        joints: 2,
        digital_inputs: 1,
        analog_inputs: &[],
        reasons: &[(200, "it holds")],
    };

    fn of(change: impl Fn(&mut RawInputs, &mut RawExchange)) -> Result<Exchange, InvalidValue> {
        let (mut inputs, mut raw) = (UNKNOWN_INPUTS, USUAL_EXCHANGE);
        inputs.position[..2].copy_from_slice(&[0.1, 0.2]);
        raw.period_s = 0.004;
        change(&mut inputs, &mut raw);
        exchange(&ARM, &inputs, &raw)
    }

    #[test]
    fn an_arm_without_a_mirror_holds_itself_at_its_position() {
        let exchange = of(|_, _| {}).expect("all is right");
        assert_eq!(exchange.mirror[..3], [0.1, 0.2, 0.0]);
        assert_eq!((exchange.period_ns, exchange.ticks), (4_000_000, 1));
        assert!(exchange.commandable && exchange.startable);
    }

    #[test]
    fn every_value_for_which_the_device_is_lost_is_named() {
        type Change = fn(&mut RawInputs, &mut RawExchange);
        let rows: [(Change, &str); 10] = [
            (
                |inputs, _| inputs.position[1] = f64::NAN,
                "joint 2: its position is NaN",
            ),
            (
                |inputs, _| inputs.position[0] = f64::INFINITY,
                "joint 1: its position is inf",
            ),
            (
                |_, raw| raw.mirror[0] = f64::INFINITY,
                "joint 1: its mirror is inf",
            ),
            (|_, raw| raw.period_s = f64::NAN, "period_s is NaN"),
            (|_, raw| raw.period_s = 0.0, "period_s is 0"),
            (|_, raw| raw.period_s = 1e9, "period_s is 1000000000"),
            (|_, raw| raw.ticks = 0, "ticks is 0"),
            (|_, raw| raw.quality = 1001, "quality is 1001"),
            (|_, raw| raw.reason = 7, "reason is 7"),
            (|_, raw| raw.commandable = 0, "does not say why"),
        ];
        for (change, words) in rows {
            let told = of(change).expect_err(words).to_string();
            assert!(told.contains(words), "{told}");
        }
        let held = of(|_, raw| (raw.commandable, raw.reason) = (0, 200)).expect("a reason");
        assert!(!held.commandable && !held.startable);
    }

    #[test]
    fn an_input_that_is_not_finite_is_unknown_and_named() {
        let mut raw = UNKNOWN_INPUTS;
        assert_eq!(inputs(&ARM, &raw).1, None, "unknown is no mistake");
        raw.position = [0.0; JOINTS_MAX];
        raw.torque[0] = f64::INFINITY;
        raw.torque[1] = 3.0;
        raw.digital[0] = 2;
        raw.wrench[0] = 1.0;
        let (read, invalid) = inputs(&ARM, &raw);
        assert!(read.torque[0].is_nan() && read.wrench.iter().all(|value| value.is_nan()));
        assert_eq!((read.torque[1], read.digital_known), (3.0, 0));
        let told = invalid.expect("the first one").to_string();
        assert!(told.contains("torque[0] is inf"), "{told}");
    }
}
