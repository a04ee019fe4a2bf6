//! A sample of the crash matrix, and a short endurance run. The full runs are programs (docs/crashes.md) that call the
//! same code. Each has a cell of its own.

use std::sync::Arc;
use std::time::Duration;

use rcc_tests::endurance::{self, Options};
use rcc_tests::journal::Journal;
use rcc_tests::matrix::{self, Case, Disturbance, Outcome, Phase, Target, Victim};
use rcc_tests::turns;

#[test]
fn a_sample_of_the_crash_matrix_holds() {
    use {Disturbance::*, Phase::*, Target::*};
    let sample = [
        (ArmDriver, Moving, Kill),
        (ArmDriver, Starting, Kill),
        (ArmDriver, Canceling, Stop),
        (IoDriver, Moving, Segv),
        (Loader, Loading, Kill),
        (Monitor, Moving, Stop),
        (Client, Moving, Kill),
        (Executor, Moving, Kill),
        (Executor, Canceling, Term),
        (Janitor, Idle, Kill),
        (Supervisor, Moving, Stop),
        (Supervisor, Moving, Kill),
        (Loader, Stopping, Kill),
        (ArmDriver, Reconfigured, Kill),
    ];
    let mut cases = sample
        .map(|(target, phase, disturbance)| Case {
            victim: Victim::One(target),
            phase,
            disturbance,
        })
        .to_vec();
    let struck = |victim, disturbance| Case {
        victim,
        phase: Moving,
        disturbance,
    };
    cases.push(struck(Victim::Pair(Loader, Executor), Kill));
    cases.push(struck(Victim::Pair(ArmDriver, IoDriver), Kill));
    cases.push(struck(Victim::Helper("pump"), Freeze));
    let outcomes = matrix::run(&cases, 1, |case, outcome| {
        eprintln!("{case:?}: {outcome:?}")
    });
    let broken: Vec<_> = outcomes
        .iter()
        .filter(|(_, outcome)| matches!(outcome, Outcome::Broken(_)))
        .collect();
    assert!(broken.is_empty(), "{broken:#?}");
}

#[test]
fn twenty_driver_restarts_and_a_hundred_monitors_make_no_cycle_late_and_leave_nothing() {
    let _alone = turns::alone();
    let options = Options {
        time: Duration::from_secs(20),
        seed: 1,
        restarts: 20,
        monitors: 100,
        pairs: 4,
        executor_pairs: 1,
        load: false,
        warm_up: Duration::from_secs(3),
        census_every: Duration::from_secs(10),
    };
    let report = endurance::run(options, &Arc::new(Journal::default()));
    assert!(report.holds(), "{report}");
}
