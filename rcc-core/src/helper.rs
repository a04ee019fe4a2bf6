//! Liveness of the helper threads of a process: each counts its iterations in a [`HelperHeartbeat`], and a
//! [`HelperTable`] publishes all of them to other processes. A real-time thread only reads heartbeats, with relaxed
//! loads.

use core::sync::atomic::{AtomicU32, AtomicU64, Ordering};

use bytemuck::{Pod, Zeroable};

/// Maximum number of helpers of a process.
pub const HELPERS_MAX: usize = 16;
/// Longest name of a helper, bytes; longer names are truncated.
pub const HELPER_NAME_MAX: usize = 16;

/// The state of a helper thread.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum HelperState {
    /// Created, and waiting for the other helpers to be created.
    Waiting = 0,
    /// Running.
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

    /// Returns the state of a number that came from another process; unknown numbers are `Ended`.
    pub fn from_number(number: u32) -> HelperState {
        Self::ALL
            .get(number as usize)
            .map_or(HelperState::Ended, |row| row.0)
    }

    /// Returns the display name.
    pub fn name(self) -> &'static str {
        Self::ALL.get(self as usize).map_or("ended", |row| row.1)
    }
}

/// The heartbeat of one helper. Written by the helper, read by any thread; all accesses are Relaxed, because each
/// number stands alone and no other data is published with it.
#[derive(Debug)]
pub struct HelperHeartbeat {
    name: &'static str,
    limit_ns: u64,
    turns: AtomicU64,
    stamp_ns: AtomicU64,
    state: AtomicU32,
}

impl HelperHeartbeat {
    /// Creates the heartbeat of a helper that may take `limit_ns` for one iteration.
    pub fn new(name: &'static str, limit_ns: u64) -> HelperHeartbeat {
        HelperHeartbeat {
            name,
            limit_ns,
            turns: AtomicU64::new(0),
            stamp_ns: AtomicU64::new(0),
            state: AtomicU32::new(HelperState::Waiting as u32),
        }
    }

    /// Returns the helper's name.
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// Longest allowed duration of one iteration, ns.
    pub fn limit_ns(&self) -> u64 {
        self.limit_ns
    }

    /// Counts one iteration; `now_ns` is CLOCK_MONOTONIC.
    pub fn turn(&self, now_ns: u64) {
        self.stamp_ns.store(now_ns, Ordering::Relaxed);
        self.turns.fetch_add(1, Ordering::Relaxed);
    }

    /// Number of iterations so far.
    pub fn turns(&self) -> u64 {
        self.turns.load(Ordering::Relaxed)
    }

    /// Returns the helper's state.
    pub fn state(&self) -> HelperState {
        HelperState::from_number(self.state.load(Ordering::Relaxed))
    }

    /// Sets the helper's state.
    pub fn set_state(&self, state: HelperState) {
        self.state.store(state as u32, Ordering::Relaxed);
    }

    /// Returns the row for the [`HelperTable`].
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
    /// Name, padded with zeros; all zero: the row is free.
    pub name: [u8; HELPER_NAME_MAX],
    /// Number of iterations so far.
    pub turns: u64,
    /// CLOCK_MONOTONIC of the last iteration.
    pub stamp_ns: u64,
    /// Longest allowed duration of one iteration, ns.
    pub limit_ns: u64,
    /// [`HelperState`].
    pub state: u64,
}

impl HelperEntry {
    /// Returns the name; empty if the row is free or the bytes are not UTF-8.
    pub fn name(&self) -> &str {
        let bytes = self.name.split(|byte| *byte == 0).next();
        bytes
            .and_then(|bytes| core::str::from_utf8(bytes).ok())
            .unwrap_or("")
    }
}

/// Executor → all processes: its helper threads, written about every 16 ms.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct HelperTable {
    /// [`crate::message::MAGIC`].
    pub magic: u64,
    /// Rows; a row without a name is free.
    pub helpers: [HelperEntry; HELPERS_MAX],
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_row_reflects_its_heartbeat() {
        let beat = HelperHeartbeat::new("pump", 5);
        beat.turn(70);
        beat.turn(80);
        beat.set_state(HelperState::Running);
        let row = beat.entry();
        assert_eq!((row.name(), row.turns, row.stamp_ns), ("pump", 2, 80));
        assert_eq!((row.limit_ns, row.state), (5, HelperState::Running as u64));
        let long = HelperHeartbeat::new("a name of more than sixteen bytes", 5).entry();
        assert_eq!(long.name(), "a name of more t");
        assert_eq!(HelperEntry::zeroed().name(), "");
    }
}
