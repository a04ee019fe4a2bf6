//! Reads a driver's settings key by key, so that each error names its key, and rejects unknown keys.
//! Used once, when a driver is opened.

use std::net::SocketAddr;
use std::time::Duration;

use rcc_config::{DeviceConfig, quantity};
use rcc_core::unit::Unit;
use serde_json::Value;

use super::DriverError;

/// The settings of one device, and the keys that have been read.
#[derive(Debug)]
pub struct Settings<'a> {
    device: &'a DeviceConfig,
    known: Vec<&'static str>,
}

impl<'a> Settings<'a> {
    /// Returns the settings of `device`.
    #[must_use]
    pub fn of(device: &'a DeviceConfig) -> Self {
        Self {
            device,
            known: Vec::new(),
        }
    }

    /// Returns the value of `key`, converted by `read`, or `default` if the key is missing.
    ///
    /// # Errors
    /// Returns an error if the key is missing and has no default, or if `read` refuses the value; the error contains
    /// `expected`.
    pub fn read<T>(
        &mut self,
        key: &'static str,
        expected: &'static str,
        default: Option<T>,
        read: impl FnOnce(&Value) -> Option<T>,
    ) -> Result<T, DriverError> {
        self.known.push(key);
        let found = self
            .device
            .settings
            .get(key)
            .filter(|value| !value.is_null());
        let fault = |cause| DriverError::Setting {
            device: self.device.name.clone(),
            key: key.to_owned(),
            cause,
            expected,
        };
        match (found, default) {
            (Some(value), _) => read(value).ok_or_else(|| fault(format!("invalid value {value}"))),
            (None, Some(default)) => Ok(default),
            (None, None) => Err(fault("is missing".to_owned())),
        }
    }

    /// Reads an address such as `127.0.0.1:49938`.
    ///
    /// # Errors
    /// See [`Settings::read`].
    pub fn address(
        &mut self,
        key: &'static str,
        default: Option<SocketAddr>,
    ) -> Result<SocketAddr, DriverError> {
        let expected = "an address with a port, such as \"127.0.0.1:49938\"";
        self.read(key, expected, default, |value| value.as_str()?.parse().ok())
    }

    /// Reads a duration such as `20 ms`, greater than 0.
    ///
    /// # Errors
    /// See [`Settings::read`].
    pub fn duration(
        &mut self,
        key: &'static str,
        default: Duration,
    ) -> Result<Duration, DriverError> {
        let expected = "a time with its unit, such as \"20 ms\"";
        self.read(key, expected, Some(default), |value| {
            duration(value.as_str()?)
        })
    }

    /// Reads one of a fixed set of words.
    ///
    /// # Errors
    /// See [`Settings::read`].
    pub fn word<T: Copy>(
        &mut self,
        key: &'static str,
        expected: &'static str,
        default: T,
        words: &[(&str, T)],
    ) -> Result<T, DriverError> {
        self.read(key, expected, Some(default), |value| {
            let text = value.as_str()?;
            words
                .iter()
                .find(|(word, _)| *word == text)
                .map(|row| row.1)
        })
    }

    /// Checks that no key is left; call it after all settings have been read.
    ///
    /// # Errors
    /// Returns an error for a key that has not been read.
    pub fn finish(self) -> Result<(), DriverError> {
        let Some(object) = self.device.settings.as_object() else {
            return Ok(());
        };
        match object
            .keys()
            .find(|key| !self.known.contains(&key.as_str()))
        {
            None => Ok(()),
            Some(key) => Err(DriverError::UnknownSetting {
                device: self.device.name.clone(),
                key: key.clone(),
                known: self.known.join(", "),
            }),
        }
    }
}

/// Parses a duration such as `20 ms`; at most one hour.
fn duration(text: &str) -> Option<Duration> {
    let quantity = quantity::parse(text).ok()?;
    let seconds = quantity.value;
    (quantity.unit == Some(Unit::SECOND) && seconds > 0.0 && seconds <= 3600.0)
        .then(|| Duration::from_secs_f64(seconds))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_duration_needs_its_unit() {
        assert_eq!(duration("20 ms"), Some(Duration::from_millis(20)));
        assert_eq!(duration("1.5 s"), Some(Duration::from_millis(1500)));
        for bad in ["20", "20 m", "-1 s", "NaN s", "ms", "1e9 s"] {
            assert_eq!(duration(bad), None, "{bad}");
        }
    }
}
