//! Returns freed memory that the allocator keeps to the system. Called by threads that are not real-time: it locks the
//! allocator for some milliseconds.
// Two calls of the C library, only in this file.
#![allow(unsafe_code)]

use std::fs;

/// Growth of the heap that triggers a trim, bytes.
const STEP: usize = 4 << 20;
/// Free memory at the end of an arena that is kept, bytes.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const ARENA_END: libc::c_int = 128 << 10;
/// Maximum number of calls that are skipped while the memory is in use.
const PAUSE_MAX: u32 = 64;

/// Returns memory to the system when this process has grown. The allocator keeps freed memory for later allocations;
/// after work that briefly needed very much memory, that is more than the process will need again.
#[derive(Debug)]
pub struct MemoryTrimmer {
    /// Resident memory of the heap at the start, bytes.
    rest: usize,
    /// Number of calls to skip after a trim, because memory in use cannot be returned.
    pause: u32,
    /// Number of calls still to be skipped.
    left: u32,
}

impl Default for MemoryTrimmer {
    /// Takes the current memory of the process as the baseline.
    fn default() -> Self {
        Self {
            rest: resident(),
            pause: 1,
            left: 0,
        }
    }
}

impl MemoryTrimmer {
    /// Returns free memory to the system if the process has grown by some megabytes. Called periodically; it costs reading
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

/// Sets the allocator up for a process whose work now and then needs very much memory. To be called before threads are
/// made; does nothing unless the allocator is glibc's.
///
/// Each of `threads` threads gets an arena for itself: with fewer, a thread waits for another one that holds their arena
/// and has no processor, whatever its own priority is.
///
/// [`MemoryTrimmer`] does not reach the end of an arena other than the first: `free` returns it, if it is longer than a limit
/// that by default grows to twice the largest block that was ever freed. So the limit is fixed, and small blocks join their
/// neighbours at once (no fast bins); otherwise a trim joins them into the end of the arena, which no `free` then returns.
pub fn configure_allocator(threads: usize) {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    for (parameter, value) in [
        (libc::M_ARENA_MAX, threads.try_into().unwrap_or(i32::MAX)),
        (libc::M_TRIM_THRESHOLD, ARENA_END),
        (libc::M_MXFAST, 0),
    ] {
        // SAFETY: it takes two numbers and no pointer, and only sets how arenas are made and shrink from now on.
        // Refused only for parameters that the library does not know.
        let _ = unsafe { libc::mallopt(parameter, value) };
    }
    #[cfg(not(all(target_os = "linux", target_env = "gnu")))]
    let _ = threads;
}

/// Returns the resident memory of this process without pages of files, bytes; 0 if the system does not report it. A
/// program's pages come with its work and cannot be given back.
fn resident() -> usize {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status
        .lines()
        .find_map(|line| line.strip_prefix("RssAnon:"));
    let kilobytes = line.and_then(|rest| rest.split_whitespace().next());
    kilobytes
        .and_then(|number| number.parse().ok())
        .unwrap_or(0)
        << 10
}

/// Returns all whole free pages of the allocator to the system. Does nothing unless the allocator is glibc's.
fn give_back() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    // SAFETY: it takes a number and no pointer, may be called by several threads at once (MT-Safe according to its
    // manual page), and releases only pages within free chunks: nothing that is allocated moves or changes.
    unsafe {
        libc::malloc_trim(0);
    }
}

#[cfg(all(test, target_os = "linux", target_env = "gnu"))]
mod tests {
    use std::hint::black_box;
    use std::sync::Mutex;
    use std::sync::mpsc::channel;

    use super::*;

    /// Tests that measure the memory of the process run one after the other.
    static MEASURED: Mutex<()> = Mutex::new(());

    #[test]
    fn memory_freed_below_a_live_allocation_is_returned() {
        let _alone = MEASURED.lock();
        const PIECE: usize = 1 << 10;
        const ALL: usize = 48 << 20;
        let mut returned = MemoryTrimmer::default();
        let mut pieces: Vec<Vec<u8>> = (0..ALL / PIECE).map(|_| vec![1; PIECE]).collect();
        let full = resident();
        assert!(full > ALL);
        // The heap cannot shrink below this live allocation.
        let last = pieces.pop();
        drop(pieces);
        returned.trim_if_grown();
        let after = resident();
        assert!(after < full - ALL / 2, "{after} of {full} bytes");
        assert_eq!(last.map(|piece| piece.len()), Some(PIECE));
    }

    #[test]
    fn memory_at_the_end_of_a_threads_arena_is_returned() {
        const PIECE: usize = 16 << 10;
        const ALL: usize = 24 << 20;
        let _alone = MEASURED.lock();
        configure_allocator(64);
        let mut trimmer = MemoryTrimmer::default();
        // By default a large block that was freed is taken as the size of those to come.
        drop(black_box(vec![1_u8; ALL]));
        let (step, steps) = channel();
        let (go, gone) = channel();
        let worker = std::thread::spawn(move || {
            let small = || {
                (0..32)
                    .map(|_| black_box(Box::new([1_u8; 64])))
                    .collect::<Vec<_>>()
            };
            let kept = small();
            let large: Vec<Vec<u8>> = (0..ALL / PIECE).map(|_| vec![1; PIECE]).collect();
            let last = small();
            step.send(()).unwrap();
            gone.recv().unwrap();
            // A thread keeps a few small blocks for itself; by default the allocator keeps those that follow in fast bins.
            drop(kept);
            drop(large);
            drop(last);
            step.send(()).unwrap();
            // The arena lives as long as its thread.
            gone.recv().unwrap();
        });
        steps.recv().unwrap();
        let full = resident();
        go.send(()).unwrap();
        steps.recv().unwrap();
        trimmer.trim_if_grown();
        let after = resident();
        assert!(after < full - ALL / 2, "{after} of {full} bytes");
        go.send(()).unwrap();
        worker.join().unwrap();
    }
}
