//! Stepping clocks and coming to rest touches the heap not once, refusals included.
//! A program of its own, because it replaces the allocator: any heap operation within `assert_no_alloc` aborts it.

use assert_no_alloc::{AllocDisabler, assert_no_alloc};
use rcc_core::message::JOINTS_MAX;
use rcc_core::path::{PathClocks, PathLimits};
use rcc_motion::{Clocks, PathClock, Rest, RestLimits, stop_time};

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

const DT: f64 = 1e-3;
const LINE: PathLimits = PathLimits {
    length: 0.5,
    velocity: 0.25,
    acceleration: 1.0,
    jerk: 10.0,
};

#[test]
fn a_clock_runs_stops_and_begins_again_without_the_heap() {
    let mut clocks = Clocks(vec![PathClock::new(LINE, DT).unwrap(); 3]);
    let done = assert_no_alloc(|| {
        let mut done = 0;
        for stop_at in [0, 1, 50, 1300, 2000, usize::MAX] {
            clocks.reset();
            let ran = (0..5000).any(|cycle| {
                clocks
                    .step(1, cycle >= stop_at)
                    .is_some_and(|state| state.done)
            });
            done += u32::from(ran);
        }
        std::hint::black_box((clocks.step(3, false), stop_time(0.2, f64::NAN, &LINE)));
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
