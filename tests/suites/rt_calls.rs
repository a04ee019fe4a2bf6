//! The real-time thread makes no system call but its sleep, whatever comes and goes around it.

use rcc_tests::rt_calls::count;

#[test]
fn the_real_time_thread_calls_the_system_only_to_sleep() {
    let counted = match count(5_000) {
        Ok(counted) => counted,
        Err(cause) => return eprintln!("skipped: system calls of the real-time thread: {cause}"),
    };
    eprintln!("{counted:?}");
    assert_eq!(counted.others(), Default::default(), "{counted:?}");
    // Not fewer cycles than it slept, but for those around attaching and detaching; a late cycle sleeps, too.
    let (cycles, sleeps) = (counted.cycles, counted.sleeps());
    assert!(
        sleeps.abs_diff(cycles) <= 100,
        "{sleeps} sleeps in {cycles} cycles"
    );
}
