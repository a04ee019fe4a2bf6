//! A restarted driver moves nothing before a new START.
//! Test code only.

use rcc_core::message::{DeviceState, Joints};

use super::super::Subject;
use super::super::driver_bench::{DriverBench, ExecutorAction};
use super::super::real::seed;
use super::rest::{TestMotion, motion_of, play};

/// Number of exchanges for which the net continues after the restart: enough to reach command mode again.
const EXCHANGES: u64 = 3000;

/// The old net continues and finally stands still; the device is only held.
fn is_only_held<S: Subject>(bench: &mut DriverBench<S>, motion: &TestMotion, from: u64) {
    let mut held: Option<Joints> = None;
    let mut follows = 0;
    for cycle in from..from + EXCHANGES {
        let before = bench.followed.len();
        bench.step(ExecutorAction::Writes(motion.at(1, cycle)));
        if let Ok(exchange) = bench.last
            && !exchange.commandable
        {
            assert_eq!(bench.measured().hold, exchange.mirror, "it does not mirror");
        }
        assert_ne!(
            bench.state(),
            DeviceState::Commanded,
            "the old net is followed"
        );
        match bench.followed.get(before..) {
            Some([.., last]) => {
                assert_eq!(*last, *held.get_or_insert(*last), "it moves by itself");
                follows += 1;
            }
            _ => held = None,
        }
    }
    assert!(follows > 0, "the device never followed again");
}

/// A new net moves the device.
fn moves_on_a_new_start<S: Subject>(bench: &mut DriverBench<S>) {
    bench.until_ready();
    let motion = motion_of(bench, 0.1);
    let hold = bench.measured().hold;
    play(bench, &motion, 2, motion.cycles() + 50);
    bench.until_ready();
    let moved = bench.measured().hold[0] - hold[0];
    assert!((moved.abs() - 0.1).abs() < 1e-5, "it moved by {moved} rad");
    assert_eq!(bench.checker.violations, [""; 0]);
}

/// Restarts in the middle of a motion that the net continues.
pub fn restarted_it_sends_nothing_but_hold_until_a_new_start<S: Subject>() {
    let mut bench = DriverBench::<S>::ready(seed());
    let motion = motion_of(&bench, 0.3);
    let half = motion.cycles() / 2;
    play(&mut bench, &motion, 1, half);
    let mut bench = bench.restart_driver();
    is_only_held(&mut bench, &motion, half);
    moves_on_a_new_start(&mut bench);
}

/// Restarts after an absence long enough for the device to brake.
pub fn restarted_while_the_device_brakes_it_sends_nothing_but_hold<S: Subject>() {
    let mut bench = DriverBench::<S>::ready(seed());
    let motion = motion_of(&bench, 0.3);
    let half = motion.cycles() / 2;
    play(&mut bench, &motion, 1, half);
    for _ in 0..30 {
        // The driver is away: the device gets no answer.
        bench.subject.before_receive();
    }
    bench.checker.forget();
    let mut bench = bench.restart_driver();
    is_only_held(&mut bench, &motion, half + 30);
    moves_on_a_new_start(&mut bench);
}
