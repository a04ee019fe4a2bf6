//! Outputs take what their `on_release` says when nobody commands them, on the device itself.
//! Test code only.

use rcc_core::message::SetPoint;

use super::super::bench::{Bench, Executor};
use super::super::real::seed;
use super::super::{Subject, Wire};
use crate::driver::Driver;
use crate::proxy::Rates;

/// A device whose outputs are all on.
fn all_on<S: Subject>() -> Bench<S> {
    let mut bench = Bench::<S>::ready(seed());
    let on = Executor::Writes(bench.all_on(1));
    bench.until(on, "all outputs on", |bench| bench.told_as(true));
    bench
}

fn are_released<S: Subject>(bench: &mut Bench<S>, executor: Executor) {
    bench.until(executor, "all outputs released", |bench| {
        bench.told_as(false)
    });
    // And they stay so.
    for _ in 0..20 {
        bench.step(executor);
        assert!(bench.told_as(false));
    }
}

/// The net commands null.
pub fn releases_outputs_on_null<S: Subject>() {
    are_released(&mut all_on::<S>(), Executor::Writes(SetPoint::NONE));
}

/// The driver is asked to end, while the net goes on.
pub fn releases_outputs_on_termination<S: Subject>() {
    let mut bench = all_on::<S>();
    let on = Executor::Writes(bench.all_on(1));
    bench.station.terminate();
    bench.until(on, "all outputs released", |bench| bench.told_as(false));
    bench.until(on, "the end", |bench| bench.station.is_at_rest());
    bench.driver.release();
}

/// The executor's announcement goes away.
pub fn releases_outputs_when_the_executor_vanishes<S: Subject>() {
    are_released(&mut all_on::<S>(), Executor::Absent);
}

/// The device does what it is told, and its answers are late, broken, or do not come. One that sends first gets an answer
/// to what is heard of it and no more: all its outputs are in it.
pub fn sends_every_safe_value_whatever_the_device_answers<S: Subject>() {
    if S::WIRE == Wire::UdpFromDevice {
        return;
    }
    let late = Rates {
        late: 1.0,
        late_steps_max: 200,
        ..Rates::NONE
    };
    let lost = Rates {
        lost: 1.0,
        ..Rates::NONE
    };
    let truncated = Rates {
        truncated: 1.0,
        ..Rates::NONE
    };
    let corrupted = Rates {
        corrupted: 1.0,
        ..Rates::NONE
    };
    for answers in [late, lost, truncated, corrupted] {
        let mut bench = all_on::<S>();
        bench.set_rates(answers, Rates::NONE);
        bench.until(Executor::Absent, "every safe value sent", |bench| {
            bench.told_as(false)
        });
    }
}

/// The executor hangs: its board grows old.
pub fn releases_outputs_when_the_executor_stops_writing<S: Subject>() {
    are_released(&mut all_on::<S>(), Executor::Hangs);
}
