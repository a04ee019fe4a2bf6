//! The one clock of a cell, CLOCK_MONOTONIC in nanoseconds, equal in every process of the machine, and the sleep by it.
//! Run by any thread, real-time ones included (reading it: vDSO, no system call on the usual machines).

use std::time::Duration;

use nix::sys::time::TimeSpec;
use nix::time::{ClockId, ClockNanosleepFlags, clock_gettime, clock_nanosleep};

/// Nanoseconds of CLOCK_MONOTONIC (since boot, without time asleep); the same for all processes of the machine.
///
/// It cannot fail: the kernel refuses only clocks it does not know, and this one is mandatory (POSIX).
#[must_use]
pub fn monotonic_ns() -> u64 {
    match clock_gettime(ClockId::CLOCK_MONOTONIC) {
        Ok(time) => {
            // Never negative: the clock starts at boot.
            (time.tv_sec() as u64)
                .wrapping_mul(1_000_000_000)
                .wrapping_add(time.tv_nsec() as u64)
        }
        Err(_) => 0,
    }
}

/// Sleeps until a time of [`monotonic_ns`]: the executor's one sleep, and that of whoever measures what it would meet. An
/// interruption by a signal is slept through.
pub fn sleep_until(deadline_ns: u64) {
    let deadline = TimeSpec::from_duration(Duration::from_nanos(deadline_ns));
    while clock_nanosleep(
        ClockId::CLOCK_MONOTONIC,
        ClockNanosleepFlags::TIMER_ABSTIME,
        &deadline,
    )
    .is_err()
    {}
}

#[cfg(test)]
mod tests {
    #[test]
    fn never_goes_back() {
        let times: Vec<u64> = (0..1000).map(|_| super::monotonic_ns()).collect();
        assert!(times.is_sorted() && times[0] > 0);
    }
}
