//! An arm holds its position while it is not commanded; when its commands end, it comes to rest in time and within its
//! limits.
//! Test code only; time is the device's, counted in exchanges.

use rcc_core::message::{DeviceState, Joints, SetPoint};

use super::super::Subject;
use super::super::driver_bench::{DriverBench, ExecutorAction};
use super::super::real::seed;
use crate::host::limits::ArmLimits;

/// Number of exchanges for which an arm at rest is observed.
const WATCHED: usize = 300;
/// Share of each limit that a motion of the suite uses.
const SHARE: f64 = 0.6;

/// A rest-to-rest motion of joint 1, a quintic within [`SHARE`] of the limits, one row per cycle of 1 ms.
#[derive(Clone, Debug)]
pub struct TestMotion {
    hold: Joints,
    way: f64,
    cycles: u64,
}

impl TestMotion {
    /// A motion by `way` rad from `hold`.
    pub fn new(limits: &ArmLimits, hold: &Joints, way: f64) -> Self {
        // Peaks of the quintic of unit distance and unit time: velocity, acceleration, jerk.
        let peak = |peak: f64, bound: f64, order: f64| {
            (peak * way.abs() / (SHARE * bound)).powf(1.0 / order)
        };
        let seconds = peak(1.875, limits.joints.velocity_max[0], 1.0)
            .max(peak(5.774, limits.joints.acceleration_max[0], 2.0))
            .max(peak(60.0, limits.jerk_max[0], 3.0));
        Self {
            hold: *hold,
            way,
            cycles: (seconds * 1e3).ceil() as u64,
        }
    }

    /// Returns the duration, in cycles.
    pub fn cycles(&self) -> u64 {
        self.cycles
    }

    /// Returns the set-point of a cycle; after the last cycle, the goal.
    pub fn at(&self, owner: u64, cycle: u64) -> SetPoint {
        let x = cycle.min(self.cycles) as f64 / self.cycles as f64;
        let mut position = self.hold;
        position[0] += self.way * x * x * x * (10.0 - x * (15.0 - 6.0 * x));
        SetPoint {
            owner,
            has_position: 1,
            position,
            ..SetPoint::NONE
        }
    }
}

/// Returns a motion of the bench's arm, away from the nearer limit of joint 1.
pub fn motion_of<S: Subject>(bench: &DriverBench<S>, way: f64) -> TestMotion {
    let hold = bench.measured().hold;
    let way = if hold[0] > 0.0 { -way } else { way };
    TestMotion::new(&ArmLimits::of(&bench.device), &hold, way)
}

/// Plays the first `cycles` cycles of a motion.
pub fn play<S: Subject>(bench: &mut DriverBench<S>, motion: &TestMotion, owner: u64, cycles: u64) {
    for cycle in 0..cycles {
        bench.step(ExecutorAction::Writes(motion.at(owner, cycle)));
    }
}

/// Upper bound of the exchanges from the last command to rest: the delay, the time-out if the board must become stale
/// first, and the longest stop that the limits allow.
pub fn rest_bound<S: Subject>(bench: &DriverBench<S>) -> usize {
    let ArmLimits {
        joints, jerk_max, ..
    } = ArmLimits::of(&bench.device);
    let slowest = (0..joints.joints).map(|joint| {
        let (v, a) = (joints.velocity_max[joint], joints.acceleration_max[joint]);
        // A full outward acceleration is removed first; the stop at full deceleration follows.
        let outwards = a / jerk_max[joint];
        (v + 0.5 * a * outwards) / a + 3.0 * outwards
    });
    let slowest_s = slowest.fold(0.0, f64::max);
    let waits_ns = bench.device.command_timeout_ns + 2 * bench.device.delay_ns;
    (slowest_s * 1e3).ceil() as usize + (waits_ns / 1_000_000) as usize + 5
}

fn rests<S: Subject>(bench: &mut DriverBench<S>, executor: ExecutorAction) {
    let bound = rest_bound(bench);
    let mut exchanges = 0;
    while matches!(
        bench.state(),
        DeviceState::Commanded | DeviceState::Stopping
    ) {
        bench.step(executor);
        exchanges += 1;
        assert!(exchanges <= bound, "no rest after {exchanges} exchanges");
    }
    holds(bench, executor);
    assert_eq!(bench.checker.violations, [""; 0]);
    assert_eq!(bench.subject.protocol_violations(), [""; 0]);
}

/// Checks for [`WATCHED`] exchanges that the device is told to stay where it is.
pub fn holds<S: Subject>(bench: &mut DriverBench<S>, executor: ExecutorAction) {
    bench.followed.clear();
    for _ in 0..WATCHED {
        bench.step(executor);
    }
    assert!(
        !bench.followed.is_empty(),
        "the device follows nobody any more"
    );
    let first = bench.followed[0];
    let moved = bench
        .followed
        .iter()
        .position(|position| *position != first);
    assert_eq!(moved, None, "it was not held");
}

/// Interrupts a motion at several points of its course.
fn at_every_phase<S: Subject>(mut end: impl FnMut(&mut DriverBench<S>) -> ExecutorAction) {
    for part in [2, 15, 35, 50, 65, 85, 98] {
        let mut bench = DriverBench::<S>::ready(seed());
        let motion = motion_of(&bench, 0.3);
        let cycles = (motion.cycles() * part / 100).max(20);
        play(&mut bench, &motion, 1, cycles);
        assert_eq!(bench.state(), DeviceState::Commanded, "at {part} %");
        let executor = end(&mut bench);
        bench.step(executor);
        rests(&mut bench, executor);
    }
}

/// Nulls first, then a net that commands only outputs.
pub fn sends_nothing_but_hold_on_null<S: Subject>() {
    let mut bench = DriverBench::<S>::ready(seed());
    holds(&mut bench, ExecutorAction::Writes(SetPoint::NONE));
    let outputs = bench.all_on(1);
    holds(&mut bench, ExecutorAction::Writes(outputs));
}

/// The executor's board disappears.
pub fn comes_to_rest_in_time_when_the_executor_vanishes<S: Subject>() {
    at_every_phase::<S>(|_| ExecutorAction::Absent);
}

/// The executor's board becomes stale.
pub fn comes_to_rest_in_time_when_the_executor_stops_writing<S: Subject>() {
    at_every_phase::<S>(|_| ExecutorAction::Hangs);
}

/// The net commands null in the middle of a motion.
pub fn comes_to_rest_in_time_on_null<S: Subject>() {
    at_every_phase::<S>(|_| ExecutorAction::Writes(SetPoint::NONE));
}

/// The driver is asked to end in the middle of a motion, and the executor is gone too.
pub fn comes_to_rest_in_time_on_termination<S: Subject>() {
    at_every_phase::<S>(|bench| {
        bench.session.terminate();
        ExecutorAction::Absent
    });
}
