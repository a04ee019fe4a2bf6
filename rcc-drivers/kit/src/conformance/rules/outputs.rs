//! Outputs take the value of their `on_release`, on the device itself, when they are no longer commanded.
//! Test code only.

use rcc_core::message::SetPoint;

use super::super::driver_bench::{DriverBench, ExecutorAction};
use super::super::real::seed;
use super::super::{Subject, Transport};
use crate::driver::Driver;
use crate::proxy::FaultRates;

/// Returns a bench whose device has all outputs on.
fn all_on<S: Subject>() -> DriverBench<S> {
    let mut bench = DriverBench::<S>::ready(seed());
    let on = ExecutorAction::Writes(bench.all_on(1));
    bench.until(on, "all outputs on", |bench| bench.outputs_are_as(true));
    bench
}

fn are_released<S: Subject>(bench: &mut DriverBench<S>, executor: ExecutorAction) {
    bench.until(executor, "all outputs released", |bench| {
        bench.outputs_are_as(false)
    });
    // The outputs stay released.
    for _ in 0..20 {
        bench.step(executor);
        assert!(bench.outputs_are_as(false));
    }
}

/// The net commands null.
pub fn releases_outputs_on_null<S: Subject>() {
    are_released(&mut all_on::<S>(), ExecutorAction::Writes(SetPoint::NONE));
}

/// The driver is asked to end while the net continues.
pub fn releases_outputs_on_termination<S: Subject>() {
    let mut bench = all_on::<S>();
    let on = ExecutorAction::Writes(bench.all_on(1));
    bench.session.terminate();
    bench.until(on, "all outputs released", |bench| {
        bench.outputs_are_as(false)
    });
    bench.until(on, "the end", |bench| bench.session.is_at_rest());
    bench.driver.release();
}

/// The executor's announcement disappears.
pub fn releases_outputs_when_the_executor_vanishes<S: Subject>() {
    are_released(&mut all_on::<S>(), ExecutorAction::Absent);
}

/// The device executes what it receives, but its answers are late, corrupted or missing. A device that sends first gets
/// one answer to each datagram that the driver accepts; that answer carries all outputs.
pub fn sends_every_safe_value_whatever_the_device_answers<S: Subject>() {
    if S::TRANSPORT == Transport::UdpFromDevice {
        return;
    }
    let late = FaultRates {
        late: 1.0,
        late_steps_max: 200,
        ..FaultRates::NONE
    };
    let lost = FaultRates {
        lost: 1.0,
        ..FaultRates::NONE
    };
    let truncated = FaultRates {
        truncated: 1.0,
        ..FaultRates::NONE
    };
    let corrupted = FaultRates {
        corrupted: 1.0,
        ..FaultRates::NONE
    };
    for answers in [late, lost, truncated, corrupted] {
        let mut bench = all_on::<S>();
        bench.set_rates(answers, FaultRates::NONE);
        bench.until(ExecutorAction::Absent, "every safe value sent", |bench| {
            bench.outputs_are_as(false)
        });
    }
}

/// The executor hangs, so its board becomes stale.
pub fn releases_outputs_when_the_executor_stops_writing<S: Subject>() {
    are_released(&mut all_on::<S>(), ExecutorAction::Hangs);
}
