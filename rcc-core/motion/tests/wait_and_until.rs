//! Legs with `wait` and `until` under random conditions, speeds, pauses and stops: every set-point keeps the limits of
//! each joint, lines stay straight, what follows begins where the arm came to rest, and nothing is allocated.

use assert_no_alloc::{AllocDisabler, assert_no_alloc};
use rcc_core::frame::{DeviceModel, PrepareFault};
use rcc_core::message::Joints;
use rcc_core::path::{
    AfterUntilFault, Leg, LegConditions, LegSignals, MotionBuilder, MotionFault, MotionLimits,
    MotionState, Motions, PathRequest, PathSegment, RelativeTo, SpeedOverride, SpeedProfile,
    StopReserve,
};
use rcc_core::pose::Pose;
use rcc_motion::{MotionSet, MotionSetBuilder};
use rcc_testing::arms::{HOLD, lwr};
use rcc_testing::{Random, Rng};

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

const DT: f64 = 1e-3;
const LINE: MotionLimits = MotionLimits {
    velocity: 0.2,
    acceleration: 1.0,
    jerk: 10.0,
};

fn start() -> Pose {
    lwr().arm.unwrap().forward(&HOLD)
}

fn at(xyz: [f64; 3]) -> Pose {
    start().compose(&Pose::from_xyz_rpy(xyz, [0.0; 3]))
}

fn lin(xyz: [f64; 3]) -> Leg<'static> {
    let turn = MotionLimits {
        velocity: 1.0,
        acceleration: 5.0,
        jerk: 50.0,
    };
    Leg {
        line: LINE,
        turn,
        ..Leg::new(PathSegment::Line { to: at(xyz) })
    }
}

fn ptp(by: f64) -> Leg<'static> {
    let to: Joints = core::array::from_fn(|joint| match joint {
        7 => f64::NAN,
        _ => HOLD[joint] + by * if joint % 2 == 0 { 1.0 } else { -1.0 },
    });
    Leg::new(PathSegment::Joints { to })
}

fn built(legs: &[Leg<'_>], pace: SpeedProfile) -> Result<MotionSet, PrepareFault> {
    let (models, holds) = ([lwr()], [Some(HOLD)]);
    let mut builder = MotionSetBuilder::new(&models, &holds, DT, 1);
    let request = PathRequest {
        device: 0,
        from: None,
        legs,
        pace,
    };
    builder.path(0, &request)?;
    builder.finish()
}

/// Steps a motion with the values of its conditions.
fn step(motions: &mut MotionSet, speed: SpeedOverride, holds: impl Fn(u32) -> bool) -> MotionState {
    let LegConditions { wait, until } = motions.leg_conditions(0);
    let signals = LegSignals {
        begin: wait.is_none_or(&holds),
        end: until.is_some_and(&holds),
    };
    motions.step_leg(0, speed, signals).unwrap()
}

/// Judges the set-points of a motion by their differences.
struct Judge {
    model: DeviceModel,
    last: [Option<Joints>; 3],
    /// Largest velocity, acceleration and jerk as parts of their limits.
    worst: [f64; 3],
}

impl Judge {
    fn new() -> Self {
        Self {
            model: lwr(),
            last: [Some(HOLD); 3],
            worst: [0.0; 3],
        }
    }

    fn judge(&mut self, now: &Joints) {
        let [a, b, c] = self.last.map(|joints| joints.unwrap());
        let limits = &self.model.limits;
        for joint in 0..limits.joints {
            let (p3, p2, p1, p) = (a[joint], b[joint], c[joint], now[joint]);
            assert!(limits.lower[joint] <= p && p <= limits.upper[joint]);
            let rates = [
                (p - p1) / DT / limits.velocity_max[joint],
                (p - 2.0 * p1 + p2) / DT.powi(2) / limits.acceleration_max[joint],
                (p - 3.0 * p1 + 3.0 * p2 - p3) / DT.powi(3) / limits.jerk_max[joint],
            ];
            for (worst, rate) in self.worst.iter_mut().zip(rates) {
                *worst = worst.max(rate.abs());
            }
        }
        self.last = [self.last[1], self.last[2], Some(*now)];
    }

    fn keeps_the_limits(&self) -> bool {
        let [velocity, acceleration, jerk] = self.worst;
        velocity <= 1.0 + 1e-6 && acceleration <= 1.0 + 1e-4 && jerk <= 1.01
    }
}

/// Legs with random conditions; some of them cannot follow each other.
fn legs(random: &mut Rng) -> Vec<Leg<'static>> {
    let mut conditions = 0;
    let mut next = |wanted: bool| {
        conditions += u32::from(wanted);
        wanted.then(|| conditions - 1)
    };
    let mut ended = false;
    let mut by_joints = false;
    let count = 2 + random.below(4);
    let legs = (0..count).map(|_| {
        let mut around = |by: f64| random.uniform(-by, by);
        let mut line = lin([around(0.12), around(0.12), around(0.12)]);
        let joints = ptp(around(0.5));
        if random.once_in(2) {
            // As fast as the joints allow.
            (line.line, line.turn) = (MotionLimits::NONE, MotionLimits::NONE);
        }
        // A line is possible after a line that began at a known place.
        by_joints = if ended { by_joints } else { random.once_in(2) };
        let mut leg = if by_joints { joints } else { line };
        leg.wait = next(random.once_in(3));
        let until = random.once_in(2);
        by_joints |= ended && until;
        leg.until = next(until);
        ended = until;
        leg
    });
    legs.collect()
}

const PACES: [SpeedProfile; 4] = [
    SpeedProfile::Uniform,
    SpeedProfile::Adaptive,
    SpeedProfile::TimeOptimal(StopReserve::Keep),
    SpeedProfile::TimeOptimal(StopReserve::Give),
];

#[test]
fn random_legs_keep_every_limit_whenever_their_conditions_hold() {
    let (mut ran, mut ended, mut refused) = (0, 0, 0);
    let mut worst = [0.0_f64; 3];
    for seed in 0..200 {
        let mut random = Rng::with_seed(seed);
        let mut legs = legs(&mut random);
        let pace = PACES[random.below(PACES.len())];
        if random.once_in(2) {
            // Without a given speed the adaptive profile may follow a time law.
            for leg in &mut legs {
                leg.line = MotionLimits::NONE;
            }
        }
        let Ok(mut motions) = built(&legs, pace) else {
            refused += 1;
            continue;
        };
        let holds_from: Vec<usize> = (0..16).map(|_| random.below(6000)).collect();
        let stop_at = if random.once_in(4) {
            random.below(8000)
        } else {
            usize::MAX
        };
        let (mut judge, mut speed) = (Judge::new(), SpeedOverride::RUN);
        let mut before = MotionState {
            progress: 0.0,
            ..first(&legs, pace)
        };
        let mut is_done = false;
        for cycle in 0..60_000 {
            if random.once_in(700) {
                speed = random.speed_override();
            }
            speed.stop = cycle >= stop_at;
            let holds = |index: u32| cycle >= holds_from[index as usize];
            let state = assert_no_alloc(|| step(&mut motions, speed, holds));
            judge.judge(&state.joints);
            assert!(
                state.progress >= before.progress,
                "seed {seed}, cycle {cycle}"
            );
            // On a planned line of joints the distance is that of the leg, in proportion.
            assert!(
                state.distance >= before.distance - 1e-12,
                "seed {seed}, cycle {cycle}"
            );
            if state.until_met && !before.until_met {
                ended += 1;
            }
            before = state;
            is_done = state.path.done;
            if is_done {
                break;
            }
        }
        assert!(is_done, "seed {seed}: {before:?}");
        assert!(
            judge.keeps_the_limits(),
            "seed {seed}: {:?}, {legs:?}",
            judge.worst
        );
        for (all, one) in worst.iter_mut().zip(judge.worst) {
            *all = all.max(one);
        }
        ran += 1;
    }
    println!(
        "{ran} ran, {ended} legs were ended, {refused} refused, at most {worst:?} of the limits"
    );
    assert!(ran > 3 * refused && ended > 100, "{ran} {ended} {refused}");
}

fn first(legs: &[Leg<'_>], pace: SpeedProfile) -> MotionState {
    step(&mut built(legs, pace).unwrap(), SpeedOverride::RUN, |_| {
        false
    })
}

#[test]
fn the_line_after_until_is_straight_and_ends_at_its_goal() {
    let mut down = lin([0.0, 0.0, 0.1]);
    down.until = Some(0);
    let legs = [down, lin([0.0, 0.1, 0.0]), ptp(0.1)];
    for ends_at in [1, 100, 300, 700] {
        let mut motions = built(&legs, SpeedProfile::Uniform).unwrap();
        let (mut cycle, mut rest) = (0, None);
        loop {
            cycle += 1;
            let state = step(&mut motions, SpeedOverride::RUN, |_| cycle >= ends_at);
            if !state.until_met {
                continue;
            }
            let from: Pose = *rest.get_or_insert(state.pose);
            if state.leg == 2 {
                break;
            }
            let goal = at([0.0, 0.1, 0.0]);
            let way = from.distance_to(&goal);
            let sum = from.distance_to(&state.pose) + state.pose.distance_to(&goal);
            assert!(sum - way < 1e-9, "{ends_at}: {sum} {way}");
            assert!(state.speed <= LINE.velocity * (1.0 + 1e-9));
        }
    }
}

#[test]
fn a_condition_that_never_holds_changes_nothing_and_is_told() {
    let plain = [lin([0.0, 0.0, 0.1]), lin([0.0, 0.1, 0.0])];
    let mut with = plain;
    with[0].until = Some(0);
    for pace in PACES {
        let (mut a, mut b) = (built(&plain, pace).unwrap(), built(&with, pace).unwrap());
        loop {
            let state = step(&mut a, SpeedOverride::RUN, |_| false);
            let same = step(&mut b, SpeedOverride::RUN, |_| false);
            assert_eq!((state.joints, state.path), (same.joints, same.path));
            if state.path.done {
                assert!(!same.until_met);
                break;
            }
        }
    }
}

#[test]
fn a_leg_that_waits_stays_at_rest_until_its_condition_holds_even_without_a_length() {
    let mut nowhere = lin([0.0; 3]);
    nowhere.wait = Some(0);
    let legs = [nowhere, lin([0.0, 0.0, 0.1])];
    let mut motions = built(&legs, SpeedProfile::Uniform).unwrap();
    for _ in 0..500 {
        let state = step(&mut motions, SpeedOverride::RUN, |_| false);
        assert!(state.waiting && !state.path.done && state.leg == 0);
        assert_eq!(state.distance, 0.0);
    }
    let mut cycles = 0;
    while !step(&mut motions, SpeedOverride::RUN, |_| true).path.done {
        cycles += 1;
    }
    assert!(cycles > 500, "{cycles}");
    // A stop ends a motion that waits.
    let mut motions = built(&legs, SpeedProfile::Uniform).unwrap();
    step(&mut motions, SpeedOverride::RUN, |_| false);
    assert!(step(&mut motions, SpeedOverride::STOP, |_| false).path.done);
}

#[test]
fn a_stop_while_a_leg_is_being_ended_is_final() {
    let mut down = lin([0.0, 0.0, 0.1]);
    down.until = Some(0);
    let legs = [down, lin([0.0, 0.1, 0.0])];
    // Before the leg is being ended, while the arm brakes for it, and on the line that follows.
    for (stop_at, leg) in [(190, 0), (210, 0), (900, 1)] {
        let mut motions = built(&legs, SpeedProfile::Uniform).unwrap();
        let mut rest = None;
        for cycle in 0..4000 {
            let stop = SpeedOverride {
                stop: cycle == stop_at,
                ..SpeedOverride::RUN
            };
            let state = step(&mut motions, stop, |_| cycle >= 200);
            assert!(!state.path.done || cycle > stop_at, "{stop_at}: {state:?}");
            if state.path.done {
                assert!(state.path.stopping, "{stop_at}: {state:?}");
                assert_eq!(state.leg, leg, "{stop_at}");
                assert_eq!(state.joints, *rest.get_or_insert(state.joints));
            }
        }
        assert!(rest.is_some(), "{stop_at}");
    }
}

#[test]
fn a_saved_motion_continues_bit_for_bit() {
    let mut down = lin([0.0, 0.0, 0.1]);
    (down.wait, down.until) = (Some(0), Some(1));
    let mut back = ptp(0.2);
    back.until = Some(2);
    for second in [lin([0.0, 0.1, 0.0]), back] {
        let legs = [down, second, ptp(0.4)];
        let holds = |cycle: usize| move |index: u32| cycle >= [100, 400, 1200][index as usize];
        for saved_at in [50, 300, 450, 700, 1000, 1250, 1600, 2000] {
            let mut motions = built(&legs, SpeedProfile::Uniform).unwrap();
            for cycle in 0..saved_at {
                step(&mut motions, SpeedOverride::RUN, holds(cycle));
            }
            let mut words = Vec::new();
            motions.save(|piece| words.extend_from_slice(piece));
            assert_eq!(words.len(), motions.words());
            let mut other = built(&legs, SpeedProfile::Uniform).unwrap();
            other.restore(&words).unwrap();
            for cycle in saved_at..6000 {
                let state = step(&mut motions, SpeedOverride::RUN, holds(cycle));
                assert_eq!(state, step(&mut other, SpeedOverride::RUN, holds(cycle)));
            }
        }
    }
}

#[test]
fn what_cannot_follow_is_refused_with_its_reason() {
    let mut down = lin([0.0, 0.0, 0.1]);
    down.until = Some(0);
    let mut by_joints = ptp(0.3);
    by_joints.until = Some(0);
    let relative = Leg {
        relative: Some(RelativeTo::Base),
        ..Leg::new(PathSegment::Line {
            to: Pose::from_xyz_rpy([0.0, 0.05, 0.0], [0.0; 3]),
        })
    };
    let circle = Leg::new(PathSegment::Circle {
        via: at([0.05, 0.05, 0.05]).position,
        to: at([0.1, 0.0, 0.0]),
        orientation: Default::default(),
        angle: None,
    });
    let rounded = Leg {
        blend: 0.01,
        ..ptp(0.1)
    };
    let far = lin([0.0, 0.0, 5.0]);
    for (legs, expected) in [
        (vec![down, relative], Some(AfterUntilFault::Relative)),
        (vec![down, circle], Some(AfterUntilFault::Shape)),
        (vec![by_joints, lin([0.0; 3])], Some(AfterUntilFault::Start)),
        (vec![down, rounded, ptp(0.0)], None),
        (
            vec![
                Leg {
                    blend: 0.01,
                    ..down
                },
                ptp(0.0),
            ],
            None,
        ),
    ] {
        let fault = built(&legs, SpeedProfile::Uniform).unwrap_err();
        let PrepareFault::Motion { fault, .. } = fault else {
            panic!("{fault:?}");
        };
        match (fault, expected) {
            (MotionFault::AfterUntil { fault, .. }, Some(expected)) => assert_eq!(fault, expected),
            (MotionFault::NotAtRest, None) => {}
            other => panic!("{other:?}"),
        }
    }
    assert!(built(&[down, far], SpeedProfile::Uniform).is_err());
}
