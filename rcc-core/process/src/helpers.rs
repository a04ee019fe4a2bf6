//! The helper threads of a program. All are created before the program reports that it is ready; a helper that ends by
//! itself ends the program, and one that hangs is detected. Used by main threads; each helper reports its progress
//! through [`Helper::turn`].

use std::io;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use nix::time::{ClockId, clock_gettime};
use rcc_core::helper::{HelperHeartbeat, HelperState};

use crate::exit::{ExitError, FAILED};
use crate::signals::request_stop;

mod hang;

pub use hang::{Hang, HangWatch};

/// Phase of the program, which all helpers follow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// Wait until all helpers are created.
    Preparing,
    /// Work.
    Working,
    /// End.
    Stopping,
}

#[derive(Debug)]
struct HelpersShared {
    /// Asks this program to stop.
    stop: fn(),
    state: Mutex<HelpersState>,
    /// Signalled when the state changes.
    changed: Condvar,
}

#[derive(Debug)]
struct HelpersState {
    phase: Phase,
    beats: Vec<Arc<HelperHeartbeat>>,
    /// Message about the first helper that ended by itself.
    failure: Option<String>,
}

impl HelpersState {
    /// Records a failure. Only the first one counts: others follow from it.
    fn fail(&mut self, name: &str, how: &str) {
        self.failure.get_or_insert_with(|| {
            format!(
                "the helper thread `{name}` {how}: the process brings everything to rest and exits, to be restarted"
            )
        });
    }
}

impl HelpersShared {
    /// Locks the state. It stays valid after a panic, because each change is a single assignment.
    fn state(&self) -> MutexGuard<'_, HelpersState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The helper threads of this program; clones refer to the same threads.
#[derive(Clone, Debug)]
pub struct Helpers {
    shared: Arc<HelpersShared>,
}

impl Default for Helpers {
    fn default() -> Helpers {
        Helpers::stopping_by(request_stop)
    }
}

impl Helpers {
    fn stopping_by(stop: fn()) -> Helpers {
        Helpers {
            shared: Arc::new(HelpersShared {
                stop,
                state: Mutex::new(HelpersState {
                    phase: Phase::Preparing,
                    beats: Vec::new(),
                    failure: None,
                }),
                changed: Condvar::new(),
            }),
        }
    }
}

impl Helpers {
    /// Creates a thread that runs `work` once [`Helpers::start`] is called. `limit` is the maximum time between two
    /// calls of [`Helper::turn`].
    ///
    /// # Errors
    /// Returns an error with the name of the thread and a remedy if the system refuses a thread.
    pub fn spawn(
        &self,
        name: &'static str,
        limit: Duration,
        work: impl FnMut(&Helper) + Send + 'static,
    ) -> io::Result<()> {
        let helper = self.helper(name, limit);
        let thread = move || {
            let mut work = work;
            // Dropped before what `work` owns: of a panic it reports this thread, not one that ends because of it.
            let helper = helper;
            if helper.wait_for_start() {
                work(&helper);
            }
        };
        self::thread(name, thread)
    }

    /// Registers a thread that the caller creates. The thread keeps the returned helper as long as it works, calls
    /// [`Helper::turn`] on it, and need not wait for [`Helpers::start`].
    #[must_use]
    pub fn helper(&self, name: &'static str, limit: Duration) -> Helper {
        let limit_ns = limit.as_nanos().try_into().unwrap_or(u64::MAX);
        let beat = Arc::new(HelperHeartbeat::new(name, limit_ns));
        self.shared.state().beats.push(Arc::clone(&beat));
        Helper {
            shared: Arc::clone(&self.shared),
            beat,
        }
    }

    /// Returns the heartbeats of all helpers registered so far.
    #[must_use]
    pub fn beats(&self) -> Box<[Arc<HelperHeartbeat>]> {
        self.shared.state().beats.clone().into()
    }

    /// Starts the work of all helpers, once all are created.
    pub fn start(&self) {
        self.enter(Phase::Working);
        let mut state = self.shared.state();
        // A helper that does not wait may have ended already.
        let over = |beat: &&Arc<HelperHeartbeat>| {
            matches!(beat.state(), HelperState::Ended | HelperState::Panicked)
        };
        let ended = state.beats.iter().find(over).map(|beat| beat.name());
        if let Some(name) = ended {
            state.fail(name, "ended by itself");
            drop(state);
            (self.shared.stop)();
        }
    }

    /// Asks all helpers to end; see [`Helper::is_over`].
    pub fn end(&self) {
        self.enter(Phase::Stopping);
    }

    fn enter(&self, phase: Phase) {
        self.shared.state().phase = phase;
        self.shared.changed.notify_all();
    }

    /// Waits at most `patience` until all helpers except the named ones have ended; returns the names of those that
    /// have not.
    #[must_use]
    pub fn join(&self, patience: Duration, except: &[&str]) -> Vec<&'static str> {
        let limit = Instant::now() + patience;
        let mut state = self.shared.state();
        loop {
            let working = |beat: &&Arc<HelperHeartbeat>| {
                let over = matches!(beat.state(), HelperState::Ended | HelperState::Panicked);
                !over && !except.contains(&beat.name())
            };
            let names: Vec<_> = state
                .beats
                .iter()
                .filter(working)
                .map(|beat| beat.name())
                .collect();
            let left = limit.saturating_duration_since(Instant::now());
            if names.is_empty() || left.is_zero() {
                return names;
            }
            let waited = self.shared.changed.wait_timeout(state, left);
            state = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Returns which helper ended by itself, and how; the program was then asked to stop, as by SIGTERM.
    #[must_use]
    pub fn failure(&self) -> Option<String> {
        self.shared.state().failure.clone()
    }

    /// Ends the program with an error if a helper ended by itself, so that its supervisor restarts it.
    ///
    /// # Errors
    /// Returns an error if a helper ended by itself.
    pub fn conclude(&self) -> Result<(), ExitError> {
        match self.failure() {
            None => Ok(()),
            Some(message) => Err(ExitError {
                code: FAILED,
                message,
            }),
        }
    }
}

/// Creates a thread that is not a helper, so its liveness is not checked.
///
/// # Errors
/// Returns an error with the name of the thread and a remedy if the system refuses a thread.
pub fn thread(name: &str, work: impl FnOnce() + Send + 'static) -> io::Result<()> {
    let made = thread::Builder::new().name(name.to_owned()).spawn(work);
    made.map(drop).map_err(|error| no_thread(name, &error))
}

fn no_thread(name: &str, error: &io::Error) -> io::Error {
    let words = format!(
        "cannot create the thread `{name}` ({error}): raise TasksMax= or pids.max of its group, or the limit nproc of its user"
    );
    io::Error::new(error.kind(), words)
}

/// One helper, owned by its thread. If it is dropped without a request to end, the whole program is asked to stop.
#[derive(Debug)]
pub struct Helper {
    shared: Arc<HelpersShared>,
    beat: Arc<HelperHeartbeat>,
}

impl Helper {
    /// Reports progress: one iteration is done.
    pub fn turn(&self) {
        #[cfg(debug_assertions)]
        self.panic_if_a_test_wants_it();
        self.beat.set_state(HelperState::Running);
        self.beat.turn(monotonic_ns());
    }

    /// Sleeps at most `time`, less if the helper is asked to end meanwhile; returns true if it is.
    pub fn rest(&self, time: Duration) -> bool {
        self.turn();
        let state = self.shared.state();
        let working = |state: &mut HelpersState| state.phase != Phase::Stopping;
        let waited = self.shared.changed.wait_timeout_while(state, time, working);
        let state = waited.unwrap_or_else(PoisonError::into_inner).0;
        state.phase == Phase::Stopping
    }

    /// Returns true if the helper is asked to end.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.shared.state().phase == Phase::Stopping
    }

    /// Waits until all helpers are created; returns false if the helper must end without work.
    fn wait_for_start(&self) -> bool {
        let state = self.shared.state();
        let waited = self
            .shared
            .changed
            .wait_while(state, |state| state.phase == Phase::Preparing);
        let go = waited.unwrap_or_else(PoisonError::into_inner).phase == Phase::Working;
        if go {
            self.turn();
        }
        go
    }

    /// `RCC_TEST_PANIC=NAME@FILE`: the helper with that name panics once the file exists. Debug builds only.
    #[cfg(debug_assertions)]
    fn panic_if_a_test_wants_it(&self) {
        static WANTED: std::sync::OnceLock<Option<(String, std::path::PathBuf)>> =
            std::sync::OnceLock::new();
        let wanted = WANTED.get_or_init(|| {
            let wanted = std::env::var("RCC_TEST_PANIC").ok()?;
            let (name, file) = wanted.split_once('@')?;
            Some((name.to_owned(), file.into()))
        });
        if let Some((name, file)) = wanted
            && *name == self.beat.name()
            && file.exists()
        {
            panic!("RCC_TEST_PANIC: a test wants `{name}` to panic");
        }
    }
}

impl Drop for Helper {
    fn drop(&mut self) {
        let panicked = thread::panicking();
        let mut state = self.shared.state();
        self.beat.set_state(match panicked {
            true => HelperState::Panicked,
            false => HelperState::Ended,
        });
        let failed = state.phase == Phase::Working;
        if failed {
            let how = if panicked {
                "panicked"
            } else {
                "ended by itself"
            };
            state.fail(self.beat.name(), how);
        }
        drop(state);
        self.shared.changed.notify_all();
        if failed {
            (self.shared.stop)();
        }
    }
}

/// CLOCK_MONOTONIC, ns; 0 if the system has none.
fn monotonic_ns() -> u64 {
    clock_gettime(ClockId::CLOCK_MONOTONIC).map_or(0, |now| {
        (now.tv_sec() as u64).wrapping_mul(1_000_000_000) + now.tv_nsec() as u64
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::channel;

    const LIMIT: Duration = Duration::from_secs(60);

    #[test]
    fn helpers_begin_when_all_are_created_and_end_on_request() {
        let helpers = Helpers::default();
        let (sender, receiver) = channel();
        let work = move |helper: &Helper| {
            while !helper.is_over() {
                helper.turn();
                let _ = sender.send(());
            }
        };
        helpers.spawn("one", LIMIT, work).unwrap();
        assert!(receiver.try_recv().is_err());
        assert_eq!(helpers.beats()[0].state(), HelperState::Waiting);
        helpers.start();
        receiver.recv_timeout(LIMIT).unwrap();
        assert_eq!(helpers.beats()[0].state(), HelperState::Running);
        helpers.end();
        assert!(helpers.join(LIMIT, &[]).is_empty());
        assert_eq!(helpers.failure(), None);
    }

    #[test]
    fn a_helper_that_panics_or_ends_by_itself_stops_the_program_and_is_named() {
        use std::sync::atomic::{AtomicU32, Ordering};
        static STOPS: AtomicU32 = AtomicU32::new(0);
        type Work = fn(&Helper);
        let ends: [(&str, Work); 2] = [
            ("panicked", |_| panic!("on purpose")),
            ("ended by itself", |_| {}),
        ];
        for (how, work) in ends {
            let helpers = Helpers::stopping_by(|| {
                STOPS.fetch_add(1, Ordering::Relaxed);
            });
            STOPS.store(0, Ordering::Relaxed);
            helpers.spawn("pump", LIMIT, work).unwrap();
            helpers.start();
            assert!(helpers.join(LIMIT, &[]).is_empty());
            while STOPS.load(Ordering::Relaxed) == 0 {
                thread::yield_now();
            }
            let ending = helpers.conclude().unwrap_err();
            assert_eq!(ending.code, FAILED);
            let words = format!("the helper thread `pump` {how}");
            assert!(ending.message.contains(&words), "{}", ending.message);
        }
    }

    #[test]
    fn helpers_that_were_never_started_end_without_work() {
        let helpers = Helpers::default();
        helpers.spawn("one", LIMIT, |_| panic!("no work")).unwrap();
        helpers.end();
        assert!(helpers.join(LIMIT, &[]).is_empty());
        assert_eq!(helpers.failure(), None);
    }

    #[test]
    fn a_helper_that_does_not_end_is_named_and_not_waited_for() {
        let helpers = Helpers::default();
        let (_keep, never) = channel::<()>();
        let work = move |_: &Helper| {
            let _ = never.recv();
        };
        helpers.spawn("stuck", LIMIT, work).unwrap();
        helpers.start();
        while helpers.beats()[0].state() != HelperState::Running {
            thread::yield_now();
        }
        helpers.end();
        assert_eq!(helpers.join(Duration::from_millis(50), &[]), ["stuck"]);
        assert!(helpers.join(LIMIT, &["stuck"]).is_empty());
    }
}
