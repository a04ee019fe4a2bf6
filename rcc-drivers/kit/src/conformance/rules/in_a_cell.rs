//! The same rules with the whole host on real boards: announcement, executor watch, boards, the thread's loop.
//! Test code only; limits are counted in exchanges, and each wait ends with the event that it waits for.

use rcc_core::message::{DeviceState, SetPoint};

use super::super::driver_bench::{all_on, outputs_are};
use super::super::hosted::HostedDriver;
use super::super::{Subject, TIMEOUT};
use super::rest::TestMotion;
use crate::host::limits::ArmLimits;

/// Number of cycles in which nothing may happen.
const WATCHED: usize = 200;

/// The executor dies, so its board becomes stale.
pub fn in_a_cell_outputs_are_released_when_the_executor_dies<S: Subject>() {
    let mut hosted = HostedDriver::<S>::ready();
    let device = hosted.cell.device.clone();
    let on = all_on(&device, 1);
    hosted.until(Some(on), "all outputs on", |hosted| {
        outputs_are(&device, &hosted.subject.outputs(), true)
    });
    hosted.cell.end_executor();
    hosted.until(None, "all outputs released", |hosted| {
        outputs_are(&device, &hosted.subject.outputs(), false)
    });
    hosted.until(None, "nobody's", |hosted| {
        hosted.cell.measured().executor == 0
    });
}

/// The executor reads that the device is offline, and why; then that it is ready again.
pub fn in_a_cell_a_lost_device_is_offline_and_comes_back<S: Subject>() {
    let mut hosted = HostedDriver::<S>::ready();
    hosted.subject.set_present(false);
    hosted.until(Some(SetPoint::NONE), "offline", |hosted| {
        std::thread::sleep(TIMEOUT);
        hosted.cell.is(DeviceState::Offline)
    });
    assert_ne!(hosted.cell.measured().reason, 0, "it does not say why");
    hosted.subject.set_present(true);
    hosted.until_ready();
}

fn motion_of<S: Subject>(hosted: &HostedDriver<S>) -> TestMotion {
    let hold = hosted.cell.measured().hold;
    let way = if hold[0] > 0.0 { -0.3 } else { 0.3 };
    TestMotion::new(&ArmLimits::of(&hosted.cell.device), &hold, way)
}

fn holds<S: Subject>(hosted: &mut HostedDriver<S>, mut entry: impl FnMut() -> Option<SetPoint>) {
    hosted.followed.clear();
    for _ in 0..WATCHED {
        hosted.step(entry());
    }
    let first = hosted.followed.first().copied();
    let moved = hosted
        .followed
        .iter()
        .any(|position| Some(*position) != first);
    assert!(!moved, "it was not held");
}

/// The executor dies in the middle of a motion.
pub fn in_a_cell_the_arm_comes_to_rest_when_the_executor_dies<S: Subject>() {
    let mut hosted = HostedDriver::<S>::ready();
    let motion = motion_of(&hosted);
    for cycle in 0..motion.cycles() / 2 {
        hosted.step(Some(motion.at(1, cycle)));
    }
    hosted.cell.end_executor();
    hosted.until(None, "rest", |hosted| hosted.cell.is(DeviceState::Online));
    holds(&mut hosted, || None);
    assert_eq!(hosted.checker.violations, [""; 0]);
    assert_eq!(hosted.subject.protocol_violations(), [""; 0]);
}

/// The net that commanded the arm continues as if nothing had happened.
pub fn in_a_cell_a_restarted_driver_moves_nothing<S: Subject>() {
    let mut hosted = HostedDriver::<S>::ready();
    let motion = motion_of(&hosted);
    let half = motion.cycles() / 2;
    for cycle in 0..half {
        hosted.step(Some(motion.at(1, cycle)));
    }
    let mut cycle = half;
    let mut entry = || {
        cycle += 1;
        motion.at(1, cycle)
    };
    hosted.restart_driver(&mut entry);
    let begin = std::time::Instant::now();
    while hosted.cell.measured().executor != hosted.cell.executor {
        assert!(
            begin.elapsed() < super::super::hosted::LIMIT,
            "it never sees the executor"
        );
        hosted.step(Some(entry()));
    }
    holds(&mut hosted, || Some(entry()));
    let state = hosted.cell.measured().state;
    assert_ne!(
        state,
        DeviceState::Commanded as u32,
        "the old net is followed"
    );
    assert_eq!(hosted.checker.violations, [""; 0]);
    // A new net is followed.
    hosted.until_ready();
}
