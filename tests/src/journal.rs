//! Time-stamped log of the actions of a long test, used to find what happened around a late cycle, and its findings
//! (violated conditions). Written by every thread of the test.

use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, RwLock, RwLockWriteGuard};
use std::time::Duration;

use rcc_os::clock::monotonic_ns;
use rcc_testing::Rng;

/// Number of entries that are kept; the oldest are dropped.
const REMEMBERED: usize = 4096;
/// Number of findings that are kept; further ones are only counted.
const FINDINGS_MAX: usize = 200;

/// Entries with their times, findings, and the flag that ends the test.
#[derive(Debug, Default)]
pub struct Journal {
    entries: Mutex<VecDeque<(u64, String)>>,
    findings: Mutex<Vec<String>>,
    found: AtomicU64,
    over: AtomicBool,
    // Each round holds it for reading; `quiet` holds it for writing.
    calm: RwLock<()>,
}

impl Journal {
    /// Adds an entry with the current time.
    pub fn note(&self, what: String) {
        let mut entries = self.entries.lock().expect("no thread panics in here");
        if entries.len() == REMEMBERED {
            entries.pop_front();
        }
        entries.push_back((monotonic_ns(), what));
    }

    /// Returns the entries of an interval of CLOCK_MONOTONIC, inclusive.
    pub fn between(&self, from_ns: u64, to_ns: u64) -> Vec<String> {
        let entries = self.entries.lock().expect("no thread panics in here");
        let within = entries
            .iter()
            .filter(|(at_ns, _)| (from_ns..=to_ns).contains(at_ns));
        within.map(|(_, what)| what.clone()).collect()
    }

    /// Records a violated condition.
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

    /// Returns the findings that were kept, and the number of all findings.
    pub fn findings(&self) -> (Vec<String>, u64) {
        let findings = self.findings.lock().expect("no thread panics in here");
        (findings.clone(), self.found.load(Ordering::Relaxed))
    }

    /// Tells every thread to finish its round and stop.
    pub fn end(&self) {
        self.over.store(true, Ordering::Release);
    }

    /// True once the threads are told to stop.
    pub fn is_over(&self) -> bool {
        self.over.load(Ordering::Acquire)
    }

    /// Sleeps for `time`, or until the test ends if that is sooner.
    pub fn pause(&self, time: Duration) {
        let until_ns = monotonic_ns() + time.as_nanos() as u64;
        while !self.is_over() && monotonic_ns() < until_ns {
            let left = Duration::from_nanos(until_ns.saturating_sub(monotonic_ns()));
            std::thread::sleep(left.min(Duration::from_millis(20)));
        }
    }

    /// Waits until no round is running; none begins while the returned guard is alive.
    pub fn quiet(&self) -> RwLockWriteGuard<'_, ()> {
        self.calm.write().unwrap_or_else(|held| held.into_inner())
    }

    /// Runs rounds of the activity `who` until the test ends. A panic in a round is recorded as a finding, and the next
    /// round runs after 1 s.
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

/// Random choices of one thread: the same seed reproduces them.
#[derive(Debug)]
pub struct Random(Rng);

impl Random {
    /// Creates the generator of one thread from the seed of the run and the thread's number.
    pub fn new(seed: u64, thread: u64) -> Random {
        Random(Rng::with_seed(seed ^ thread << 32))
    }

    /// Returns a number below `bound`.
    pub fn below(&mut self, bound: u64) -> u64 {
        self.0.u64(..bound)
    }

    /// Returns true with a probability of `part` percent.
    pub fn percent(&mut self, part: u64) -> bool {
        self.below(100) < part
    }

    /// Returns a duration below `bound`, in whole µs.
    pub fn time_below(&mut self, bound: Duration) -> Duration {
        Duration::from_micros(self.below(bound.as_micros().max(1) as u64))
    }
}
