//! Of which build a process is: its version, and the layout of what it shares with other processes. Announced, so that
//! processes of different builds refuse each other with words. Made at start, compared by threads that are not real-time.

use std::fmt;

use rcc_core::helper::{HelperEntry, HelperTable};
use rcc_core::message::{
    ANALOG_MAX, ClockStatus, CommandEntry, CommandHead, CycleStatus, DIGITAL_MAX, DeviceEntry,
    FaultRecord, JOINTS_MAX, MAGIC, MONITOR_WIDTH_MAX, Measurement, MonitorRecord, SET_POINTS,
    SetPoint, Tables,
};
use rcc_core::timing::{CycleTiming, LateCycle, PrimitiveTime};

use crate::announce::Announcement;

/// What helps processes of different builds.
pub const REMEDY: &str = "install all programs from one build, and restart the cell";

/// A build as far as processes compare it.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Build {
    /// Version of the programs.
    pub version: String,
    /// Fingerprint of the layout of everything in shared memory.
    #[serde(with = "crate::announce::hexadecimal")]
    pub layout: u64,
}

impl Build {
    /// The build of this process.
    #[must_use]
    pub fn own() -> Build {
        Build {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            layout: LAYOUT,
        }
    }

    /// Checks, before anything of `other` is opened, that it means the same by what lies in shared memory.
    ///
    /// # Errors
    /// It has another layout, or announces none because it is of an older build.
    pub fn require_layout(other: &Announcement) -> Result<(), BuildMismatch> {
        match &other.build {
            Some(build) if build.layout == LAYOUT => Ok(()),
            theirs => Err(BuildMismatch {
                who: other.who(),
                theirs: words(theirs.as_ref()),
                own: Build::own().to_string(),
            }),
        }
    }
}

/// `0.1.0, layout 0123456789abcdef`.
impl fmt::Display for Build {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, layout {:016x}", self.version, self.layout)
    }
}

/// A build that was announced, or that none was.
pub(crate) fn words(build: Option<&Build>) -> String {
    build.map_or_else(
        || "an older one that does not announce it".to_owned(),
        Build::to_string,
    )
}

/// What another process shares has another layout than here.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the {who} was built from another version ({theirs}) than this program ({own}); {REMEDY}")]
pub struct BuildMismatch {
    /// The other process: `executor`, `driver io`.
    pub who: String,
    /// Its build.
    pub theirs: String,
    /// This process' build.
    pub own: String,
}

/// Fingerprint of sizes and alignments. It does not see that two fields of one size change places: [`MAGIC`] is changed
/// with the layout, and is part of it.
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

/// The layout of this build.
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

/// FNV-1a of these numbers, their lowest bytes first.
const fn fingerprint(numbers: &[u64]) -> u64 {
    let mut hash: u64 = 0xcbf2_9ce4_8422_2325;
    let mut number = 0;
    while number < numbers.len() {
        let mut byte = 0;
        while byte < 8 {
            hash ^= (numbers[number] >> (8 * byte)) & 0xff;
            hash = hash.wrapping_mul(0x0000_0100_0000_01b3);
            byte += 1;
        }
        number += 1;
    }
    hash
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fingerprint_is_fnv_and_sees_each_number_and_their_order() {
        // The same over bytes.
        let text = u64::from_le_bytes(*b"rcc-v004");
        let mut expected = 0xcbf2_9ce4_8422_2325_u64;
        for byte in b"rcc-v004" {
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
