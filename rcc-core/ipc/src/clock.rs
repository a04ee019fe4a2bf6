//! The one clock of a cell: CLOCK_MONOTONIC in nanoseconds, equal in every process of the machine.
//! Run by any thread, real-time ones included (vDSO, no system call on the usual machines).

use nix::time::{ClockId, clock_gettime};

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

#[cfg(test)]
mod tests {
    #[test]
    fn never_goes_back() {
        let times: Vec<u64> = (0..1000).map(|_| super::monotonic_ns()).collect();
        assert!(times.is_sorted() && times[0] > 0);
    }
}
