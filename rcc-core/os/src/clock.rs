//! The common clock of a cell: CLOCK_MONOTONIC in nanoseconds, equal in all processes of the machine, and sleeping on
//! it. Runs on any thread, also on real-time threads (a read goes through the vDSO: no system call on common machines).

use std::time::Duration;

use nix::sys::prctl;
use nix::sys::time::TimeSpec;
use nix::time::{ClockId, ClockNanosleepFlags, clock_gettime, clock_nanosleep};

/// Returns CLOCK_MONOTONIC in nanoseconds: time since boot without suspend, the same in all processes of the machine.
///
/// It cannot fail: the kernel refuses only unknown clocks, and POSIX requires this one.
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

/// Sleeps until an absolute time of [`monotonic_ns`]; resumes after an interruption by a signal. This is the one sleep
/// of the executor, and of programs that measure its latency.
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

/// Lets timed waits of this thread, and of threads that it starts from now on, end when their time is over. By default Linux
/// ends them up to 50 µs later, to serve several at once (`PR_SET_TIMERSLACK`); not those of real-time threads.
pub fn exact_sleeps() {
    // Without it they are less exact.
    let _ = prctl::set_timerslack(1);
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_thread_inherits_exact_sleeps() {
        let slack = std::thread::spawn(|| {
            super::exact_sleeps();
            std::thread::spawn(nix::sys::prctl::get_timerslack).join()
        });
        let slack = slack.join().expect("it does not panic");
        assert_eq!(slack.expect("it does not panic"), Ok(1));
    }

    #[test]
    fn never_goes_back() {
        let times: Vec<u64> = (0..1000).map(|_| super::monotonic_ns()).collect();
        assert!(times.is_sorted() && times[0] > 0);
    }
}
