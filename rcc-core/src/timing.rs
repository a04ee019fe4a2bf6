//! Time, told honestly: the records about late cycles, the histograms and what primitives cost.
//! Plain data of fixed size, written by the real-time thread, read by anybody through boards.

use bytemuck::{Pod, Zeroable};

use crate::histogram::Histogram;

/// Rows for primitive types; the catalogue has fewer (by test).
pub const PRIMITIVE_ROWS: usize = 256;

/// Why a cycle was late.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum LateCause {
    /// It was not.
    None = 0,
    /// The greater part of the lateness is the wake-up's: the machine, not a net.
    WokenLate = 1,
    /// The greater part is what it computed.
    ComputedLong = 2,
}

impl LateCause {
    /// All causes, in order of their numbers.
    pub const ALL: [(LateCause, &'static str); 3] = [
        (LateCause::None, "none"),
        (LateCause::WokenLate, "woken late"),
        (LateCause::ComputedLong, "computed long"),
    ];

    /// From a number that came from another process.
    pub fn from_number(number: u32) -> LateCause {
        Self::ALL
            .get(number as usize)
            .map_or(LateCause::None, |row| row.0)
    }

    /// The cause of a late cycle that woke so long after its deadline and then computed so long.
    pub fn of(wake_ns: u64, exec_ns: u64) -> LateCause {
        if exec_ns > wake_ns {
            LateCause::ComputedLong
        } else {
            LateCause::WokenLate
        }
    }

    /// As printed.
    pub fn name(self) -> &'static str {
        Self::ALL.get(self as usize).map_or("none", |row| row.1)
    }
}

/// One late cycle.
#[derive(Clone, Copy, Debug, Pod, Zeroable, PartialEq, Eq)]
#[repr(C)]
pub struct LateCycle {
    /// Its number, 0 = there was none.
    pub cycle: u64,
    /// How long after its deadline it woke, ns.
    pub wake_ns: u64,
    /// How long it computed, ns.
    pub exec_ns: u64,
    /// Periods that it skipped.
    pub skipped_periods: u64,
    /// Id of the command that computed longest in it, 0 = none ran.
    pub command: u64,
    /// How long that took, ns.
    pub command_ns: u64,
    /// [`LateCause`].
    pub cause: u32,
    /// Always 0.
    pub reserved: u32,
}

impl LateCycle {
    /// No late cycle.
    pub const NONE: LateCycle = LateCycle {
        cycle: 0,
        wake_ns: 0,
        exec_ns: 0,
        skipped_periods: 0,
        command: 0,
        command_ns: 0,
        cause: 0,
        reserved: 0,
    };
}

/// What the primitives of one type cost, sampled: in each cycle one run of equal primitives of one net is timed, all
/// of them in turn, so that the rows' sums are in the ratio of what their types cost altogether. (Of nets at different
/// rates those that run seldom are timed seldom, but not exactly in the ratio of their rates.)
#[derive(Clone, Copy, Debug, Pod, Zeroable, PartialEq, Eq)]
#[repr(C)]
pub struct PrimitiveTime {
    /// Runs that were timed.
    pub runs: u64,
    /// Primitives in them.
    pub primitives: u64,
    /// Their time together, ns, without what the two looks at the clock cost.
    pub sum_ns: u64,
    /// The longest run, ns.
    pub max_ns: u64,
}

/// Executor → everybody: histograms and what primitives cost, since the last acknowledgement or the start; written about
/// ten times a second.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct Timing {
    /// [`crate::message::MAGIC`].
    pub magic: u64,
    /// [`crate::primitives::fingerprint`] of the catalogue that the rows refer to.
    pub catalogue: u64,
    /// Cycle at which it was written.
    pub cycle: u64,
    /// Cycle of the last acknowledgement, 0 = there was none.
    pub acknowledged_cycle: u64,
    /// Wake-up after the deadline.
    pub wake: Histogram,
    /// From the wake-up until everything is written.
    pub exec: Histogram,
    /// From one wake-up to the next.
    pub length: Histogram,
    /// By place in the catalogue.
    pub primitives: [PrimitiveTime; PRIMITIVE_ROWS],
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::primitives::CATALOGUE;

    #[test]
    fn every_primitive_has_a_row() {
        assert!(CATALOGUE.len() <= PRIMITIVE_ROWS);
    }

    #[test]
    fn the_cause_is_the_greater_part_of_the_lateness() {
        assert_eq!(LateCause::of(900, 200), LateCause::WokenLate);
        assert_eq!(LateCause::of(200, 900), LateCause::ComputedLong);
        assert_eq!(LateCause::of(500, 500), LateCause::WokenLate);
    }

    #[test]
    fn causes_have_their_numbers() {
        for (cause, _) in LateCause::ALL {
            assert_eq!(LateCause::from_number(cause as u32), cause);
        }
        assert_eq!(LateCause::from_number(99), LateCause::None);
    }
}
