//! The crash matrix: each process, in each phase of a cell, made to die or hang in each way; what must hold then.
//! Run by one thread, one case at a time.

mod stage;
mod table;

use std::panic::{AssertUnwindSafe, catch_unwind};

pub use stage::Stage;
pub use table::table;

/// Who dies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// The driver of the arm.
    ArmDriver,
    /// The driver of the I/O station.
    IoDriver,
    /// The loader.
    Loader,
    /// A monitor, `rcc-monitor tail`.
    Monitor,
    /// A client, `rcc-cli`.
    Client,
    /// The supervisor, `rcc-cli up`.
    Supervisor,
    /// The executor.
    Executor,
    /// The janitor.
    Janitor,
}

/// What the cell is doing meanwhile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// The process itself has just been started.
    Starting,
    /// No net runs.
    Idle,
    /// A big net is being loaded.
    Loading,
    /// The arm moves.
    Moving,
    /// The arm is being brought to rest on its path by CANCEL.
    Cancelling,
    /// The arm moves, and the cell is being ended by Ctrl-C.
    Stopping,
}

/// How it dies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// SIGKILL.
    Kill,
    /// SIGSEGV.
    Segv,
    /// SIGSTOP, and SIGCONT after a while.
    Stop,
    /// SIGTERM: it may end in order.
    Term,
}

/// A row of the table with its name.
pub const TARGETS: [(Target, &str); 8] = [
    (Target::ArmDriver, "driver of the arm"),
    (Target::IoDriver, "driver of the I/O station"),
    (Target::Loader, "loader"),
    (Target::Monitor, "monitor"),
    (Target::Client, "client"),
    (Target::Supervisor, "supervisor"),
    (Target::Executor, "executor"),
    (Target::Janitor, "janitor"),
];

/// Phases with their names.
pub const PHASES: [(Phase, &str); 6] = [
    (Phase::Starting, "starting"),
    (Phase::Idle, "idle"),
    (Phase::Loading, "loading"),
    (Phase::Moving, "moving"),
    (Phase::Cancelling, "cancelling"),
    (Phase::Stopping, "stopping"),
];

/// Ways with their names.
pub const WAYS: [(Way, &str); 4] = [
    (Way::Kill, "SIGKILL"),
    (Way::Segv, "SIGSEGV"),
    (Way::Stop, "SIGSTOP, SIGCONT"),
    (Way::Term, "SIGTERM"),
];

/// One case.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Case {
    /// Who.
    pub target: Target,
    /// When.
    pub phase: Phase,
    /// How.
    pub way: Way,
}

/// All cases, in the order of the table.
pub fn cases() -> Vec<Case> {
    let mut all = Vec::new();
    for (target, _) in TARGETS {
        for (phase, _) in PHASES {
            all.extend(WAYS.map(|(way, _)| Case { target, phase, way }));
        }
    }
    all
}

/// What came out of a case.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Everything that must hold, holds; how the arm's motion ended, and late cycles of the machine.
    Held {
        /// In a word or two.
        words: String,
        /// Late cycles that the reference thread explains.
        late: u64,
    },
    /// Something does not hold.
    Broken(String),
}

/// Runs cases one after the other; `tell` hears of each. A broken one gets a new cell for those after it.
pub fn run(
    cases: &[Case],
    seed: u64,
    mut tell: impl FnMut(&Case, &Outcome),
) -> Vec<(Case, Outcome)> {
    let mut stage = None;
    let mut all = Vec::new();
    for (number, case) in cases.iter().enumerate() {
        let outcome = catch_unwind(AssertUnwindSafe(|| {
            let seed = seed.wrapping_add(number as u64);
            stage.get_or_insert_with(Stage::new).play(*case, seed)
        }));
        let outcome = outcome.unwrap_or_else(|cause| {
            stage = None;
            let words = cause.downcast_ref::<String>().cloned();
            let words = words.or_else(|| cause.downcast_ref::<&str>().map(|&s| s.to_owned()));
            Outcome::Broken(words.unwrap_or_default())
        });
        tell(case, &outcome);
        all.push((*case, outcome));
    }
    if let Some(stage) = stage {
        stage.end();
    }
    all
}
