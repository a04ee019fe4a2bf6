//! The crash matrix: each process, in each phase of a cell, made to die or hang in each way, two processes at once, and
//! each helper thread of the executor alone; what must hold then. Run by one thread, one case at a time.

mod freeze;
mod scene;
mod stage;
mod strike;
mod table;

use std::panic::{AssertUnwindSafe, catch_unwind};

pub use stage::Stage;
pub use table::table;

/// A kind of process.
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

/// Target of a case.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Victim {
    /// One process.
    One(Target),
    /// Two processes at the same moment.
    Pair(Target, Target),
    /// One thread of the executor, by its name, while all others run on.
    Helper(&'static str),
}

impl Case {
    /// True if this process does not live on: it is struck, and not only for a while.
    fn ends(self, target: Target) -> bool {
        self.victim.touches(target) && self.disturbance != Disturbance::Stop
    }

    /// True if the whole cell ends.
    fn ends_cell(self) -> bool {
        let starting = self.phase == Phase::Starting && self.victim.touches(Target::Supervisor);
        self.phase == Phase::Stopping || starting || self.ends(Target::Supervisor)
    }
}

impl Victim {
    /// The processes that are struck.
    pub fn targets(self) -> Vec<Target> {
        match self {
            Victim::One(target) => vec![target],
            Victim::Pair(first, second) => vec![first, second],
            Victim::Helper(_) => vec![Target::Executor],
        }
    }

    /// True if the process, or a thread of it, is struck.
    pub fn touches(self, target: Target) -> bool {
        self.targets().contains(&target)
    }
}

/// Activity of the cell at that moment.
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
    Canceling,
    /// The arm moves, and two outputs have changed places in the configuration's file since the cell was started.
    Reconfigured,
    /// The arm moves, and the cell is being ended by Ctrl-C.
    Stopping,
}

/// The signal, or the freezing of a thread, by which a case disturbs its target.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Disturbance {
    /// SIGKILL.
    Kill,
    /// SIGSEGV.
    Segv,
    /// SIGSTOP, and SIGCONT after a while.
    Stop,
    /// SIGTERM: it may end in order.
    Term,
    /// It is not scheduled any more, and never again: only for a thread.
    Freeze,
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
pub const PHASES: [(Phase, &str); 7] = [
    (Phase::Starting, "starting"),
    (Phase::Idle, "idle"),
    (Phase::Loading, "loading"),
    (Phase::Moving, "moving"),
    (Phase::Canceling, "canceling"),
    (Phase::Reconfigured, "moving, its file changed"),
    (Phase::Stopping, "stopping"),
];

/// Ways with their names.
pub const DISTURBANCES: [(Disturbance, &str); 4] = [
    (Disturbance::Kill, "SIGKILL"),
    (Disturbance::Segv, "SIGSEGV"),
    (Disturbance::Stop, "SIGSTOP, SIGCONT"),
    (Disturbance::Term, "SIGTERM"),
];

/// Helper threads of the executor, by name; without the real-time thread and the main thread, which only waits.
pub const HELPERS: [&str; 6] = [
    "intake",
    "net-builder",
    "pump",
    "incidents",
    "events",
    "notify",
];

/// One case.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Case {
    /// Target: a process, two of them, or a thread.
    pub victim: Victim,
    /// Phase of the cell in which the target is disturbed.
    pub phase: Phase,
    /// Signal.
    pub disturbance: Disturbance,
}

/// All cases, in the order of the tables.
pub fn cases() -> Vec<Case> {
    let mut all = Vec::new();
    for (target, _) in TARGETS {
        let victim = Victim::One(target);
        for (phase, _) in PHASES {
            all.extend(DISTURBANCES.map(|(disturbance, _)| Case {
                victim,
                phase,
                disturbance,
            }));
        }
    }
    all.extend(pairs());
    all.extend(HELPERS.map(|name| Case {
        victim: Victim::Helper(name),
        phase: Phase::Moving,
        disturbance: Disturbance::Freeze,
    }));
    all
}

/// Every two processes, killed at the same moment while the arm moves.
fn pairs() -> impl Iterator<Item = Case> {
    let victims = TARGETS.iter().enumerate().flat_map(|(place, &(first, _))| {
        let others = TARGETS[place + 1..].iter();
        others.map(move |&(second, _)| Victim::Pair(first, second))
    });
    victims.map(|victim| Case {
        victim,
        phase: Phase::Moving,
        disturbance: Disturbance::Kill,
    })
}

/// Outcome of a case.
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

/// A cell is ended after so many cases, so that its end is part of what is checked.
const CASES_OF_A_CELL: usize = 30;

/// Runs cases one after the other; `tell` hears of each. A broken one gets a new cell for those after it.
pub fn run(
    cases: &[Case],
    seed: u64,
    mut tell: impl FnMut(&Case, &Outcome),
) -> Vec<(Case, Outcome)> {
    let mut stage = None;
    let mut all = Vec::new();
    for (number, case) in cases.iter().enumerate() {
        if number % CASES_OF_A_CELL == 0
            && let Some(stage) = stage.take()
        {
            Stage::end(stage);
        }
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
