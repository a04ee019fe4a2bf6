//! The helper threads of a program: all of them are made before it says that it is ready, one that ends by itself ends the
//! program, and one that hangs is noticed. Used by main threads; each helper counts its turns through [`Helper`].

use std::io;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use nix::time::{ClockId, clock_gettime};
use rcc_core::helper::{HelperHeartbeat, HelperState};

use crate::exit::{ExitError, FAILED};
use crate::notify::HealthReport;
use crate::signals::request_stop;

/// What all helpers are to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// Wait until all are made.
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
    /// Somebody changed the state.
    changed: Condvar,
}

#[derive(Debug)]
struct HelpersState {
    phase: Phase,
    beats: Vec<Arc<HelperHeartbeat>>,
    /// The first helper that ended by itself, and how.
    failure: Option<String>,
}

impl HelpersState {
    /// The first failure counts: the others follow from it.
    fn fail(&mut self, name: &str, how: &str) {
        self.failure.get_or_insert_with(|| {
            format!(
                "the helper thread `{name}` {how}: everything is brought to rest, and this process ends to be started again"
            )
        });
    }
}

impl HelpersShared {
    /// A panic leaves the state whole: each change is one assignment.
    fn state(&self) -> MutexGuard<'_, HelpersState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The helper threads of this program; clones are the same ones.
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
    /// Makes a thread, which does `work` once [`Helpers::start`] is called. `limit` is the longest time that it may go without
    /// [`Helper::turn`].
    ///
    /// # Errors
    /// The system gives no thread; which one, and what to do.
    pub fn spawn(
        &self,
        name: &'static str,
        limit: Duration,
        work: impl FnOnce(&Helper) + Send + 'static,
    ) -> io::Result<()> {
        let helper = self.helper(name, limit);
        let thread = move || {
            if helper.wait_for_start() {
                work(&helper);
            }
        };
        self::thread(name, thread)
    }

    /// A thread that somebody else makes: it gets the helper, keeps it as long as it works, and calls
    /// [`Helper::turn`]. It need not wait for [`Helpers::start`].
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

    /// The signs of life of all helpers that were made so far.
    #[must_use]
    pub fn beats(&self) -> Box<[Arc<HelperHeartbeat>]> {
        self.shared.state().beats.clone().into()
    }

    /// All are made: they begin to work.
    pub fn start(&self) {
        self.enter(Phase::Working);
        let mut state = self.shared.state();
        // Who need not wait may have ended already.
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

    /// They are asked to end: [`Helper::is_over`].
    pub fn end(&self) {
        self.enter(Phase::Stopping);
    }

    fn enter(&self, phase: Phase) {
        self.shared.state().phase = phase;
        self.shared.changed.notify_all();
    }

    /// Waits, at most this long, until all have ended except those of these names; the names of those that have not.
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

    /// Which helper ended by itself, and how; the program was asked to stop then, as by SIGTERM.
    #[must_use]
    pub fn failure(&self) -> Option<String> {
        self.shared.state().failure.clone()
    }

    /// How a program ends whose helper ended by itself: so that its supervisor starts it again.
    ///
    /// # Errors
    /// A helper ended by itself.
    pub fn conclude(&self) -> Result<(), ExitError> {
        match self.failure() {
            None => Ok(()),
            Some(message) => Err(ExitError {
                code: FAILED,
                message,
            }),
        }
    }

    /// Looks for helpers that hang. `tell` hears of each once, until it goes on.
    pub fn watch(&self, tell: impl FnMut(&Hang) + Send + 'static) -> HangWatch {
        HangWatch {
            helpers: self.clone(),
            seen: Vec::new(),
            looked: Instant::now(),
            held: 0,
            tell: Box::new(tell),
        }
    }
}

/// Makes a thread that is no helper: nobody looks whether it lives.
///
/// # Errors
/// The system gives no thread; which one, and what to do.
pub fn thread(name: &str, work: impl FnOnce() + Send + 'static) -> io::Result<()> {
    let made = thread::Builder::new().name(name.to_owned()).spawn(work);
    made.map(drop).map_err(|error| no_thread(name, &error))
}

fn no_thread(name: &str, error: &io::Error) -> io::Error {
    let words = format!(
        "the system gives no thread `{name}` ({error}): raise TasksMax= or pids.max of its group, or the limit nproc of its user"
    );
    io::Error::new(error.kind(), words)
}

/// One helper, in its own thread. When it goes and nobody asked it to, the whole program is asked to stop.
#[derive(Debug)]
pub struct Helper {
    shared: Arc<HelpersShared>,
    beat: Arc<HelperHeartbeat>,
}

impl Helper {
    /// One turn is done: it lives.
    pub fn turn(&self) {
        #[cfg(debug_assertions)]
        self.panic_if_a_test_wants_it();
        self.beat.set_state(HelperState::Running);
        self.beat.turn(monotonic_ns());
    }

    /// Sleeps at most this long, less if it is asked to end meanwhile; true if it is.
    pub fn rest(&self, time: Duration) -> bool {
        self.turn();
        let state = self.shared.state();
        let working = |state: &mut HelpersState| state.phase != Phase::Stopping;
        let waited = self.shared.changed.wait_timeout_while(state, time, working);
        let state = waited.unwrap_or_else(PoisonError::into_inner).0;
        state.phase == Phase::Stopping
    }

    /// It is asked to end.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.shared.state().phase == Phase::Stopping
    }

    /// Waits until all helpers are made; false: there is nothing to do.
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

    /// `RCC_TEST_PANIC=NAME@FILE`: the helper of that name panics once the file exists. Not in optimised builds.
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

/// A helper that makes no turn any more.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Hang {
    /// Which one.
    pub helper: &'static str,
    /// For how long it has made no turn.
    pub silent: Duration,
    /// For how long it may make none.
    pub limit: Duration,
}

impl std::fmt::Display for Hang {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Hang {
            helper,
            silent,
            limit,
        } = self;
        let (silent, limit) = (silent.as_secs_f64(), limit.as_secs_f64());
        write!(
            formatter,
            "the helper thread `{helper}` hangs: no turn for {silent:.1} s, {limit:.1} s are the most"
        )
    }
}

/// What was seen of one helper.
#[derive(Clone, Copy, Debug, Default)]
struct HelperProgress {
    turns: u64,
    silent: Duration,
    told: bool,
}

/// Looks for helpers that hang; see [`Helpers::watch`].
pub struct HangWatch {
    helpers: Helpers,
    seen: Vec<HelperProgress>,
    looked: Instant,
    held: u64,
    tell: Box<dyn FnMut(&Hang) + Send>,
}

/// The longest time between two looks that counts as a helper's silence: whoever did not look for longer (a process that
/// was stopped, a machine that is starved) has not seen whether it made turns.
const LOOK_MAX: Duration = Duration::from_secs(1);

impl HangWatch {
    /// The report as it is to be told: one that makes no progress while a helper hangs, and says which.
    pub fn check(&mut self, report: HealthReport) -> HealthReport {
        let since = self.looked.elapsed().min(LOOK_MAX);
        self.looked = Instant::now();
        match self.hang(since) {
            None => {
                self.held = report.progress;
                report
            }
            Some(hang) => HealthReport {
                progress: self.held,
                status: format!("HANGS: {hang}; {}", report.status),
            },
        }
    }

    /// The helper that hangs longest, after another look that came so long after the one before.
    fn hang(&mut self, since: Duration) -> Option<Hang> {
        let beats = self.helpers.beats();
        self.seen.resize(beats.len(), HelperProgress::default());
        let mut worst: Option<Hang> = None;
        for (beat, seen) in beats.iter().zip(&mut self.seen) {
            let turns = beat.turns();
            // One that waits although all were told to begin hangs as well.
            let over = matches!(beat.state(), HelperState::Ended | HelperState::Panicked);
            if turns != seen.turns || over {
                *seen = HelperProgress {
                    turns,
                    ..HelperProgress::default()
                };
                continue;
            }
            seen.silent += since;
            let limit = Duration::from_nanos(beat.limit_ns());
            if seen.silent <= limit {
                continue;
            }
            let hang = Hang {
                helper: beat.name(),
                silent: seen.silent,
                limit,
            };
            if !std::mem::replace(&mut seen.told, true) {
                (self.tell)(&hang);
            }
            if worst.is_none_or(|worst| worst.silent < hang.silent) {
                worst = Some(hang);
            }
        }
        worst
    }
}

/// CLOCK_MONOTONIC, ns; 0 where the system has none.
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
    fn helpers_begin_when_all_are_made_and_end_when_they_are_asked() {
        let helpers = Helpers::default();
        let (tell, told) = channel();
        let work = move |helper: &Helper| {
            while !helper.is_over() {
                helper.turn();
                let _ = tell.send(());
            }
        };
        helpers.spawn("one", LIMIT, work).unwrap();
        assert!(told.try_recv().is_err());
        assert_eq!(helpers.beats()[0].state(), HelperState::Waiting);
        helpers.start();
        told.recv_timeout(LIMIT).unwrap();
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
    fn helpers_that_were_never_let_go_end_without_work() {
        let helpers = Helpers::default();
        helpers.spawn("one", LIMIT, |_| panic!("no work")).unwrap();
        helpers.end();
        assert!(helpers.join(LIMIT, &[]).is_empty());
        assert_eq!(helpers.failure(), None);
    }

    #[test]
    fn who_does_not_end_is_named_and_not_waited_for() {
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

    #[test]
    fn one_that_never_begins_hangs_as_well() {
        let helpers = Helpers::default();
        let _helper = helpers.helper("maker", Duration::from_secs(2));
        let mut watch = helpers.watch(|_| {});
        let hang = watch.hang(Duration::from_secs(3)).unwrap();
        assert_eq!(hang.helper, "maker");
    }

    #[test]
    fn a_hang_stops_the_pulse_and_says_who_and_goes_away_with_the_next_turn() {
        let helpers = Helpers::default();
        let helper = helpers.helper("pump", Duration::from_secs(2));
        let (tell, told) = channel();
        let mut watch = helpers.watch(move |hang| {
            let _ = tell.send(hang.helper);
        });
        helper.turn();
        let second = Duration::from_secs(1);
        assert_eq!(watch.hang(second), None);
        assert_eq!(watch.hang(second), None);
        assert_eq!(watch.hang(second), None, "two seconds are the most");
        let hang = watch.hang(second).unwrap();
        assert_eq!((hang.helper, hang.silent), ("pump", 3 * second));
        let report = watch.check(HealthReport {
            progress: 7,
            status: "fine".to_owned(),
        });
        assert_eq!(report.progress, 0);
        assert!(report.status.contains("`pump` hangs"), "{}", report.status);
        assert_eq!(told.try_iter().count(), 1, "told once");
        helper.turn();
        assert_eq!(watch.hang(second), None);
        helpers.end();
    }
}
