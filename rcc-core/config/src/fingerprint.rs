//! Fingerprints of a configuration: by them the processes of a cell notice that they were started with different ones.
//! Computed once at start-up; pure.

use rcc_core::pose::Pose;

use crate::cell::CellConfig;
use crate::device::{CHANNEL_KINDS, ChannelConfig, DeviceConfig, OnRelease, kind_name};
use crate::robot::RobotConfig;

/// The parts of a device's configuration that have a fingerprint each, in the order in which they are told.
pub const PARTS: [&str; 5] = ["driver", "timing", "robot", "settings", "channels"];

/// One fingerprint for each of [`PARTS`].
pub type PartFingerprints = [u64; PARTS.len()];

/// What a process announces of its configuration: its file, [`CellConfig::fingerprint`], [`PARTS`] and
/// [`CellConfig::device_fingerprints`].
pub type CellIdentity = (
    String,
    u64,
    [&'static str; PARTS.len()],
    Vec<(String, PartFingerprints)>,
);

impl CellConfig {
    /// A hash (FNV-1a, 64 bits) of everything that a plan depends on: the period; the devices in their order with name,
    /// kinematics, joints and limits; the channels in their order with kind, name and unit. Ports, drivers, settings,
    /// scales and the file's form do not count.
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

    /// The devices in their order, each with the fingerprints of all that its driver and everybody else in the cell must
    /// agree on. Other than [`CellConfig::fingerprint`] they contain how the device is reached: its driver, addresses,
    /// scales, settings, what becomes of outputs that nobody commands, and times. Comments, paths of files and the order
    /// of settings do not count. Nor does a device's place in the cell: drivers are found by name, and who counts
    /// devices compares the order of this list.
    #[must_use]
    pub fn device_fingerprints(&self) -> Vec<(String, PartFingerprints)> {
        let devices = self.devices.iter().enumerate();
        devices
            .map(|(index, device)| (device.name.clone(), self.parts(index, device)))
            .collect()
    }

    /// By what other processes tell this configuration from another one.
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
            of(&|hash| hash.text(&device.driver)),
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
                // A channel is told by its place among those of its kind, wherever the file has it.
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

/// FNV-1a, 64 bits (Fowler, Noll, Vo): stable across builds and machines, unlike the standard library's hashes.
struct Fnv(u64);

impl Default for Fnv {
    fn default() -> Self {
        Fnv(0xcbf2_9ce4_8422_2325)
    }
}

impl Fnv {
    fn bytes(&mut self, bytes: impl IntoIterator<Item = u8>) {
        for byte in bytes {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3);
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

    /// With its end, so that "ab", "c" and "a", "bc" differ.
    fn text(&mut self, text: &str) {
        self.bytes(text.bytes().chain([0]));
    }

    /// The arm of a device, where it stands and where it may be.
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
        self.reals(parameters);
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

    /// What a plan knows of a channel.
    fn channel(&mut self, channel: &ChannelConfig) {
        self.text(&channel.name);
        self.text(kind_name(channel.kind));
        self.number(u64::from(channel.index));
        self.bytes(channel.unit.exponents.map(|power| power.to_le_bytes()[0]));
        let [lower, upper] = channel.range.unwrap_or([f64::NAN; 2]);
        self.reals([lower, upper]);
    }

    /// What only its driver does with a channel.
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

    /// A value with its kind; an object by its keys, because settings mean the same in any order.
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
            // Null, true and numbers: no two of them are written alike.
            plain => self.text(&plain.to_string()),
        }
    }
}
