//! Checks what a driver returns before it is published or played: a driver of somebody else may return anything.
//! Pure; run by the host's thread after each exchange.

use rcc_config::DeviceConfig;
use rcc_core::message::{ANALOG_MAX, DIGITAL_MAX};
use rcc_core::primitive::ChannelKind;
use thiserror::Error;

use crate::driver::{Exchange, Inputs};

/// Longest period of a device, ns: one hour.
const PERIOD_MAX_NS: u64 = 3_600_000_000_000;
/// Most periods between two exchanges; at 1 ms 49 days.
const TICKS_MAX: u64 = 0xffff_ffff;

/// A value for which a device is lost: nothing could be played by it.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum ImpossibleExchange {
    /// The joint's hold position is not finite.
    #[error("Exchange::mirror of joint {joint} is {value}")]
    Mirror {
        /// From 1.
        joint: usize,
        /// The value.
        value: f64,
    },
    /// The period is 0 or longer than an hour.
    #[error("Exchange::period_ns is {0}, expected 1 ns to 1 hour")]
    Period(u64),
    /// More periods than a device can have had.
    #[error("Exchange::ticks is {0}, expected at most 4294967295")]
    Ticks(u64),
    /// The quality is above 1000.
    #[error("Exchange::quality_permille is {0}, expected at most 1000")]
    Quality(u32),
}

/// The ranges and types that the values of one device must have.
#[derive(Clone, Copy, Debug)]
pub struct ExchangeCheck {
    /// Bit i: the device has digital input i.
    digital: u64,
    /// Ranges of the analog inputs, SI; those that the device does not have admit nothing.
    analog: [Option<[f64; 2]>; ANALOG_MAX],
}

impl ExchangeCheck {
    /// Returns the check for this device.
    #[must_use]
    pub fn new(device: &DeviceConfig) -> Self {
        let digital = device.channels_of(ChannelKind::DigitalInput);
        let mut analog = [None; ANALOG_MAX];
        let channels = device.channels_of(ChannelKind::AnalogInput);
        for (place, channel) in analog.iter_mut().zip(channels) {
            *place = Some(channel.range.unwrap_or([f64::MIN, f64::MAX]));
        }
        Self {
            digital: (0..DIGITAL_MAX)
                .zip(digital)
                .fold(0, |bits, (bit, _)| bits | 1 << bit),
            analog,
        }
    }

    /// Makes every input unknown that the device does not have, or that is outside of its channel's range.
    pub fn limit(&self, inputs: &mut Inputs) {
        inputs.digital_known &= self.digital;
        inputs.digital &= self.digital;
        for (value, range) in inputs.analog.iter_mut().zip(self.analog) {
            let is_inside = |[lower, upper]: [f64; 2]| lower <= *value && *value <= upper;
            if !range.is_some_and(is_inside) {
                *value = f64::NAN;
            }
        }
    }

    /// Checks what the host computes with.
    ///
    /// # Errors
    /// Returns the first value for which the device is lost.
    pub fn check(exchange: &Exchange) -> Result<(), ImpossibleExchange> {
        for (value, joint) in exchange.mirror.iter().zip(1..) {
            if !value.is_finite() {
                let value = *value;
                return Err(ImpossibleExchange::Mirror { joint, value });
            }
        }
        match exchange {
            Exchange { period_ns, .. } if !(1..=PERIOD_MAX_NS).contains(period_ns) => {
                Err(ImpossibleExchange::Period(*period_ns))
            }
            Exchange { ticks, .. } if *ticks > TICKS_MAX => Err(ImpossibleExchange::Ticks(*ticks)),
            Exchange {
                quality_permille, ..
            } if *quality_permille > 1000 => Err(ImpossibleExchange::Quality(*quality_permille)),
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use rcc_core::impedance::ControlMode;
    use rcc_core::message::JOINTS_MAX;

    use super::*;
    use crate::conformance;

    fn exchange() -> Exchange {
        Exchange {
            strategy: ControlMode::Position,
            commandable: true,
            startable: true,
            mirror: [0.0; JOINTS_MAX],
            ticks: 1,
            period_ns: 1_000_000,
            quality_permille: 1000,
            reason: 0,
            late: 0,
            refused: 0,
        }
    }

    fn check() -> ExchangeCheck {
        let range = Some([0.0, 2.0]);
        let channels = [
            ("door", ChannelKind::DigitalInput, 1.into(), None, None),
            ("level", ChannelKind::AnalogInput, 1.into(), None, range),
        ];
        let device = conformance::device("none", serde_json::json!({}), &channels);
        ExchangeCheck::new(&device)
    }

    #[test]
    fn an_input_that_the_device_does_not_have_or_that_is_out_of_range_is_unknown() {
        for (raw, expected) in [
            (1.5, Some(1.5)),
            (2.5, None),
            (f64::INFINITY, None),
            (f64::NAN, None),
        ] {
            let mut inputs = Inputs {
                digital: !0,
                digital_known: !0,
                analog: [raw; ANALOG_MAX],
                ..Inputs::NONE
            };
            check().limit(&mut inputs);
            assert_eq!((inputs.digital, inputs.digital_known), (1, 1));
            let known: Vec<f64> = (inputs.analog.into_iter())
                .filter(|value| !value.is_nan())
                .collect();
            assert_eq!(known, Vec::from_iter(expected), "{raw}");
        }
    }

    #[test]
    fn nothing_is_played_by_a_mirror_a_period_or_a_time_that_no_device_can_have() {
        assert_eq!(ExchangeCheck::check(&exchange()), Ok(()));
        let mut mirror = [0.0; JOINTS_MAX];
        mirror[1] = f64::INFINITY;
        let cases = [
            (
                Exchange {
                    mirror,
                    ..exchange()
                },
                ImpossibleExchange::Mirror {
                    joint: 2,
                    value: f64::INFINITY,
                },
            ),
            (
                Exchange {
                    period_ns: 0,
                    ..exchange()
                },
                ImpossibleExchange::Period(0),
            ),
            (
                Exchange {
                    period_ns: u64::MAX,
                    ..exchange()
                },
                ImpossibleExchange::Period(u64::MAX),
            ),
            (
                Exchange {
                    ticks: u64::MAX,
                    ..exchange()
                },
                ImpossibleExchange::Ticks(u64::MAX),
            ),
            (
                Exchange {
                    quality_permille: 1001,
                    ..exchange()
                },
                ImpossibleExchange::Quality(1001),
            ),
        ];
        for (exchange, expected) in cases {
            assert_eq!(ExchangeCheck::check(&exchange), Err(expected));
        }
    }
}
