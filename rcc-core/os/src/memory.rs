//! Memory that is free but still held, given back to the system. Called by threads that are not real-time: it locks the
//! allocator for some milliseconds.
// One call of the C library, in this file alone.
#![allow(unsafe_code)]

use std::fs;

/// Resident memory may grow by this much before free memory is looked for, bytes.
const STEP: usize = 8 << 20;
/// Most looks that are left out while the memory is in use.
const PAUSE_MAX: u32 = 64;

/// Gives memory back when this process has grown. An allocator keeps what was freed for the next allocation; after work
/// that took very much memory for a short time that is more than the process will need again.
#[derive(Debug)]
pub struct MemoryTrimmer {
    /// What was resident at the beginning, bytes.
    rest: usize,
    /// Looks that are left out, because memory that is in use cannot be given back.
    pause: u32,
    /// How many of them are still to come.
    left: u32,
}

impl Default for MemoryTrimmer {
    /// From what the process has now.
    fn default() -> Self {
        Self {
            rest: resident(),
            pause: 1,
            left: 0,
        }
    }
}

impl MemoryTrimmer {
    /// Gives back what is free if the process has grown by some megabytes. Called from time to time; costs the reading of
    /// one small file otherwise.
    pub fn trim_if_grown(&mut self) {
        if self.left > 0 {
            self.left -= 1;
            return;
        }
        let grown = || resident() > self.rest + STEP;
        if grown() {
            give_back();
        }
        self.pause = if grown() {
            (2 * self.pause).min(PAUSE_MAX)
        } else {
            1
        };
        self.left = self.pause - 1;
    }
}

/// Resident memory of this process, bytes; 0 where the system does not tell.
fn resident() -> usize {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    let kilobytes = line.and_then(|rest| rest.split_whitespace().next());
    kilobytes
        .and_then(|number| number.parse().ok())
        .unwrap_or(0)
        << 10
}

/// Gives all whole pages that no allocation uses back to the system. Does nothing where the allocator is not glibc's.
fn give_back() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    // SAFETY: it takes a number and no pointer, may be called by several threads at once (MT-Safe by its manual page),
    // and gives back only pages within chunks that are free: nothing that was allocated moves or changes.
    unsafe {
        libc::malloc_trim(0);
    }
}

#[cfg(all(test, target_os = "linux", target_env = "gnu"))]
mod tests {
    use super::*;

    #[test]
    fn what_was_freed_below_a_piece_that_lives_on_is_given_back() {
        const PIECE: usize = 1 << 10;
        const ALL: usize = 48 << 20;
        let mut returned = MemoryTrimmer::default();
        let mut pieces: Vec<Vec<u8>> = (0..ALL / PIECE).map(|_| vec![1; PIECE]).collect();
        let full = resident();
        assert!(full > ALL);
        // The heap does not shrink by itself below this one.
        let last = pieces.pop();
        drop(pieces);
        returned.trim_if_grown();
        let after = resident();
        assert!(after < full - ALL / 2, "{after} of {full} bytes");
        assert_eq!(last.map(|piece| piece.len()), Some(PIECE));
    }
}
