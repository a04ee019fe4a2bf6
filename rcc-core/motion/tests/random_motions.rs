//! Some thousand random motions of each kind, on every robot, under random speeds, pauses and stops, keep their path
//! and limits. The example `random_motions` runs any number.

mod motions;

use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use motions::sampled::kept_and_given;
use motions::{COMPARED, MotionKind, RunOutcome, Tally, case, compared, kinds_and_paces, robots};
use rcc_core::path::{SpeedProfile, StopReserve};
use rcc_testing::quantile;

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
    for (kind, pace) in kinds_and_paces() {
        let mut tally = Tally::default();
        let outcomes = on_all_processors(robots.len() * EACH, |index| {
            case((kind, pace), &robots[index / EACH], (index % EACH) as u64)
        });
        for (index, outcome) in outcomes.into_iter().enumerate() {
            if let Some(fault) = tally.count(outcome) {
                let robot = &robots[index / EACH].name;
                println!(
                    "{kind:?}, {pace:?}, of {robot}, seed {}: {fault}",
                    index % EACH
                );
            }
        }
        let Tally {
            ran,
            refused,
            broken,
            worst,
        } = tally;
        println!(
            "{kind:?}, {pace:?}: {ran} ran, {refused} were refused, {broken} broken, {worst:?}"
        );
        assert!(
            4 * ran > refused,
            "{kind:?}, {pace:?}: {ran} ran, {refused} were refused"
        );
        assert!(broken == 0, "{kind:?}, {pace:?}: {broken} broken");
    }
}

const UNIFORM: SpeedProfile = SpeedProfile::Uniform;

/// Motions that once failed, found among 100,000 of their kind: kind and profile, index of the robot, and seed.
const FOUND: [((MotionKind, SpeedProfile), usize, u64); 5] = [
    // The joints turned by 75 rad/m at the end of a blend of 4 mm, and their derivatives there were 9 % off.
    ((MotionKind::Sequence, UNIFORM), 0, 11_383),
    // Curves so sharp that the reference must sample them at less than a micrometre.
    ((MotionKind::Spline, UNIFORM), 0, 34_427),
    ((MotionKind::Sequence, UNIFORM), 1, 34_269),
    // The joints' third derivatives rose by 2.8 from one of 4,096 steps to the next, which the time law did not take
    // into account.
    (
        (
            MotionKind::Fastest,
            SpeedProfile::TimeOptimal(StopReserve::Keep),
        ),
        0,
        46_223,
    ),
    // A leg that moves the wrist only: the flange covers 230 m per unit of s, and the points of the reference were 0.1
    // mm apart.
    ((MotionKind::Elbow, UNIFORM), 0, 60_092),
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
fn a_more_elaborate_profile_never_takes_longer_and_the_default_takes_little_longer_than_the_soonest()
 {
    const EACH: usize = 20;
    let robots = robots();
    for kind in COMPARED {
        let (mut sooner, mut of_soonest) = (0, Vec::new());
        let results = on_all_processors(robots.len() * EACH, |index| {
            compared(kind, &robots[index / EACH], (index % EACH) as u64)
        });
        for (index, result) in results.into_iter().enumerate() {
            let Some(([uniform_s, adaptive_s, fastest_s], _)) = result else {
                continue;
            };
            assert!(
                adaptive_s <= uniform_s + 2e-3 && fastest_s <= adaptive_s + 2e-3,
                "{kind:?} of {}, seed {}: {fastest_s} s, adaptive {adaptive_s} s, uniform {uniform_s} s",
                robots[index / EACH].name,
                index % EACH
            );
            of_soonest.push(adaptive_s / fastest_s);
            sooner += usize::from(fastest_s < 0.98 * uniform_s);
        }
        let ran = of_soonest.len();
        assert!(ran > 20, "{kind:?}: {ran} ran");
        if kind != MotionKind::Line {
            assert!(2 * sooner > ran, "{kind:?}: {sooner} of {ran}");
        }
        of_soonest.sort_by(f64::total_cmp);
        let [median, most] = [0.5, 0.9].map(|share| quantile(&of_soonest, share).unwrap());
        println!("{kind:?}: of the soonest {median} in the median, {most} at 90 %");
        assert!(
            median < 1.15 && most <= 1.3,
            "{kind:?}: {median}, 90 % {most}"
        );
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
