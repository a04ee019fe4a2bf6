//! Timing records: late cycles, histograms, and the cost of primitives. Plain data of fixed size, written by the
//! real-time thread and read through boards.

use bytemuck::{Pod, Zeroable};

use crate::histogram::Histogram;

/// Number of rows for primitive types; a test ensures that the catalogue is not larger.
pub const PRIMITIVE_ROWS: usize = 256;

/// The cause of a late cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum LateCause {
    /// The cycle was not late.
    None = 0,
    /// Most of the lateness is wake-up latency: caused by the machine, not by a net.
    WokenLate = 1,
    /// Most of the lateness is computation time.
    ComputedLong = 2,
}

impl LateCause {
    /// All causes, in order of their numbers.
    pub const ALL: [(LateCause, &'static str); 3] = [
        (LateCause::None, "none"),
        (LateCause::WokenLate, "woken late"),
        (LateCause::ComputedLong, "computed long"),
    ];

    /// Returns the cause of a number that came from another process; unknown numbers are `None`.
    pub fn from_number(number: u32) -> LateCause {
        Self::ALL
            .get(number as usize)
            .map_or(LateCause::None, |row| row.0)
    }

    /// Returns the cause of a late cycle that woke `wake_ns` after its deadline and then computed for `exec_ns`.
    pub fn of(wake_ns: u64, exec_ns: u64) -> LateCause {
        if exec_ns > wake_ns {
            LateCause::ComputedLong
        } else {
            LateCause::WokenLate
        }
    }

    /// Returns the display name.
    pub fn name(self) -> &'static str {
        Self::ALL.get(self as usize).map_or("none", |row| row.1)
    }
}

/// One late cycle.
#[derive(Clone, Copy, Debug, Pod, Zeroable, PartialEq, Eq)]
#[repr(C)]
pub struct LateCycle {
    /// Cycle number, 0 = no late cycle.
    pub cycle: u64,
    /// Wake-up latency after the deadline, ns.
    pub wake_ns: u64,
    /// Computation time, ns.
    pub exec_ns: u64,
    /// Number of skipped periods.
    pub skipped_periods: u64,
    /// Id of the command with the longest computation in the cycle, 0 = no command ran.
    pub command: u64,
    /// Its computation time, ns.
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

/// The sampled cost of one primitive type: in each cycle one run of equal primitives of one net is timed, in rotation
/// over all runs, so that the sums of the rows are in proportion to the total costs of their types. (With nets at
/// different rates, nets with a low rate are timed less often, but not exactly in proportion to their rates.)
#[derive(Clone, Copy, Debug, Pod, Zeroable, PartialEq, Eq)]
#[repr(C)]
pub struct PrimitiveTime {
    /// Number of timed runs.
    pub runs: u64,
    /// Number of primitives in these runs.
    pub primitives: u64,
    /// Total time, ns, without the cost of the two clock readings.
    pub sum_ns: u64,
    /// The longest run, ns.
    pub max_ns: u64,
}

/// Executor → all processes: histograms and the cost of primitives, since the last acknowledgement or the start;
/// written about ten times per second.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct CycleTiming {
    /// [`crate::message::MAGIC`].
    pub magic: u64,
    /// [`crate::primitives::fingerprint`] of the catalogue that the rows refer to.
    pub catalogue: u64,
    /// Cycle at which it was written.
    pub cycle: u64,
    /// Cycle of the last acknowledgement, 0 = none yet.
    pub acknowledged_cycle: u64,
    /// Wake-up latency after the deadline.
    pub wake: Histogram,
    /// Time from the wake-up until all outputs are written.
    pub exec: Histogram,
    /// Time from one wake-up to the next.
    pub length: Histogram,
    /// Wake-up latencies from the start to the last acknowledgement.
    pub wake_acknowledged: Histogram,
    /// Computation times from the start to the last acknowledgement.
    pub exec_acknowledged: Histogram,
    /// Cost by index in the catalogue.
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
    fn the_cause_is_the_larger_part_of_the_lateness() {
        assert_eq!(LateCause::of(900, 200), LateCause::WokenLate);
        assert_eq!(LateCause::of(200, 900), LateCause::ComputedLong);
        assert_eq!(LateCause::of(500, 500), LateCause::WokenLate);
    }

    #[test]
    fn every_cause_round_trips_through_its_number() {
        for (cause, _) in LateCause::ALL {
            assert_eq!(LateCause::from_number(cause as u32), cause);
        }
        assert_eq!(LateCause::from_number(99), LateCause::None);
    }
}
