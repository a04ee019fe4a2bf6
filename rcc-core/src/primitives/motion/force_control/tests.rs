//! Force control: limits under arbitrary forces, contact with a spring, and coming to rest.

use rcc_testing::{Random, Rng};

use super::{OffsetLimits, OffsetState, follow};
use crate::testing::PrimitiveHarness;

const DT_S: f64 = 1e-3;
const AT_REST: OffsetState = OffsetState {
    s: 0.0,
    v: 0.0,
    a: 0.0,
    held: 0.0,
};

/// Runs one cycle and checks every limit.
fn checked(before: OffsetState, goal: f64, limits: &OffsetLimits) -> OffsetState {
    let next = follow(before, goal, limits, DT_S);
    let jerk = (next.a - before.a) / DT_S;
    let moved = (before.v + next.v) / 2.0 * DT_S;
    assert!(next.s.abs() <= limits.travel, "{next:?} {limits:?}");
    assert!(
        next.v.abs() <= limits.velocity * (1.0 + 1e-9),
        "{next:?} {limits:?}"
    );
    assert!(
        next.a.abs() <= limits.acceleration * (1.0 + 1e-9),
        "{next:?} {limits:?}"
    );
    assert!(
        jerk.abs() <= limits.jerk * (1.0 + 1e-6),
        "{jerk} {limits:?}"
    );
    assert!(
        (next.v - before.v - (next.a + before.a) / 2.0 * DT_S).abs()
            < 1e-9 * limits.jerk * DT_S * DT_S + 1e-15
    );
    assert!((next.s - before.s - moved).abs() <= limits.jerk * DT_S * DT_S * DT_S);
    next
}

#[test]
fn goals_that_jump_at_any_time_break_no_limit_and_never_leave_the_travel() {
    let mut held = 0;
    for seed in 1..400 {
        let mut random = Rng::with_seed(seed);
        let mut share = |low: f64, high: f64| random.uniform(low, high);
        let limits = OffsetLimits {
            velocity: share(0.005, 0.5),
            acceleration: share(0.05, 5.0),
            jerk: share(0.5, 200.0),
            travel: share(0.002, 0.2),
        };
        let mut next = AT_REST;
        for _ in 0..40 {
            let goal = share(-1.0, 1.0) * limits.velocity;
            for _ in 0..share(1.0, 400.0) as usize {
                next = checked(next, goal, &limits);
                held += usize::from(next.held != 0.0);
            }
        }
    }
    assert!(held > 10_000, "{held}");
}

#[test]
fn at_the_end_of_the_travel_it_rests_and_the_way_back_is_free() {
    let limits = OffsetLimits {
        velocity: 0.1,
        acceleration: 1.0,
        jerk: 20.0,
        travel: 0.02,
    };
    let mut next = AT_REST;
    for _ in 0..1000 {
        next = checked(next, 0.1, &limits);
    }
    assert_eq!((next.v, next.a, next.held), (0.0, 0.0, 1.0));
    assert!(next.s > 0.019, "{}", next.s);
    for _ in 0..150 {
        next = checked(next, -0.1, &limits);
    }
    assert!(
        next.s < 0.015 && next.held == 0.0 && next.v == -0.1,
        "{next:?}"
    );
}

fn bench() -> PrimitiveHarness {
    let mut bench = PrimitiveHarness::new("ForceControl");
    bench
        .set_reals("pose", &[0.5, 0.0, 0.4, 1.0, 0.0, 0.0, 0.0])
        .set_real("force", 10.0)
        .set_reals("wrench", &[0.0; 6])
        .set_bool("active", Some(true))
        .set_reals("axis", &[0.0, 0.0, -2.0])
        .set_bool("in_tool", Some(false))
        .set_real("gain", 1e-3)
        .set_real("velocity", 0.05)
        .set_real("acceleration", 0.5)
        .set_real("jerk", 10.0)
        .set_real("travel", 0.05);
    bench
}

/// A floor 10 mm below the path, 5000 N/m, measured `delay` cycles later.
fn on_the_floor(bench: &mut PrimitiveHarness, cycles: usize, delay: usize) -> f64 {
    let mut forces = std::collections::VecDeque::from(std::vec![0.0; delay]);
    let mut most = 0.0_f64;
    for _ in 0..cycles {
        let z = bench.reals("pose_out", 3)[2];
        let push = if z.is_nan() {
            0.0
        } else {
            (5000.0 * (0.39 - z)).max(0.0)
        };
        most = most.max(push);
        forces.push_back(push);
        let felt = forces.pop_front().unwrap_or(0.0);
        bench
            .set_reals("wrench", &[0.0, 0.0, felt, 0.0, 0.0, 0.0])
            .step();
    }
    most
}

#[test]
fn it_finds_the_contact_and_holds_the_force() {
    let mut bench = bench();
    let most = on_the_floor(&mut bench, 3000, 10);
    let push = 5000.0 * (0.39 - bench.reals("pose_out", 3)[2]);
    assert!((push - 10.0).abs() < 1e-3, "{push}");
    assert!(most < 12.0, "{most}");
    assert_eq!(bench.reals("pose_out", 2), [0.5, 0.0]);
    assert_eq!(bench.bool("limited"), Some(false));
}

#[test]
fn null_inputs_bring_the_offset_to_rest_within_its_limits() {
    for null in ["wrench", "force", "active"] {
        let mut bench = bench();
        for _ in 0..100 {
            bench.step();
        }
        assert!(bench.real("velocity") > 5e-3);
        match null {
            "wrench" => bench.set_reals("wrench", &[f64::NAN; 6]),
            "force" => bench.set_real("force", f64::NAN),
            _ => bench.set_bool("active", None),
        };
        let mut last = bench.real("acceleration");
        for _ in 0..200 {
            let now = bench.step().real("acceleration");
            assert!((now - last).abs() <= 10.0 * DT_S * (1.0 + 1e-9), "{null}");
            last = now;
        }
        assert_eq!(bench.bool("resting"), Some(true), "{null}");
        assert!(
            bench.reals("pose_out", 7).iter().all(|x| x.is_finite()),
            "{null}"
        );
    }
}

#[test]
fn after_loss_of_contact_the_offset_ends_at_the_travel() {
    let mut bench = bench();
    on_the_floor(&mut bench, 2000, 0);
    bench.set_reals("wrench", &[0.0; 6]);
    for _ in 0..8000 {
        bench.step();
    }
    assert_eq!(bench.bool("limited"), Some(true));
    assert_eq!(bench.bool("resting"), Some(true));
    let offset = bench.real("offset");
    assert!(offset > 0.049 && offset <= 0.05, "{offset}");
}

#[test]
fn an_axis_of_the_tool_turns_with_the_pose() {
    let mut bench = bench();
    // Rotated by 180 degrees about x: z of the tool points down.
    bench
        .set_reals("axis", &[0.0, 0.0, 1.0])
        .set_bool("in_tool", Some(true));
    for _ in 0..100 {
        bench.step();
    }
    let (z, offset) = (bench.reals("pose_out", 3)[2], bench.real("offset"));
    assert!(
        offset > 1e-4 && (z - 0.4 + offset).abs() < 1e-15,
        "{z} {offset}"
    );
}
