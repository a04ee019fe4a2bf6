//! What a long test did and when, so that a late cycle can be laid beside it, and what it found.
//! Written by every thread of the test.

use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, RwLock, RwLockWriteGuard};
use std::time::Duration;

use rcc_ipc::monotonic_ns;

/// Entries that are remembered.
const REMEMBERED: usize = 4096;
/// Findings that are kept; more are only counted.
const FINDINGS_MAX: usize = 200;

/// Entries with their time, findings, and whether the test is to end.
#[derive(Debug, Default)]
pub struct Journal {
    entries: Mutex<VecDeque<(u64, String)>>,
    findings: Mutex<Vec<String>>,
    found: AtomicU64,
    over: AtomicBool,
    // Shared by every round, exclusive in a quiet moment.
    calm: RwLock<()>,
}

impl Journal {
    /// Notes that something happens now.
    pub fn note(&self, what: String) {
        let mut entries = self.entries.lock().expect("no thread panics in here");
        if entries.len() == REMEMBERED {
            entries.pop_front();
        }
        entries.push_back((monotonic_ns(), what));
    }

    /// What happened in a stretch of CLOCK_MONOTONIC.
    pub fn between(&self, from_ns: u64, to_ns: u64) -> Vec<String> {
        let entries = self.entries.lock().expect("no thread panics in here");
        let within = entries
            .iter()
            .filter(|(at_ns, _)| (from_ns..=to_ns).contains(at_ns));
        within.map(|(_, what)| what.clone()).collect()
    }

    /// Keeps something that must not be.
    pub fn add_finding(&self, what: String) {
        eprintln!("FOUND {what}");
        self.note(format!("found: {what}"));
        // Relaxed: read after all threads have ended.
        if self.found.fetch_add(1, Ordering::Relaxed) < FINDINGS_MAX as u64 {
            self.findings
                .lock()
                .expect("no thread panics in here")
                .push(what);
        }
    }

    /// Everything found, and how much it was.
    pub fn findings(&self) -> (Vec<String>, u64) {
        let findings = self.findings.lock().expect("no thread panics in here");
        (findings.clone(), self.found.load(Ordering::Relaxed))
    }

    /// Tells every thread to end its round and stop.
    pub fn end(&self) {
        self.over.store(true, Ordering::Release);
    }

    /// True when the threads are to stop.
    pub fn is_over(&self) -> bool {
        self.over.load(Ordering::Acquire)
    }

    /// Sleeps, but not beyond the end.
    pub fn pause(&self, time: Duration) {
        let until_ns = monotonic_ns() + time.as_nanos() as u64;
        while !self.is_over() && monotonic_ns() < until_ns {
            let left = Duration::from_nanos(until_ns.saturating_sub(monotonic_ns()));
            std::thread::sleep(left.min(Duration::from_millis(20)));
        }
    }

    /// Waits until no round is under way; none begins while the answer lives.
    pub fn quiet(&self) -> RwLockWriteGuard<'_, ()> {
        self.calm.write().unwrap_or_else(|held| held.into_inner())
    }

    /// Runs rounds of `who` until the end. A round that panics is a finding, and the next one is tried.
    pub fn rounds(&self, who: &str, mut round: impl FnMut(u64)) {
        for number in 0.. {
            let _under_way = self.calm.read().unwrap_or_else(|held| held.into_inner());
            if self.is_over() {
                return;
            }
            if let Err(cause) = catch_unwind(AssertUnwindSafe(|| round(number))) {
                let words = cause.downcast_ref::<String>().cloned();
                let words = words.or_else(|| cause.downcast_ref::<&str>().map(|&s| s.to_owned()));
                self.add_finding(format!(
                    "{who}, round {number}: {}",
                    words.unwrap_or_default()
                ));
                self.pause(Duration::from_secs(1));
            }
        }
    }
}

/// xorshift64*, so that a printed seed gives the same choices again.
#[derive(Debug)]
pub struct Random(u64);

impl Random {
    /// From a seed and the number of the thread that uses it.
    pub fn new(seed: u64, thread: u64) -> Random {
        let mixed = seed ^ (thread + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        Random(mixed | 1)
    }

    /// A number below `bound`.
    pub fn below(&mut self, bound: u64) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 16) % bound
    }

    /// True in so many of a hundred cases.
    pub fn percent(&mut self, part: u64) -> bool {
        self.below(100) < part
    }

    /// A time below `bound`.
    pub fn time_below(&mut self, bound: Duration) -> Duration {
        Duration::from_micros(self.below(bound.as_micros().max(1) as u64))
    }
}
