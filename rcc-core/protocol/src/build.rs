//! Identity of a build: the version and the layout of everything in shared memory. Processes announce it, so that
//! processes of different builds refuse each other with a message. Built at start-up; compared by threads that are not
//! real-time.

use std::fmt;

use rcc_core::fnv;
use rcc_core::helper::{HelperEntry, HelperTable};
use rcc_core::message::{
    ANALOG_MAX, ClockStatus, CommandEntry, CommandHead, CycleStatus, DIGITAL_MAX, DeviceEntry,
    FaultRecord, JOINTS_MAX, MAGIC, MONITOR_WIDTH_MAX, Measurement, MonitorRecord, SET_POINTS,
    SetPoint, Tables,
};
use rcc_core::timing::{CycleTiming, LateCycle, PrimitiveTime};

/// Remedy for a mismatch of builds.
pub const REMEDY: &str = "install all programs from one build, and restart the cell";

/// A build, as far as processes compare it.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Build {
    /// Version of the programs.
    pub version: String,
    /// Fingerprint of the layout of everything in shared memory.
    #[serde(with = "crate::hexadecimal")]
    pub layout: u64,
}

impl Build {
    /// Returns the build of this process.
    #[must_use]
    pub fn own() -> Build {
        Build {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            layout: LAYOUT,
        }
    }
}

/// `0.1.0, layout 0123456789abcdef`.
impl fmt::Display for Build {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, layout {:016x}", self.version, self.layout)
    }
}

/// Describes a build, or the absence of an announced one.
pub(crate) fn describe(build: Option<&Build>) -> String {
    build.map_or_else(
        || "an older one that does not announce it".to_owned(),
        Build::to_string,
    )
}

/// Fingerprint of sizes and alignments. It does not detect two fields of the same size that swap places, so [`MAGIC`]
/// must be changed together with the layout; it is part of the fingerprint.
macro_rules! layout {
    ($($shared:ty),* $(,)?) => {
        fingerprint(&[
            MAGIC,
            JOINTS_MAX as u64,
            DIGITAL_MAX as u64,
            ANALOG_MAX as u64,
            SET_POINTS as u64,
            MONITOR_WIDTH_MAX as u64,
            $(size_of::<$shared>() as u64, align_of::<$shared>() as u64,)*
        ])
    };
}

/// Layout fingerprint of this build.
const LAYOUT: u64 = layout![
    Measurement,
    SetPoint,
    CommandHead,
    CycleStatus,
    ClockStatus,
    Tables,
    CommandEntry,
    DeviceEntry,
    FaultRecord,
    MonitorRecord,
    CycleTiming,
    PrimitiveTime,
    LateCycle,
    HelperTable,
    HelperEntry,
];

/// Hash of the numbers in little-endian byte order.
const fn fingerprint(mut numbers: &[u64]) -> u64 {
    let mut hash = fnv::EMPTY;
    while let [number, rest @ ..] = numbers {
        hash = fnv::add(hash, &number.to_le_bytes());
        numbers = rest;
    }
    hash
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fingerprint_is_fnv_and_sees_each_number_and_their_order() {
        // FNV-1a over the same bytes.
        let text = u64::from_le_bytes(*b"rcc-v006");
        let mut expected = 0xcbf2_9ce4_8422_2325_u64;
        for byte in b"rcc-v006" {
            expected = (expected ^ u64::from(*byte)).wrapping_mul(0x100_0000_01b3);
        }
        assert_eq!(fingerprint(&[text]), expected);
        let all = [[1, 2, 3], [3, 2, 1], [1, 2, 4], [1 << 56, 2, 3]];
        let mut hashes: Vec<u64> = all.iter().map(|one| fingerprint(one)).collect();
        hashes.push(fingerprint(&[1, 2]));
        hashes.sort_unstable();
        hashes.dedup();
        assert_eq!(hashes.len(), 5);
    }
}
