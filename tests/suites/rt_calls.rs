//! The real-time thread makes no system call except its sleep, whatever other processes do.

use rcc_tests::rt_calls::count;

#[test]
fn the_real_time_thread_makes_no_system_call_except_its_sleep() {
    let counted = match count(5_000) {
        Ok(counted) => counted,
        Err(cause) => return eprintln!("skipped: system calls of the real-time thread: {cause}"),
    };
    eprintln!("{counted:?}");
    assert_eq!(counted.others(), Default::default(), "{counted:?}");
    // One sleep per cycle, also in a late one; a few are not counted while strace attaches and detaches.
    let (cycles, sleeps) = (counted.cycles, counted.sleeps());
    assert!(
        sleeps.abs_diff(cycles) <= 100,
        "{sleeps} sleeps in {cycles} cycles"
    );
}
