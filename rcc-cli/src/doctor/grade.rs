//! Grades A to D from the measured wake-up latency, and what each grade allows. Pure.
//!
//! The bounds are parts of the period, because a cycle must end before the next one starts. At half a period our
//! simulated controller also stops rating a connection as perfect. The demo's drivers bridge ten periods by their
//! delay, hence [`PERIODS_C`].

use std::fmt;

use serde::{Deserialize, Serialize};

use super::measure::WakeUpMeasurement;

/// A: the longest latency is at most this part of the period, percent.
pub const PERCENT_A: u64 = 10;
/// B: the longest latency is at most this part of the period, percent.
pub const PERCENT_B: u64 = 50;
/// C: 99.9 % of the wake-ups are within [`PERCENT_B`], and none is later than this number of periods.
pub const PERIODS_C: u64 = 10;
/// Shortest `stale_after` for A and B, in periods.
pub const STALE_PERIODS: u64 = 3;
/// Default of `stale_after`, ns.
pub const STALE_DEFAULT_NS: u64 = 50_000_000;
/// Least number of wake-ups for A or B.
pub const CYCLES_MIN: u64 = 1000;

/// Punctuality of the machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Grade {
    /// Hard real time at this period, with reserve for nets.
    A,
    /// No cycle is missed; nets may use half of the period.
    B,
    /// Cycles are missed occasionally; drivers bridge them.
    C,
    /// Suitable for simulation only.
    D,
}

impl fmt::Display for Grade {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{self:?}")
    }
}

impl Grade {
    /// Grades a measurement. Without SCHED_FIFO the best grade is C, because any other program may preempt it.
    #[must_use]
    pub fn of(measured: &WakeUpMeasurement) -> Grade {
        let part = |percent| measured.period_ns * percent / 100;
        let trusted = measured.priority.is_some() && measured.cycles >= CYCLES_MIN;
        if measured.cycles == 0 {
            Grade::D
        } else if trusted && measured.max_ns <= part(PERCENT_A) {
            Grade::A
        } else if trusted && measured.max_ns <= part(PERCENT_B) {
            Grade::B
        } else if measured.p999_ns <= part(PERCENT_B)
            && measured.max_ns <= measured.period_ns * PERIODS_C
        {
            Grade::C
        } else {
            Grade::D
        }
    }

    /// Describes what the grade is suitable for.
    #[must_use]
    pub fn suitable_for(self) -> &'static str {
        match self {
            Grade::A => "a real robot at this period",
            Grade::B => "a real robot at this period, with nets that need less than half of it",
            Grade::C => {
                "simulation, slow I/O, a robot whose driver bridges missed cycles (`delay` above the longest wake-up)"
            }
            Grade::D => "simulation and I/O only",
        }
    }

    /// Returns the shortest `stale_after` that tolerates the measured lateness, ns: 3 periods for A and B; otherwise
    /// twice the longest latency in whole milliseconds, but at least 5 periods.
    #[must_use]
    pub fn stale_after_ns(self, max_ns: u64, period_ns: u64) -> u64 {
        match self {
            Grade::A | Grade::B => STALE_PERIODS * period_ns,
            Grade::C | Grade::D => (2 * max_ns)
                .div_ceil(1_000_000)
                .saturating_mul(1_000_000)
                .max(5 * period_ns),
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(crate) fn measured(p999_us: u64, max_us: u64) -> WakeUpMeasurement {
        WakeUpMeasurement {
            priority: Some(80),
            core: Some(1),
            period_ns: 1_000_000,
            cycles: 5000,
            min_ns: 2_000,
            p50_ns: 4_000,
            p99_ns: 9_000,
            p999_ns: p999_us * 1000,
            max_ns: max_us * 1000,
            missed: u64::from(max_us >= 1000),
            preempted: 0,
            histogram: Vec::new(),
            drawing: String::new(),
        }
    }

    #[test]
    fn the_longest_wake_up_decides_about_a_and_b_and_the_rare_ones_about_c() {
        for (p999_us, max_us, grade) in [
            (21, 38, Grade::A),
            (90, 100, Grade::A),
            (90, 101, Grade::B),
            (400, 500, Grade::B),
            (400, 501, Grade::C),
            (500, 10_000, Grade::C),
            (501, 600, Grade::D),
            (90, 10_001, Grade::D),
        ] {
            assert_eq!(
                Grade::of(&measured(p999_us, max_us)),
                grade,
                "{p999_us} {max_us}"
            );
        }
    }

    #[test]
    fn without_fifo_or_with_too_few_wake_ups_it_is_c_at_best() {
        let mut ordinary = measured(20, 30);
        ordinary.priority = None;
        assert_eq!(Grade::of(&ordinary), Grade::C);
        let mut short = measured(20, 30);
        short.cycles = CYCLES_MIN - 1;
        assert_eq!(Grade::of(&short), Grade::C);
        short.cycles = 0;
        assert_eq!(Grade::of(&short), Grade::D);
    }

    #[test]
    fn stale_after_exceeds_the_measured_latency() {
        let ms = 1_000_000;
        assert_eq!(Grade::A.stale_after_ns(38_000, ms), 3 * ms);
        assert_eq!(Grade::B.stale_after_ns(480_000, ms), 3 * ms);
        assert_eq!(Grade::C.stale_after_ns(700_000, ms), 5 * ms);
        assert_eq!(Grade::C.stale_after_ns(9_100_000, ms), 19 * ms);
        assert_eq!(Grade::D.stale_after_ns(40_000_000, ms), 80 * ms);
    }
}
