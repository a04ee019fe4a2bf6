//! Some thousand random motions of each kind, on every robot, under random speeds, pauses and stops, keep their path
//! and limits. The example `random_motions` runs any number.

mod motions;

use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use motions::sampled::kept_and_given;
use motions::{COMPARED, KINDS, MotionKind, RunOutcome, Tally, case, compared, robots};

/// Motions of each kind and robot.
const EACH: usize = 100;

/// Computes `count` results, in their order, on all processors.
fn on_all_processors<T: Send>(count: usize, result: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let next = AtomicUsize::new(0);
    let take = || {
        let indices = std::iter::from_fn(|| Some(next.fetch_add(1, Ordering::Relaxed)));
        let own = indices.take_while(|index| *index < count);
        own.map(|index| (index, result(index))).collect()
    };
    let processors = thread::available_parallelism().map_or(1, usize::from);
    let mut results: Vec<(usize, T)> = thread::scope(|scope| {
        let threads: Vec<_> = (0..processors).map(|_| scope.spawn(take)).collect();
        let joined = threads.into_iter().map(|thread| thread.join());
        joined
            .flat_map(|own: thread::Result<Vec<_>>| own.expect("no panic"))
            .collect()
    });
    results.sort_by_key(|(index, _)| *index);
    results.into_iter().map(|(_, result)| result).collect()
}

#[test]
fn random_motions_stay_on_their_path_and_within_their_limits_under_any_override() {
    let robots = robots();
    for kind in KINDS {
        let mut tally = Tally::default();
        let outcomes = on_all_processors(robots.len() * EACH, |index| {
            case(kind, &robots[index / EACH], (index % EACH) as u64)
        });
        for (index, outcome) in outcomes.into_iter().enumerate() {
            if let Some(fault) = tally.count(outcome) {
                let robot = &robots[index / EACH].name;
                println!("{kind:?} of {robot}, seed {}: {fault}", index % EACH);
            }
        }
        let Tally {
            ran,
            refused,
            broken,
            worst,
        } = tally;
        println!("{kind:?}: {ran} ran, {refused} were refused, {broken} broken, {worst:?}");
        assert!(
            4 * ran > refused,
            "{kind:?}: {ran} ran, {refused} were refused"
        );
        assert!(broken == 0, "{kind:?}: {broken} broken");
    }
}

/// Motions that once failed, found among 100,000 of their kind: kind, index of the robot, and seed.
const FOUND: [(MotionKind, usize, u64); 5] = [
    // The joints turned by 75 rad/m at the end of a blend of 4 mm, and their derivatives there were 9 % off.
    (MotionKind::Sequence, 0, 11_383),
    // Curves so sharp that the reference must sample them at less than a micrometre.
    (MotionKind::Spline, 0, 34_427),
    (MotionKind::Sequence, 1, 34_269),
    // The joints' third derivatives rose by 2.8 from one of 4,096 steps to the next, which the time law did not take
    // into account.
    (MotionKind::Fastest, 0, 46_223),
    // A leg that moves the wrist only: the flange covers 230 m per unit of s, and the points of the reference were 0.1
    // mm apart.
    (MotionKind::Elbow, 0, 60_092),
];

#[test]
fn motions_that_once_failed_are_kept() {
    let robots = robots();
    for (kind, robot, seed) in FOUND {
        let outcome = case(kind, &robots[robot], seed);
        assert!(
            matches!(outcome, RunOutcome::Ran(_)),
            "{kind:?} of {}, seed {seed}: {outcome:?}",
            robots[robot].name
        );
    }
}

#[test]
fn time_optimal_motions_never_take_longer_and_most_are_faster() {
    const EACH: usize = 20;
    let robots = robots();
    for kind in [MotionKind::Spline, MotionKind::Sequence] {
        let (mut sooner, mut ran) = (0, 0);
        let results = on_all_processors(robots.len() * EACH, |index| {
            compared(kind, &robots[index / EACH], (index % EACH) as u64)
        });
        for (index, result) in results.into_iter().enumerate() {
            let Some(([uniform_s, fastest_s], _)) = result else {
                continue;
            };
            assert!(
                fastest_s <= uniform_s + 2e-3,
                "{kind:?} of {}, seed {}: {fastest_s} s, uniform {uniform_s} s",
                robots[index / EACH].name,
                index % EACH
            );
            ran += 1;
            sooner += usize::from(fastest_s < 0.98 * uniform_s);
        }
        assert!(2 * sooner > ran && ran > 20, "{kind:?}: {sooner} of {ran}");
    }
}

/// Motions that once took longer with `stops: give` than with `stops: keep`, because the search for the law ended in another
/// optimum: kind, index of the robot, and seed.
const LATER: [(MotionKind, usize, u64); 11] = [
    (MotionKind::Spline, 0, 104),
    (MotionKind::Spline, 0, 141),
    (MotionKind::Spline, 2, 3),
    (MotionKind::Spline, 3, 14),
    (MotionKind::Spline, 3, 45),
    (MotionKind::Spline, 4, 37),
    (MotionKind::Spline, 4, 56),
    (MotionKind::Sequence, 2, 17),
    (MotionKind::Sequence, 2, 31),
    (MotionKind::Sequence, 2, 68),
    (MotionKind::Sequence, 3, 40),
];

#[test]
fn a_motion_that_gives_its_reserve_never_takes_longer_than_one_that_keeps_it() {
    /// Motions of each kind and robot, beside those that were found.
    const EACH: u64 = 4;
    let robots = robots();
    let others = COMPARED.into_iter().flat_map(|kind| {
        let of_robot = move |robot| (0..EACH).map(move |seed| (kind, robot, seed));
        (0..robots.len()).flat_map(of_robot)
    });
    let cases: Vec<_> = LATER.into_iter().chain(others).collect();
    let results = on_all_processors(cases.len(), |index| {
        let (kind, robot, seed) = cases[index];
        kept_and_given(kind, &robots[robot], seed)
    });
    let (mut built, mut later) = (0, 0);
    for ((kind, robot, seed), result) in cases.into_iter().zip(results) {
        let Some([[keep_s, give_s], _]) = result else {
            continue;
        };
        built += 1;
        if give_s > keep_s * (1.0 + 1e-9) {
            later += 1;
            let robot = robots[robot].name;
            println!("{kind:?} of {robot}, seed {seed}: {give_s} s, keep {keep_s} s");
        }
    }
    assert!(later == 0, "{later} of {built} take longer");
    assert!(built >= LATER.len() + 20, "only {built} were built");
}
