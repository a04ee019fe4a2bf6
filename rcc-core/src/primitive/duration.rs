//! Durations measured in evaluated cycles: exact however long they are, because no rounded periods are summed. Run by
//! the real-time thread.

/// Part of a period that may be missing for a time to count as reached: larger than the rounding of products of
/// seconds.
const TOLERANCE: f64 = 1e-6;

/// Returns true if `cycles` periods of `dt_s` are at least `time_s`, to within a millionth of a period. A null time is
/// never reached.
#[inline(always)]
pub fn reached(cycles: i64, dt_s: f64, time_s: f64) -> bool {
    (cycles as f64 + TOLERANCE) * dt_s >= time_s
}

/// Returns `cycles` periods as a time, s, limited to `time_s`.
#[inline(always)]
pub fn elapsed(cycles: i64, dt_s: f64, time_s: f64) -> f64 {
    let passed = cycles as f64 * dt_s;
    if passed > time_s { time_s } else { passed }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_is_reached_in_its_cycle_whatever_the_rounding_of_the_period() {
        for dt_s in [125e-6, 1e-3, 3e-3, 1.0 / 3.0, 0.02] {
            for cycles in [0_i64, 1, 3, 7, 100, 3_600_000, 1 << 30] {
                // As a user writes it, and as a division or a sum of literals may round it.
                let time_s = cycles as f64 * dt_s;
                for time_s in [time_s, time_s * (1.0 + 2e-16), time_s * (1.0 - 2e-16)] {
                    assert!(reached(cycles, dt_s, time_s), "{cycles} · {dt_s}");
                    assert!(
                        cycles == 0 || !reached(cycles - 1, dt_s, time_s),
                        "{cycles} · {dt_s}"
                    );
                }
            }
        }
        assert!(!reached(5, 1e-3, f64::NAN));
    }
}
