//! Some thousand random motions of each kind, on every robot, under random speeds, pauses and stops, keep every promise.
//! The example `random_motions` runs as many as one likes.

mod motions;

use motions::{Kind, Outcome, Worst, case, robots};

/// Motions of each kind and robot.
const EACH: u64 = 100;

/// The kinds that keep every promise. Splines, alone or in a sequence, exceed limits of joints between the places at which
/// their bounds are computed; the example shows each of them.
const KEPT: [Kind; 4] = [Kind::Poses, Kind::Line, Kind::Circle, Kind::PointToPoint];

#[test]
fn random_motions_stay_on_their_path_and_within_their_limits_whatever_they_are_told() {
    for kind in KEPT {
        let (mut ran, mut refused, mut broken) = (0, 0, 0);
        let mut worst = Worst::default();
        for robot in robots() {
            for seed in 0..EACH {
                match case(kind, &robot, seed) {
                    Outcome::Ran(motion) => {
                        ran += 1;
                        worst.and(motion);
                    }
                    Outcome::Refused => refused += 1,
                    Outcome::Broken(fault) => {
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
