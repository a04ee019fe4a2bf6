//! Waits for what other processes do. Runs on the threads of the test harness.

use std::time::{Duration, Instant};

/// Default time limit of a wait. Generous, because a shared machine may stall and only a failing test waits this long.
pub const LIMIT: Duration = Duration::from_secs(60);

/// Polls `ask` until it returns a value; panics after [`LIMIT`].
pub fn await_some<T>(what: &str, ask: impl FnMut() -> Option<T>) -> T {
    await_within(LIMIT, what, ask)
}

/// Like [`await_some`], with another time limit.
pub fn await_within<T>(limit: Duration, what: &str, mut ask: impl FnMut() -> Option<T>) -> T {
    let begun = Instant::now();
    loop {
        if let Some(value) = ask() {
            return value;
        }
        assert!(begun.elapsed() < limit, "timed out waiting for {what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Like [`await_some`], with the last reason why the value was not there in the message of a failure.
pub fn await_told<T>(what: &str, mut ask: impl FnMut() -> Result<T, String>) -> T {
    let begun = Instant::now();
    loop {
        match ask() {
            Ok(value) => return value,
            Err(why) => assert!(
                begun.elapsed() < LIMIT,
                "timed out waiting for {what}; at last: {why}"
            ),
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}
