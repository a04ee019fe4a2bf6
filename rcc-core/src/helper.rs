//! The helper threads of a process as others see them: each counts its turns in a [`Beat`], and a [`HelperTable`] of all
//! of them crosses to other processes. A real-time thread reads beats with relaxed loads and nothing else.

use core::sync::atomic::{AtomicU32, AtomicU64, Ordering};

use bytemuck::{Pod, Zeroable};

/// Most helpers of a process.
pub const HELPERS_MAX: usize = 16;
/// Longest name of a helper, bytes; longer ones are cut.
pub const HELPER_NAME_MAX: usize = 16;

/// What a helper thread is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum HelperState {
    /// Made, and waiting for the others to be made.
    Waiting = 0,
    /// At work.
    Running = 1,
    /// Ended.
    Ended = 2,
    /// Ended by a panic.
    Panicked = 3,
}

impl HelperState {
    /// All states, in order of their numbers, with their names.
    pub const ALL: [(HelperState, &'static str); 4] = [
        (HelperState::Waiting, "waiting"),
        (HelperState::Running, "running"),
        (HelperState::Ended, "ended"),
        (HelperState::Panicked, "panicked"),
    ];

    /// From a number that came from another process; unknown numbers are `Ended`.
    pub fn from_number(number: u32) -> HelperState {
        Self::ALL
            .get(number as usize)
            .map_or(HelperState::Ended, |row| row.0)
    }

    /// As printed.
    pub fn name(self) -> &'static str {
        Self::ALL.get(self as usize).map_or("ended", |row| row.1)
    }
}

/// One helper's sign of life. Written by the helper, read by anybody; Relaxed everywhere, because each number stands for
/// itself and nothing else is told with it.
#[derive(Debug)]
pub struct Beat {
    name: &'static str,
    limit_ns: u64,
    turns: AtomicU64,
    stamp_ns: AtomicU64,
    state: AtomicU32,
}

impl Beat {
    /// Of a helper that may take `limit_ns` for one turn.
    pub fn new(name: &'static str, limit_ns: u64) -> Beat {
        Beat {
            name,
            limit_ns,
            turns: AtomicU64::new(0),
            stamp_ns: AtomicU64::new(0),
            state: AtomicU32::new(HelperState::Waiting as u32),
        }
    }

    /// The helper's name.
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// How long one turn may take, ns.
    pub fn limit_ns(&self) -> u64 {
        self.limit_ns
    }

    /// The helper has made one more turn; `now_ns` is CLOCK_MONOTONIC.
    pub fn turn(&self, now_ns: u64) {
        self.stamp_ns.store(now_ns, Ordering::Relaxed);
        self.turns.fetch_add(1, Ordering::Relaxed);
    }

    /// Turns so far.
    pub fn turns(&self) -> u64 {
        self.turns.load(Ordering::Relaxed)
    }

    /// What the helper is doing.
    pub fn state(&self) -> HelperState {
        HelperState::from_number(self.state.load(Ordering::Relaxed))
    }

    /// The helper is doing something else now.
    pub fn set_state(&self, state: HelperState) {
        self.state.store(state as u32, Ordering::Relaxed);
    }

    /// As it crosses to others.
    pub fn entry(&self) -> HelperEntry {
        let mut name = [0; HELPER_NAME_MAX];
        for (place, byte) in name.iter_mut().zip(self.name.bytes()) {
            *place = byte;
        }
        HelperEntry {
            name,
            turns: self.turns(),
            stamp_ns: self.stamp_ns.load(Ordering::Relaxed),
            limit_ns: self.limit_ns,
            state: u64::from(self.state.load(Ordering::Relaxed)),
        }
    }
}

/// One row of the table of helpers.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct HelperEntry {
    /// Its name, filled up with zeros; all zero: no helper.
    pub name: [u8; HELPER_NAME_MAX],
    /// Turns so far.
    pub turns: u64,
    /// CLOCK_MONOTONIC of the last one.
    pub stamp_ns: u64,
    /// How long one turn may take, ns.
    pub limit_ns: u64,
    /// [`HelperState`].
    pub state: u64,
}

impl HelperEntry {
    /// Its name; empty if there is no helper, or if the bytes are no text.
    pub fn name(&self) -> &str {
        let bytes = self.name.split(|byte| *byte == 0).next();
        bytes
            .and_then(|bytes| core::str::from_utf8(bytes).ok())
            .unwrap_or("")
    }
}

/// Executor → everybody: its helper threads, written every 16 ms or so.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct HelperTable {
    /// [`crate::message::MAGIC`].
    pub magic: u64,
    /// The rows; those without a name are free.
    pub helpers: [HelperEntry; HELPERS_MAX],
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_says_what_the_beat_says() {
        let beat = Beat::new("pump", 5);
        beat.turn(70);
        beat.turn(80);
        beat.set_state(HelperState::Running);
        let row = beat.entry();
        assert_eq!((row.name(), row.turns, row.stamp_ns), ("pump", 2, 80));
        assert_eq!((row.limit_ns, row.state), (5, HelperState::Running as u64));
        let long = Beat::new("a name of more than sixteen bytes", 5).entry();
        assert_eq!(long.name(), "a name of more t");
        assert_eq!(HelperEntry::zeroed().name(), "");
    }
}
