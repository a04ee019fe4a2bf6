//! The configuration that a process announces, so that other processes notice a different one. Written at start-up;
//! compared by threads that are not real-time.

use std::collections::BTreeMap;

/// A configuration, as far as processes compare it.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Configuration {
    /// Path of the file.
    pub file: String,
    /// Fingerprint of everything that plans depend on.
    #[serde(with = "crate::hexadecimal")]
    pub cell: u64,
    /// The devices that the process knows, in the order of the file; a driver lists only its own.
    pub devices: Vec<DeviceFingerprints>,
}

/// Fingerprints of the configuration of one device.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct DeviceFingerprints {
    /// Name of the device.
    pub name: String,
    /// Fingerprint (16 hexadecimal digits) of each part of the configuration.
    pub parts: BTreeMap<String, String>,
}

/// Result of `CellConfig::identity`: file, fingerprint of the cell, names of the parts, and one fingerprint per part of
/// each device.
type Identity<'a, const PARTS: usize> =
    (String, u64, [&'a str; PARTS], Vec<(String, [u64; PARTS])>);

impl Configuration {
    /// Builds the announced form of `CellConfig::identity`.
    #[must_use]
    pub fn new<const PARTS: usize>(
        (file, cell, names, devices): Identity<'_, PARTS>,
    ) -> Configuration {
        let parts = |values: [u64; PARTS]| {
            let named = names.into_iter().zip(values);
            named
                .map(|(name, value)| (name.to_owned(), format!("{value:016x}")))
                .collect()
        };
        let row = |(name, values)| DeviceFingerprints {
            name,
            parts: parts(values),
        };
        Configuration {
            file,
            cell,
            devices: devices.into_iter().map(row).collect(),
        }
    }

    /// Keeps only this device, as its driver announces it.
    #[must_use]
    pub fn only(mut self, device: &str) -> Configuration {
        self.devices.retain(|one| one.name == device);
        self
    }

    /// Returns the parts of `device` that differ; empty if they agree.
    #[must_use]
    pub fn device_differences(&self, other: &Configuration, device: &str) -> Vec<String> {
        let parts = |configuration: &Configuration| {
            let mut devices = configuration.devices.iter();
            devices
                .find(|one| one.name == device)
                .map(|one| one.parts.clone())
        };
        let (Some(here), Some(there)) = (parts(self), parts(other)) else {
            return vec![format!("device {device} is missing in one of them")];
        };
        let keys = here
            .keys()
            .chain(there.keys().filter(|key| !here.contains_key(*key)));
        keys.filter(|key| here.get(*key) != there.get(*key))
            .cloned()
            .collect()
    }

    /// Returns all differences; empty if both agree in everything, including the order of the devices.
    #[must_use]
    pub fn differences(&self, other: &Configuration) -> Vec<String> {
        if self.cell == other.cell && self.devices == other.devices {
            return Vec::new();
        }
        let names = |configuration: &Configuration| -> Vec<String> {
            let devices = configuration.devices.iter();
            devices.map(|one| one.name.clone()).collect()
        };
        let (here, there) = (names(self), names(other));
        let mut words = Vec::new();
        for name in here
            .iter()
            .chain(there.iter().filter(|name| !here.contains(name)))
        {
            match (here.contains(name), there.contains(name)) {
                (true, true) => {
                    let parts = self.device_differences(other, name);
                    if !parts.is_empty() {
                        words.push(format!("{name}: {}", parts.join(", ")));
                    }
                }
                _ => words.push(format!("device {name}")),
            }
        }
        if words.is_empty() {
            let order = here != there;
            words.push(if order { "order of devices" } else { "period" }.to_owned());
        }
        words
    }
}

/// Formats that the files of a configuration are not in force: `differs` lists the differences, `fault` is the first
/// fault of files with which no process could be started.
#[must_use]
pub fn changed(differs: &str, fault: Option<&str>) -> String {
    match (differs, fault) {
        (_, Some(fault)) => format!(
            "the configuration files are no longer valid ({fault}); the cell continues with the configuration that it was \
             started with, but a process that dies now cannot be restarted: correct the files"
        ),
        ("", None) => "the configuration files match the running configuration again".to_owned(),
        (differs, None) => format!(
            "the configuration files have changed ({differs}), but the change is not in force: restart the cell; a process \
             that is restarted alone reads the new files, and the others refuse to work with it"
        ),
    }
}
