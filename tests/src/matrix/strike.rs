//! Injects the fault of a case into its target processes, all at the same moment.
//! Runs on the thread of the matrix.

use std::time::Duration;

use nix::sys::signal::Signal;

use super::freeze::FrozenThread;
use super::scene::Scene;
use super::{Case, Disturbance, Victim};
use crate::processes::signal;

/// How long a process is stopped by SIGSTOP: longer than any deadline of a driver, shorter than the supervisor's
/// watchdog.
const STOPPED: Duration = Duration::from_millis(300);

/// An injected fault. A frozen thread stays frozen until this is dropped.
#[derive(Debug)]
pub struct Strike {
    met_all: bool,
    _frozen: Option<FrozenThread>,
}

impl Strike {
    /// Injects the fault of `case` into the processes listed in `scene`.
    ///
    /// # Panics
    /// Panics if the executor has no helper thread of the case's name, or if the thread cannot be traced.
    pub fn at(case: Case, scene: &Scene) -> Strike {
        let pids: Vec<u32> = scene.struck.iter().map(|struck| struck.pid).collect();
        if let (Victim::Helper(name), &[executor]) = (case.victim, &pids[..]) {
            return Strike {
                met_all: true,
                _frozen: Some(FrozenThread::thread(executor, name)),
            };
        }
        Strike {
            met_all: strike(&pids, case.disturbance),
            _frozen: None,
        }
    }

    /// False if one of the processes had already exited.
    pub fn met_all(&self) -> bool {
        self.met_all
    }
}

/// Sends the signals of `way`; false if one of the processes had already exited.
fn strike(pids: &[u32], disturbance: Disturbance) -> bool {
    let all = |with: Signal| {
        let met = pids.iter().filter(|pid| signal(**pid, with)).count();
        met == pids.len()
    };
    match disturbance {
        Disturbance::Kill => all(Signal::SIGKILL),
        Disturbance::Segv => {
            let there = all(Signal::SIGSEGV);
            // At the first SIGSEGV that is not a stack overflow, Rust's handler restores the default action and
            // returns, because a real fault would recur at once. It is sent repeatedly because pending signals of the
            // same number merge under load.
            for _ in 0..6 {
                std::thread::sleep(Duration::from_millis(4));
                all(Signal::SIGSEGV);
            }
            there
        }
        Disturbance::Term => all(Signal::SIGTERM),
        Disturbance::Stop => {
            let there = all(Signal::SIGSTOP);
            std::thread::sleep(STOPPED);
            all(Signal::SIGCONT) && there
        }
        Disturbance::Freeze => unreachable!("only a thread is frozen"),
    }
}
