//! The outputs of a device: the commanded values, or those of each channel's `on_release` without a command.
//! Pure; run by the host's thread, once per exchange.

use rcc_config::{DeviceConfig, OnRelease};
use rcc_core::message::{ANALOG_MAX, DIGITAL_MAX, SetPoint};
use rcc_core::primitive::ChannelKind;

use crate::driver::Outputs;

/// Configuration of one output.
#[derive(Clone, Copy, Debug)]
struct OutputRule {
    on_release: OnRelease,
    range: Option<[f64; 2]>,
}

/// The outputs of one device with their release rules.
#[derive(Clone, Debug)]
pub struct OutputRelease {
    digital: Vec<OutputRule>,
    analog: Vec<OutputRule>,
    values: Outputs,
    /// Bit i: analog output i is commanded outside its range.
    out_of_range: u64,
    /// Outputs that were commanded in cycles since the last exchange: digital, analog.
    passed: [u64; 2],
}

impl OutputRelease {
    /// The outputs of `device` before the first command: those with a safe value have it, those that hold have no value
    /// yet.
    #[must_use]
    pub fn new(device: &DeviceConfig) -> Self {
        let rules = |kind, most| -> Vec<OutputRule> {
            device
                .channels_of(kind)
                .take(most)
                .map(|channel| OutputRule {
                    // The configuration gives one for every output.
                    on_release: channel.on_release.unwrap_or(OnRelease::Safe(0.0)),
                    range: channel.range,
                })
                .collect()
        };
        let mut release = Self {
            digital: rules(ChannelKind::DigitalOutput, DIGITAL_MAX),
            analog: rules(ChannelKind::AnalogOutput, ANALOG_MAX),
            values: Outputs::NONE,
            out_of_range: 0,
            passed: [0; 2],
        };
        release.apply(&SetPoint::NONE);
        release
    }

    /// Applies the commanded outputs of `entry` and releases the others; ignores the joint positions.
    pub fn apply(&mut self, entry: &SetPoint) -> &Outputs {
        let [digital, analog] = std::mem::take(&mut self.passed);
        self.values.digital_commanded = digital;
        self.values.analog_commanded = analog;
        for (rule, index) in self.digital.iter().zip(0..) {
            let bit = 1_u64 << index;
            let value = match rule.on_release {
                _ if entry.digital_commanded & bit != 0 => {
                    self.values.digital_commanded |= bit;
                    entry.digital & bit != 0
                }
                OnRelease::Safe(value) => value != 0.0,
                OnRelease::Hold => continue,
            };
            self.values.digital_set |= bit;
            self.values.digital = (self.values.digital & !bit) | if value { bit } else { 0 };
        }
        self.out_of_range = 0;
        let places = self.values.analog.iter_mut().zip(entry.analog);
        for ((rule, (place, commanded)), index) in self.analog.iter().zip(places).zip(0..) {
            let [lower, upper] = rule.range.unwrap_or([f64::MIN, f64::MAX]);
            if commanded >= lower && commanded <= upper {
                *place = commanded;
                self.values.analog_commanded |= 1_u64 << index;
                continue;
            }
            self.out_of_range |= u64::from(!commanded.is_nan()) << index;
            if let OnRelease::Safe(value) = rule.on_release {
                *place = value;
            }
        }
        &self.values
    }

    /// Applies the commands of `entry` to the outputs that hold their value, for a cycle that is not exchanged itself.
    pub fn hold(&mut self, entry: &SetPoint) {
        for (rule, index) in self.digital.iter().zip(0..) {
            let bit = 1_u64 << index;
            if rule.on_release == OnRelease::Hold && entry.digital_commanded & bit != 0 {
                self.values.digital_set |= bit;
                self.values.digital = (self.values.digital & !bit) | (entry.digital & bit);
                self.passed[0] |= bit;
            }
        }
        let places = self.values.analog.iter_mut().zip(entry.analog);
        for ((rule, (place, commanded)), index) in self.analog.iter().zip(places).zip(0..) {
            let [lower, upper] = rule.range.unwrap_or([f64::MIN, f64::MAX]);
            if rule.on_release == OnRelease::Hold && commanded >= lower && commanded <= upper {
                *place = commanded;
                self.passed[1] |= 1_u64 << index;
            }
        }
    }

    /// Returns the present outputs.
    #[must_use]
    pub fn values(&self) -> &Outputs {
        &self.values
    }

    /// Bit i: analog output i is commanded outside its range, and therefore released.
    #[must_use]
    pub fn out_of_range(&self) -> u64 {
        self.out_of_range
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::conformance::device;

    /// Outputs: `safe` (off), `keeps` (holds), `speed` (0 to 0.5 m/s, safe value 0.1) and `level` (holds).
    fn release() -> OutputRelease {
        OutputRelease::new(&device(
            "none",
            serde_json::json!({}),
            &[
                (
                    "safe",
                    ChannelKind::DigitalOutput,
                    1.into(),
                    Some(OnRelease::Safe(0.0)),
                    None,
                ),
                (
                    "keeps",
                    ChannelKind::DigitalOutput,
                    2.into(),
                    Some(OnRelease::Hold),
                    None,
                ),
                (
                    "speed",
                    ChannelKind::AnalogOutput,
                    1.into(),
                    Some(OnRelease::Safe(0.1)),
                    Some([0.0, 0.5]),
                ),
                (
                    "level",
                    ChannelKind::AnalogOutput,
                    2.into(),
                    Some(OnRelease::Hold),
                    None,
                ),
            ],
        ))
    }

    fn commanded() -> SetPoint {
        let mut entry = SetPoint {
            digital: 0b11,
            digital_commanded: 0b11,
            ..SetPoint::NONE
        };
        (entry.analog[0], entry.analog[1]) = (0.3, 7.0);
        entry
    }

    #[test]
    fn before_the_first_command_outputs_are_safe_or_unset() {
        let release = release();
        let values = release.values();
        assert_eq!((values.digital, values.digital_set), (0, 0b01));
        assert_eq!(values.analog[0], 0.1);
        assert!(values.analog[1].is_nan());
    }

    #[test]
    fn a_released_channel_takes_its_safe_value_or_keeps_its_value() {
        let mut release = release();
        let values = *release.apply(&commanded());
        assert_eq!((values.digital, values.digital_set), (0b11, 0b11));
        assert_eq!(values.analog[..2], [0.3, 7.0]);
        let values = *release.apply(&SetPoint::NONE);
        assert_eq!((values.digital, values.digital_set), (0b10, 0b11));
        assert_eq!(values.analog[..2], [0.1, 7.0]);
    }

    #[test]
    fn what_a_net_commands_is_told_apart_from_what_is_held() {
        let mut release = release();
        let values = *release.apply(&commanded());
        assert_eq!(
            (values.digital_commanded, values.analog_commanded),
            (0b11, 0b11)
        );
        let values = *release.apply(&SetPoint::NONE);
        assert_eq!((values.digital_commanded, values.analog_commanded), (0, 0));
        // Commanded in a cycle that was not exchanged: the outputs that hold.
        release.hold(&commanded());
        let values = *release.apply(&SetPoint::NONE);
        assert_eq!(
            (values.digital_commanded, values.analog_commanded),
            (0b10, 0b10)
        );
        let values = *release.apply(&SetPoint::NONE);
        assert_eq!((values.digital_commanded, values.analog_commanded), (0, 0));
    }

    #[test]
    fn a_value_out_of_range_releases_its_channel_and_is_not_clamped() {
        for bad in [0.500_001, -1e-9, f64::INFINITY] {
            let mut release = release();
            let mut entry = commanded();
            release.apply(&entry);
            entry.analog[0] = bad;
            assert_eq!(release.apply(&entry).analog[0], 0.1);
            assert_eq!(release.out_of_range(), 1);
            release.apply(&commanded());
            assert_eq!(release.out_of_range(), 0);
        }
    }
}
