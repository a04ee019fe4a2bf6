//! Fingerprints of a configuration, by which the processes of a cell detect that they were started with different ones.
//! Computed once at start-up; pure functions.

use rcc_core::fnv;
use rcc_core::kinematics::Arm;
use rcc_core::pose::Pose;

use crate::cell::CellConfig;
use crate::device::{CHANNEL_KINDS, ChannelConfig, DeviceConfig, OnRelease, kind_name};
use crate::driver::DriverConfig;
use crate::robot::RobotConfig;

/// The parts of a device's configuration that have a fingerprint each, in the order in which they are announced.
pub const PARTS: [&str; 5] = ["driver", "timing", "robot", "settings", "channels"];

/// One fingerprint for each of [`PARTS`].
pub type PartFingerprints = [u64; PARTS.len()];

/// The identity that a process announces of its configuration: file, [`CellConfig::fingerprint`], [`PARTS`] and
/// [`CellConfig::device_fingerprints`].
pub type CellIdentity = (
    String,
    u64,
    [&'static str; PARTS.len()],
    Vec<(String, PartFingerprints)>,
);

impl CellConfig {
    /// Returns a hash (FNV-1a, 64 bits) of everything that a plan depends on: the period; the devices in their order
    /// with name, kinematics, joints and limits; the channels in their order with kind, name and unit. Ports, drivers,
    /// settings, scales and the formatting of the file do not count.
    #[must_use]
    pub fn fingerprint(&self) -> u64 {
        let mut hash = Fnv::default();
        hash.number(self.period_ns);
        hash.number(self.devices.len() as u64);
        for device in &self.devices {
            hash.text(&device.name);
            hash.kinematics(device);
            hash.number(device.channels.len() as u64);
            for channel in &device.channels {
                hash.channel(channel);
            }
        }
        hash.0
    }

    /// Returns the devices in their order, each with fingerprints of everything that its driver and the other processes
    /// of the cell must agree on. In addition to [`CellConfig::fingerprint`] they cover how the device is reached:
    /// driver, addresses, scales, settings, actions on release, and times. Comments, paths of files and the order of
    /// settings do not count. The position of a device in the cell does not count either: drivers are found by name,
    /// and processes that use device indices compare the order of this list.
    #[must_use]
    pub fn device_fingerprints(&self) -> Vec<(String, PartFingerprints)> {
        let devices = self.devices.iter().enumerate();
        devices
            .map(|(index, device)| (device.name.clone(), self.parts(index, device)))
            .collect()
    }

    /// Returns the identity by which other processes distinguish this configuration from another one.
    #[must_use]
    pub fn identity(&self) -> CellIdentity {
        let file = self.source.display().to_string();
        (file, self.fingerprint(), PARTS, self.device_fingerprints())
    }

    fn parts(&self, index: usize, device: &DeviceConfig) -> PartFingerprints {
        // `None`: the executor's clock does not follow this device.
        let leads = self.clock.filter(|clock| clock.device == index);
        let of = |part: &dyn Fn(&mut Fnv)| {
            let mut hash = Fnv::default();
            hash.text(&device.name);
            part(&mut hash);
            hash.0
        };
        [
            of(&|hash| hash.driver(&device.driver)),
            of(&|hash| {
                hash.number(self.period_ns);
                hash.number(device.command_timeout_ns);
                hash.number(device.delay_ns);
                hash.number(u64::from(leads.is_some()));
                hash.number(leads.map_or(0, |clock| clock.offset_ns));
            }),
            of(&|hash| hash.kinematics(device)),
            of(&|hash| hash.json(&device.settings)),
            of(&|hash| {
                hash.number(device.channels.len() as u64);
                // A channel is identified by its index among those of its kind, wherever it is in the file.
                for channel in CHANNEL_KINDS
                    .iter()
                    .flat_map(|kind| device.channels_of(*kind))
                {
                    hash.channel(channel);
                    hash.wire(channel);
                }
            }),
        ]
    }
}

/// A hash under construction.
struct Fnv(u64);

impl Default for Fnv {
    fn default() -> Self {
        Fnv(fnv::EMPTY)
    }
}

impl Fnv {
    fn bytes(&mut self, bytes: impl IntoIterator<Item = u8>) {
        for byte in bytes {
            self.0 = fnv::step(self.0, byte);
        }
    }

    fn number(&mut self, number: u64) {
        self.bytes(number.to_le_bytes());
    }

    fn reals(&mut self, values: impl IntoIterator<Item = f64>) {
        for value in values {
            self.number(value.to_bits());
        }
    }

    /// Hashes a text with a terminator, so that "ab", "c" and "a", "bc" differ.
    fn text(&mut self, text: &str) {
        self.bytes(text.bytes().chain([0]));
    }

    /// Hashes the arm of a device, its base and its workspace.
    fn kinematics(&mut self, device: &DeviceConfig) {
        self.number(device.first_tolerance_rad.to_bits());
        self.number(u64::from(device.robot.is_some()));
        if device.base != Pose::IDENTITY {
            self.text("base");
            self.reals(device.base.to_slots());
        }
        if let Some(space) = &device.workspace {
            self.text("workspace");
            self.reals(
                [space.lower, space.upper, space.point]
                    .into_iter()
                    .flatten(),
            );
            self.reals([space.singularity_min]);
        }
        if let Some(robot) = &device.robot {
            self.robot(robot);
        }
    }

    fn robot(&mut self, robot: &RobotConfig) {
        let (kind, parameters) = robot.arm.parameters();
        self.number(u64::from(kind));
        self.reals(parameters.into_iter().take(Arm::parameter_count(kind)));
        self.number(robot.joints.len() as u64);
        for joint in &robot.joints {
            self.text(&joint.name);
            self.reals([
                joint.lower_rad,
                joint.upper_rad,
                joint.velocity_rad_s,
                joint.acceleration_rad_s2,
                joint.jerk_rad_s3,
            ]);
        }
        if let Some(limits) = &robot.impedance {
            self.text("impedance");
            self.reals(limits.to_slots());
        }
    }

    /// Hashes what a plan knows about a channel.
    fn channel(&mut self, channel: &ChannelConfig) {
        self.text(&channel.name);
        self.text(kind_name(channel.kind));
        self.number(u64::from(channel.index));
        self.bytes(channel.unit.exponents.map(|power| power.to_le_bytes()[0]));
        let [lower, upper] = channel.range.unwrap_or([f64::NAN; 2]);
        self.reals([lower, upper]);
    }

    fn driver(&mut self, driver: &DriverConfig) {
        self.text(&driver.to_string());
        if let DriverConfig::Program(program) = driver {
            self.number(program.arguments.len() as u64);
            program.arguments.iter().for_each(|one| self.text(one));
        }
    }

    /// Hashes what only the driver uses of a channel.
    fn wire(&mut self, channel: &ChannelConfig) {
        self.json(&channel.address);
        self.reals([channel.scale, channel.offset]);
        match channel.on_release {
            None => self.number(0),
            Some(OnRelease::Hold) => self.number(1),
            Some(OnRelease::Safe(value)) => {
                self.number(2);
                self.reals([value]);
            }
        }
    }

    /// Hashes a value with its type; an object sorted by keys, because the order of settings has no meaning.
    fn json(&mut self, value: &serde_json::Value) {
        use serde_json::Value as Json;
        match value {
            Json::Array(list) => {
                self.text("list");
                self.number(list.len() as u64);
                list.iter().for_each(|one| self.json(one));
            }
            Json::Object(map) => {
                self.text("map");
                self.number(map.len() as u64);
                let mut entries: Vec<_> = map.iter().collect();
                entries.sort_by_key(|(key, _)| key.as_str());
                for (key, one) in entries {
                    self.text(key);
                    self.json(one);
                }
            }
            Json::String(text) => {
                self.text("text");
                self.text(text);
            }
            // Null, booleans and numbers have distinct textual forms.
            plain => self.text(&plain.to_string()),
        }
    }
}
