//! Resources that a plan claims.

use serde::{Deserialize, Serialize};

use super::TOPICS_MAX;
use crate::message::DEVICES_MAX;

/// The unique resources that a net claims.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Resources {
    /// Bit d: the arm of device d.
    pub arms: u64,
    /// By device, bit c: digital output c.
    pub digital: [u64; DEVICES_MAX],
    /// By device, bit c: analog output c.
    pub analog: [u64; DEVICES_MAX],
    /// Keys of the published topics, ascending; 0 marks unused elements at the end.
    pub topics: [u64; TOPICS_MAX],
}

/// One unique resource.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Resource {
    /// The joints of a device.
    Arm {
        /// Device index.
        device: u32,
    },
    /// A digital output.
    Digital {
        /// Device index.
        device: u32,
        /// Channel index.
        channel: u32,
    },
    /// An analog output.
    Analog {
        /// Device index.
        device: u32,
        /// Channel index.
        channel: u32,
    },
    /// The right to publish a topic.
    Topic {
        /// [`Topic::key`](crate::topic::Topic::key).
        key: u64,
    },
}

impl Resources {
    /// No resources.
    pub const NONE: Resources = Resources {
        arms: 0,
        digital: [0; DEVICES_MAX],
        analog: [0; DEVICES_MAX],
        topics: [0; TOPICS_MAX],
    };

    /// Returns the first resource that both claim.
    pub fn common(&self, other: &Resources) -> Option<Resource> {
        let arms = self.arms & other.arms;
        if arms != 0 {
            return Some(Resource::Arm {
                device: arms.trailing_zeros(),
            });
        }
        let both = |mine: &[u64; DEVICES_MAX], theirs: &[u64; DEVICES_MAX]| {
            let pairs = mine.iter().zip(theirs).map(|(a, b)| a & b);
            pairs
                .zip(0u32..)
                .find(|(bits, _)| *bits != 0)
                .map(|(bits, device)| (device, bits.trailing_zeros()))
        };
        if let Some((device, channel)) = both(&self.digital, &other.digital) {
            return Some(Resource::Digital { device, channel });
        }
        if let Some((device, channel)) = both(&self.analog, &other.analog) {
            return Some(Resource::Analog { device, channel });
        }
        let mut topics = self.topics().iter();
        let key = topics.find(|key| other.publishes(**key))?;
        Some(Resource::Topic { key: *key })
    }

    /// Returns the keys of the published topics, ascending.
    fn topics(&self) -> &[u64] {
        let count = self.topics.partition_point(|key| *key != 0);
        self.topics.get(..count).unwrap_or(&[])
    }

    pub(super) fn publishes(&self, key: u64) -> bool {
        self.topics().binary_search(&key).is_ok()
    }

    /// Returns true if any resource of the device is claimed.
    pub fn uses(&self, device: usize) -> bool {
        let channels =
            |table: &[u64; DEVICES_MAX]| table.get(device).is_some_and(|bits| *bits != 0);
        self.arms >> device & 1 == 1 || channels(&self.digital) || channels(&self.analog)
    }

    /// Claims a resource; returns false if it was claimed already.
    pub(super) fn claim(&mut self, resource: Resource) -> bool {
        let (bits, bit) = match resource {
            Resource::Arm { device } => (Some(&mut self.arms), device),
            Resource::Digital { device, channel } => {
                (self.digital.get_mut(device as usize), channel)
            }
            Resource::Analog { device, channel } => (self.analog.get_mut(device as usize), channel),
            Resource::Topic { key } => return self.claim_topic(key),
        };
        match bits {
            Some(bits) if *bits >> bit & 1 == 0 => {
                *bits |= 1 << bit;
                true
            }
            _ => false,
        }
    }

    /// Claims a topic; keys must arrive in ascending order.
    fn claim_topic(&mut self, key: u64) -> bool {
        if self.publishes(key) {
            return false;
        }
        let free = self.topics.iter_mut().find(|place| **place == 0);
        free.map(|place| *place = key).is_some()
    }
}
