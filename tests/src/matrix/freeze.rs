//! Stops a single thread of another process while its other threads run on, to simulate a hung helper thread. SIGSTOP
//! would stop the whole process, so the thread is seized with ptrace. Runs on one thread, the tracer.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Sender};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use nix::sys::ptrace::{self, Options};
use nix::sys::wait::{WaitPidFlag, WaitStatus, waitpid};
use nix::unistd::Pid;

use crate::processes::threads;

/// Interval at which the tracer checks whether the thread is dead.
const LOOK_EVERY: Duration = Duration::from_millis(5);

/// A thread of another process that is stopped until this is dropped.
#[derive(Debug)]
pub struct FrozenThread {
    over: Arc<AtomicBool>,
    tracer: Option<JoinHandle<()>>,
}

impl FrozenThread {
    /// Freezes the thread `name` of a process.
    ///
    /// # Panics
    /// Panics if the thread does not exist or cannot be traced.
    pub fn thread(process: u32, name: &str) -> FrozenThread {
        let names = threads(process);
        let found = names.iter().find(|(_, other)| other == name);
        let (thread, _) = found.unwrap_or_else(|| panic!("no thread `{name}` in {names:?}"));
        let thread = Pid::from_raw(thread.cast_signed());
        let over = Arc::new(AtomicBool::new(false));
        let (told, tell) = mpsc::channel();
        // Set by `drop` (Release), loaded by the tracer (Acquire).
        let is_over = Arc::clone(&over);
        let tracer = thread::spawn(move || hold(thread, &told, &is_over));
        tell.recv()
            .expect("the tracer reports that the thread is frozen");
        FrozenThread {
            over,
            tracer: Some(tracer),
        }
    }
}

impl Drop for FrozenThread {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Release);
        if let Some(tracer) = self.tracer.take() {
            // A panic of the tracer was already printed.
            let _ = tracer.join();
        }
    }
}

/// Freezes the thread until `over` is set or the thread dies. The tracer must reap it: a traced thread that is killed,
/// and with it its process, remains until the tracer has read its exit status.
fn hold(thread: Pid, told: &Sender<()>, over: &AtomicBool) {
    ptrace::seize(thread, Options::empty()).expect("the thread may be traced");
    ptrace::interrupt(thread).expect("the thread was seized");
    waitpid(thread, Some(WaitPidFlag::__WALL)).expect("the thread was seized");
    // Fails only if the test has already failed and dropped the receiver.
    let _ = told.send(());
    let look = WaitPidFlag::__WALL | WaitPidFlag::WNOHANG;
    while !over.load(Ordering::Acquire) {
        if !matches!(waitpid(thread, Some(look)), Ok(WaitStatus::StillAlive)) {
            return;
        }
        thread::sleep(LOOK_EVERY);
    }
    // Fails if the thread has just died; there is nothing to detach from then.
    let _ = ptrace::detach(thread, None);
}
