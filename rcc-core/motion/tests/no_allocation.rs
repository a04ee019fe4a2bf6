//! Stepping clocks and coming to rest touches the heap not once, refusals included.
//! A program of its own, because it replaces the allocator: any heap operation within `assert_no_alloc` aborts it.

use assert_no_alloc::{AllocDisabler, assert_no_alloc};
use rcc_core::message::JOINTS_MAX;
use rcc_core::path::{
    Drive, Leg, Limits, MotionBuilder, Motions, PathLimits, PathRequest, Segment,
};
use rcc_core::pose::Pose;
use rcc_motion::{Builder, MotionSet, Rest, RestLimits, stop_time};

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

const DT: f64 = 1e-3;
const LINE: PathLimits = PathLimits {
    length: 0.5,
    velocity: 0.25,
    acceleration: 1.0,
    jerk: 10.0,
};

/// Three lines of 0.5 m.
fn lines() -> MotionSet {
    let limits = Limits {
        velocity: LINE.velocity,
        acceleration: LINE.acceleration,
        jerk: LINE.jerk,
    };
    let request = PathRequest {
        device: 0,
        from: Some(Pose::from_xyz_rpy([0.0; 3], [0.0; 3])),
        legs: &[Leg {
            segment: Segment::Line {
                to: Pose::from_xyz_rpy([LINE.length, 0.0, 0.0], [0.0, 0.1, 0.0]),
            },
            line: limits,
            turn: limits,
        }],
    };
    let mut builder = Builder::new(&[], &[], DT, 3);
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
            let ran = (0..5000).any(|cycle| {
                let stop = cycle >= stop_at;
                let state = motions.step(1, Drive { stop });
                state.is_some_and(|state| state.path.done)
            });
            done += u32::from(ran);
        }
        let none = motions.step(3, Drive { stop: false });
        std::hint::black_box((none, stop_time(0.2, f64::NAN, &LINE)));
        done
    });
    assert_eq!(done, 6);
}

#[test]
fn joints_come_to_rest_without_the_heap_and_so_do_refusals() {
    let limits = RestLimits {
        velocity_max: [2.0; JOINTS_MAX],
        acceleration_max: [5.0; JOINTS_MAX],
        jerk_max: [50.0; JOINTS_MAX],
        joints: 7,
    };
    let mut rest = Rest::new(limits, DT).unwrap();
    let (resting, refused) = assert_no_alloc(|| {
        let refused = rest.begin(&[f64::NAN; 7], &[0.0; 7], &[0.0; 7]).is_err();
        let begun = rest
            .begin(&[0.1; 7], &[1.0, 0.5, 0.0, -1.0, 0.3, 0.2, 2.0], &[1.0; 7])
            .is_ok();
        (begun && (0..5000).any(|_| rest.step().1), refused)
    });
    assert!(resting && refused);
}
