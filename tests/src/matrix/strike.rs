//! Strikes the victims of a case, all at the same moment.
//! Run by the thread of the matrix.

use std::time::Duration;

use nix::sys::signal::Signal;

use super::freeze::FrozenThread;
use super::scene::Scene;
use super::{Case, Victim, Way};
use crate::processes::signal;

/// How long a stopped process stands still: longer than any deadline of a driver, shorter than a watchdog's.
const STOPPED: Duration = Duration::from_millis(300);

/// What was done; a frozen thread stays frozen while this lives.
#[derive(Debug)]
pub struct Strike {
    met_all: bool,
    _frozen: Option<FrozenThread>,
}

impl Strike {
    /// Strikes.
    ///
    /// # Panics
    /// The executor has no thread of that name, or it cannot be traced.
    pub fn at(case: Case, scene: &Scene) -> Strike {
        let pids: Vec<u32> = scene.struck.iter().map(|struck| struck.pid).collect();
        if let (Victim::Helper(name), &[executor]) = (case.victim, &pids[..]) {
            return Strike {
                met_all: true,
                _frozen: Some(FrozenThread::thread(executor, name)),
            };
        }
        Strike {
            met_all: strike(&pids, case.way),
            _frozen: None,
        }
    }

    /// False if one of them had ended already.
    pub fn met_all(&self) -> bool {
        self.met_all
    }
}

/// False if one of them was there no more.
fn strike(pids: &[u32], way: Way) -> bool {
    let all = |with: Signal| {
        let met = pids.iter().filter(|pid| signal(**pid, with)).count();
        met == pids.len()
    };
    match way {
        Way::Kill => all(Signal::SIGKILL),
        Way::Segv => {
            let there = all(Signal::SIGSEGV);
            // The runtime of Rust gives the first one its usual meaning, in case that it was no overflow of a stack: a
            // real fault would happen again at once. Under load some of these are one.
            for _ in 0..6 {
                std::thread::sleep(Duration::from_millis(4));
                all(Signal::SIGSEGV);
            }
            there
        }
        Way::Term => all(Signal::SIGTERM),
        Way::Stop => {
            let there = all(Signal::SIGSTOP);
            std::thread::sleep(STOPPED);
            all(Signal::SIGCONT) && there
        }
        Way::Freeze => unreachable!("only a thread is frozen"),
    }
}
