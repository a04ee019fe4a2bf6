//! Exchanges: known inputs, outputs and inputs carried over the wire, loss of the device and its return.
//! Test code only; the bench checks the invariants of every exchange.

use rcc_core::message::SetPoint;

use super::super::Subject;
use super::super::driver_bench::{DriverBench, ExecutorAction};
use super::super::real::seed;
use crate::driver::LinkError;

/// Without a device there is a reason, but neither inputs nor an exchange.
pub fn says_when_nobody_is_there<S: Subject>() {
    let mut bench = DriverBench::<S>::new(seed());
    bench.subject.set_present(false);
    for _ in 0..5 {
        bench.step(ExecutorAction::Writes(SetPoint::NONE));
        assert!(bench.last.is_err(), "an exchange with nobody");
    }
    assert_eq!(bench.inputs.digital_known, 0);
    assert!(bench.inputs.analog.iter().all(|value| value.is_nan()));
}

/// Exactly the inputs of the configuration are known.
pub fn tells_what_it_knows<S: Subject>() {
    let mut bench = DriverBench::<S>::ready(seed());
    let [digital, _, analog, _] = bench.device.model().channels;
    for _ in 0..10 {
        bench.step(ExecutorAction::Writes(SetPoint::NONE));
        if bench.last.is_err() {
            continue;
        }
        assert_eq!(bench.inputs.digital_known, (1 << digital) - 1);
        let known = bench.inputs.analog.iter().filter(|value| value.is_finite());
        assert_eq!(known.count(), analog as usize);
    }
}

/// Output 0 of each type comes back as input 0.
pub fn carries_outputs_there_and_inputs_back<S: Subject>() {
    let mut bench = DriverBench::<S>::ready(seed());
    for on in [true, false, true] {
        let mut entry = bench.all_on(1);
        if !on {
            entry.digital = 0;
            entry.analog[0] = 0.0;
        }
        let wanted = (entry.digital & 1, entry.analog[0]);
        bench.until(
            ExecutorAction::Writes(entry),
            "outputs that come back",
            |bench| (bench.inputs.digital & 1, bench.inputs.analog[0]) == wanted,
        );
    }
}

/// A device that goes away is reported as lost; one that comes back is exchanged with again, without any intervention.
pub fn comes_back_when_the_device_does<S: Subject>() {
    let mut bench = DriverBench::<S>::ready(seed());
    for _ in 0..2 {
        bench.subject.set_present(false);
        let null = ExecutorAction::Writes(SetPoint::NONE);
        bench.until(null, "the loss of the device", |bench| bench.last.is_err());
        assert!(matches!(
            bench.last,
            Err(LinkError::Silent | LinkError::Lost { .. })
        ));
        bench.subject.set_present(true);
        bench.until_ready();
    }
}
