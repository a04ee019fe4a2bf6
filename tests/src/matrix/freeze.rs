//! Stops a single thread of another process, as a helper that hangs: the process's other threads run on. A stop signal
//! would stop all of them; a tracer stops the one that it seized. One thread, which is the tracer.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Sender};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use nix::sys::ptrace::{self, Options};
use nix::sys::wait::{WaitPidFlag, WaitStatus, waitpid};
use nix::unistd::Pid;

use crate::processes::threads;

/// How often the tracer looks whether the thread is dead.
const LOOK_EVERY: Duration = Duration::from_millis(5);

/// A thread that stands still until this is dropped.
#[derive(Debug)]
pub struct FrozenThread {
    over: Arc<AtomicBool>,
    tracer: Option<JoinHandle<()>>,
}

impl FrozenThread {
    /// Freezes the thread `name` of a process.
    ///
    /// # Panics
    /// There is no such thread, or it may not be traced.
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
        tell.recv().expect("the tracer tells");
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
            // It has nothing to say.
            let _ = tracer.join();
        }
    }
}

/// Freezes, and waits. A traced thread that is killed stays, and with it its whole process, until its tracer has taken
/// its exit status.
fn hold(thread: Pid, told: &Sender<()>, over: &AtomicBool) {
    ptrace::seize(thread, Options::empty()).expect("the thread may be traced");
    ptrace::interrupt(thread).expect("it is ours");
    waitpid(thread, Some(WaitPidFlag::__WALL)).expect("it is ours");
    // Nobody waits any more only if the test has failed.
    let _ = told.send(());
    let look = WaitPidFlag::__WALL | WaitPidFlag::WNOHANG;
    while !over.load(Ordering::Acquire) {
        if !matches!(waitpid(thread, Some(look)), Ok(WaitStatus::StillAlive)) {
            return;
        }
        thread::sleep(LOOK_EVERY);
    }
    // It may have died just now: then there is nothing to let go of.
    let _ = ptrace::detach(thread, None);
}
