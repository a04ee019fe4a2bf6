//! Stepping path clocks and stop trajectories never touches the heap, refusals included. A program of its own, because
//! it replaces the allocator: any heap operation within `assert_no_alloc` aborts it.

use assert_no_alloc::{AllocDisabler, assert_no_alloc};
use rcc_core::axis::{AxisState, limits_are_valid};
use rcc_core::message::JOINTS_MAX;
use rcc_core::path::{
    Leg, MotionBuilder, MotionLimits, Motions, PathLimits, PathRequest, PathSegment, SpeedOverride,
    SpeedProfile,
};
use rcc_core::pose::Pose;
use rcc_motion::goal::{GoalPlanKind, plan_to};
use rcc_motion::{MotionSet, MotionSetBuilder, StopLimits, StopTrajectory, stop_time};
use rcc_testing::arms::{HOLD, plain_lwr};
use rcc_testing::{Random, Rng};

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

const DT: f64 = 1e-3;
const LINE: PathLimits = PathLimits {
    length: 0.2,
    velocity: 0.25,
    acceleration: 1.0,
    jerk: 10.0,
};

/// Three lines of 0.2 m.
fn lines() -> MotionSet {
    let model = plain_lwr(200.0);
    let start = model.arm.unwrap().forward(&HOLD);
    let limits = MotionLimits {
        velocity: LINE.velocity,
        acceleration: LINE.acceleration,
        jerk: LINE.jerk,
    };
    let request = PathRequest {
        device: 0,
        from: None,
        legs: &[Leg {
            line: limits,
            turn: limits,
            ..Leg::new(PathSegment::Line {
                to: start.compose(&Pose::from_xyz_rpy(
                    [LINE.length, 0.0, 0.0],
                    [0.0, 0.1, 0.0],
                )),
            })
        }],
        pace: SpeedProfile::Uniform,
    };
    let (models, holds) = ([model], [Some(HOLD)]);
    let mut builder = MotionSetBuilder::new(&models, &holds, DT, 3);
    (0..3).for_each(|index| builder.path(index, &request).unwrap());
    builder.finish().unwrap()
}

#[test]
fn a_motion_runs_stops_and_begins_again_without_the_heap() {
    let mut motions = lines();
    let done = assert_no_alloc(|| {
        let mut done = 0;
        for stop_at in [0, 1, 50, 1300, 2000, usize::MAX] {
            motions.reset();
            motions.save(|words| {
                std::hint::black_box(words);
            });
            let ran = (0..20_000).any(|cycle| {
                let speed_override = SpeedOverride {
                    stop: cycle >= stop_at,
                    pause: cycle % 500 > 450,
                    speed: 1.0 - (cycle % 70) as f64 / 100.0,
                };
                let state = motions.step(1, speed_override);
                state.is_some_and(|state| state.path.done)
            });
            done += u32::from(ran);
        }
        let none = motions.step(3, SpeedOverride::RUN);
        std::hint::black_box((none, stop_time(0.2, f64::NAN, &LINE)));
        done
    });
    assert_eq!(done, 6);
}

#[test]
fn stops_and_refusals_need_no_heap() {
    let limits = StopLimits {
        velocity_max: [2.0; JOINTS_MAX],
        acceleration_max: [5.0; JOINTS_MAX],
        jerk_max: [50.0; JOINTS_MAX],
        joints: 7,
    };
    let mut rest = StopTrajectory::new(limits, DT).unwrap();
    let (resting, refused) = assert_no_alloc(|| {
        let refused = rest.begin(&[f64::NAN; 7], &[0.0; 7], &[0.0; 7]).is_err();
        let begun = rest
            .begin(&[0.1; 7], &[1.0, 0.5, 0.0, -1.0, 0.3, 0.2, 2.0], &[1.0; 7])
            .is_ok();
        (begun && (0..5000).any(|_| rest.step().1), refused)
    });
    assert!(resting && refused);
}

/// Limits within a factor of 10^spread of those of a robot's joint; a state within them, and one in ten beyond them; a
/// goal at any distance, down to rounding.
fn task(random: &mut impl FnMut() -> f64, spread: f64) -> (AxisState, AxisState, MotionLimits) {
    let mut decade = |middle: f64, spread: f64| 10.0_f64.powf(middle + spread * random());
    let limits = MotionLimits {
        velocity: decade(0.0, spread),
        acceleration: decade(1.0, spread),
        jerk: decade(2.5, spread),
    };
    let near = decade(-7.0, 11.0).min(1.0);
    let way = decade(-8.0, 9.0) * limits.velocity;
    let beyond = if random() > 0.8 { 3.0 } else { 1.0 };
    let from = AxisState {
        position: random(),
        velocity: near * beyond * random() * limits.velocity,
        acceleration: near * beyond * random() * limits.acceleration,
    };
    let to = AxisState::at_rest(from.position + way * random());
    (from, to, limits)
}

#[test]
fn two_million_motions_to_goals_need_no_heap() {
    let mut rng = Rng::with_seed(7);
    let mut random = || rng.uniform(-1.0, 1.0);
    // Robots and machines; then anything.
    for spread in [1.0, 4.0] {
        let (mut asked, mut refused, mut beyond, mut inexact) = (0_u32, 0_u32, 0_u32, 0_u32);
        while asked < 1_000_000 {
            let (from, to, limits) = task(&mut random, spread);
            if !limits_are_valid(&limits) {
                continue;
            }
            asked += 1;
            let planned = assert_no_alloc(|| plan_to(&from, &to, &limits));
            let Ok((way, found)) = planned else {
                inexact += 1;
                continue;
            };
            assert!(way.end(from).is_finite(), "{from:?} {to:?} {limits:?}");
            if found == GoalPlanKind::AfterStop {
                let fastest = from.velocity.abs().max(from.coasting(limits.jerk).abs());
                let within =
                    fastest <= limits.velocity && from.acceleration.abs() <= limits.acceleration;
                (refused, beyond) = (refused + u32::from(within), beyond + u32::from(!within));
            }
        }
        println!(
            "10^±{spread}: of {asked} ways {refused} by a stop, {beyond} from beyond the limits, and {inexact} are refused as inexact"
        );
        assert_eq!(refused, 0);
        // Only limits that are many orders of magnitude apart leave no motion that ends at the goal.
        assert!(
            inexact == 0 || spread > 1.0 && inexact < asked / 100,
            "{inexact}"
        );
    }
}
