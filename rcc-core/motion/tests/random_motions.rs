//! Some thousand random motions of each kind, on every robot, under random speeds, pauses and stops, keep their path
//! and limits. The example `random_motions` runs any number.

mod motions;

use motions::{KINDS, MotionKind, RunOutcome, WorstCase, case, compared, robots};

/// Motions of each kind and robot.
const EACH: u64 = 100;

#[test]
fn random_motions_stay_on_their_path_and_within_their_limits_under_any_override() {
    for kind in KINDS {
        let (mut ran, mut refused, mut broken) = (0, 0, 0);
        let mut worst = WorstCase::default();
        for robot in robots() {
            for seed in 0..EACH {
                match case(kind, &robot, seed) {
                    RunOutcome::Ran(motion) => {
                        ran += 1;
                        worst.and(motion);
                    }
                    RunOutcome::Refused => refused += 1,
                    RunOutcome::Broken(fault) => {
                        broken += 1;
                        println!("{kind:?} of {}, seed {seed}: {fault}", robot.name);
                    }
                }
            }
        }
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
    for kind in [MotionKind::Spline, MotionKind::Sequence] {
        let (mut sooner, mut ran) = (0, 0);
        for robot in robots() {
            for seed in 0..20 {
                let Some(([uniform_s, fastest_s], _)) = compared(kind, &robot, seed) else {
                    continue;
                };
                assert!(
                    fastest_s <= uniform_s + 2e-3,
                    "{kind:?} of {}, seed {seed}: {fastest_s} s, uniform {uniform_s} s",
                    robot.name
                );
                ran += 1;
                sooner += usize::from(fastest_s < 0.98 * uniform_s);
            }
        }
        assert!(2 * sooner > ran && ran > 20, "{kind:?}: {sooner} of {ran}");
    }
}
