//! Packets that are lost, late, duplicated, reordered, truncated or corrupted, drawn from a seed.
//! Test code only; a failure prints its seed, `RCC_SEED` repeats it.

use rcc_core::message::{DeviceState, SetPoint};

use super::super::driver_bench::{DriverBench, ExecutorAction};
use super::super::real::with_seeds;
use super::super::{Subject, Transport};
use super::rest::{TestMotion, motion_of};
use crate::proxy::FaultRates;

/// Returns the number of exchanges under faults: many in virtual time; with a device that has its own clock, a few motions
/// of an arm or a few switches of outputs.
fn exchanges<S: Subject>(is_arm: bool) -> usize {
    match (S::TRANSPORT, is_arm) {
        (Transport::UdpFromDevice, _) => 4000,
        (_, true) => 1000,
        (_, false) => 150,
    }
}

/// Number of cycles for which outputs are on, and then off.
const BLINK: u64 = 20;

/// A sequence of nets: motions there and back, or outputs that are switched on and off.
struct NetSequence {
    owner: u64,
    cycle: u64,
    motion: Option<TestMotion>,
}

impl NetSequence {
    fn next<S: Subject>(&mut self, bench: &DriverBench<S>) -> SetPoint {
        self.cycle += 1;
        let blink = if (self.cycle / BLINK).is_multiple_of(2) {
            bench.all_on(self.owner)
        } else {
            SetPoint::NONE
        };
        if bench.device.robot.is_none() {
            return blink;
        }
        let lost = matches!(
            bench.state(),
            DeviceState::Online | DeviceState::Offline | DeviceState::Stopping
        );
        let over = self
            .motion
            .as_ref()
            .is_some_and(|motion| lost || self.cycle > motion.cycles());
        if over {
            self.motion = None;
        }
        if self.motion.is_none() && bench.state() == DeviceState::Ready {
            self.owner += 1;
            self.cycle = 0;
            self.motion = Some(motion_of(bench, 0.3));
        }
        match &self.motion {
            Some(motion) => SetPoint {
                digital: blink.digital,
                digital_commanded: blink.digital_commanded,
                analog: blink.analog,
                ..motion.at(self.owner, self.cycle)
            },
            None => SetPoint::NONE,
        }
    }
}

fn survives<S: Subject>(rates: FaultRates) {
    with_seeds(|seed| {
        let mut bench = DriverBench::<S>::ready(seed);
        let is_arm = bench.device.robot.is_some();
        let corrupts = rates.corrupted > 0.0;
        // Without a checksum on the wire, the device could not detect corruption either; that would test the device.
        let to_device = if corrupts && !S::HAS_CHECKSUM {
            FaultRates::NONE
        } else {
            rates
        };
        let values = [bench.inputs.analog[0], bench.all_on(1).analog[0], 0.0];
        let mut nets = NetSequence {
            owner: 1,
            cycle: 0,
            motion: None,
        };
        bench.set_rates(rates, to_device);
        for _ in 0..exchanges::<S>(is_arm) {
            let entry = nets.next(&bench);
            bench.step(ExecutorAction::Writes(entry));
            if bench.last.is_ok() && (S::HAS_CHECKSUM || !corrupts) {
                let value = bench.inputs.analog[0];
                // A lost exchange may give null.
                let known = value.is_nan() || values.contains(&value);
                assert!(known, "nobody has sent {value}");
            }
        }
        let faults: u64 = bench
            .path
            .counts()
            .iter()
            .map(|counts| counts.faults())
            .sum();
        assert!(faults > 0, "the proxy did nothing");
        bench.set_rates(FaultRates::NONE, FaultRates::NONE);
        bench.until_ready();
        let on = bench.all_on(nets.owner + 1);
        bench.until(ExecutorAction::Writes(on), "all outputs on", |bench| {
            bench.outputs_are_as(true)
        });
        let null = ExecutorAction::Writes(SetPoint::NONE);
        bench.until(null, "all outputs released", |bench| {
            bench.outputs_are_as(false)
        });
        assert_eq!(bench.checker.violations, [""; 0]);
        assert_eq!(bench.subject.protocol_violations(), [""; 0]);
    });
}

/// Probability of each fault, in each direction.
const RATE: f64 = 0.04;

/// Packets that do not arrive.
pub fn survives_lost_packets<S: Subject>() {
    survives::<S>(FaultRates {
        lost: RATE,
        ..FaultRates::NONE
    });
}

/// Packets that arrive up to 20 steps late.
pub fn survives_late_packets<S: Subject>() {
    survives::<S>(FaultRates {
        late: RATE,
        late_steps_max: 20,
        ..FaultRates::NONE
    });
}

/// Packets that arrive twice.
pub fn survives_duplicated_packets<S: Subject>() {
    survives::<S>(FaultRates {
        duplicated: RATE,
        ..FaultRates::NONE
    });
}

/// Packets that overtake each other.
pub fn survives_reordered_packets<S: Subject>() {
    survives::<S>(FaultRates {
        reordered: RATE,
        ..FaultRates::NONE
    });
}

/// Packets whose end is missing.
pub fn survives_truncated_packets<S: Subject>() {
    survives::<S>(FaultRates {
        truncated: RATE,
        ..FaultRates::NONE
    });
}

/// Packets with flipped bits, or with other bytes altogether.
pub fn survives_corrupted_packets<S: Subject>() {
    survives::<S>(FaultRates {
        corrupted: RATE,
        ..FaultRates::NONE
    });
}

/// All faults, each at a quarter of the rate.
pub fn survives_all_faults_at_once<S: Subject>() {
    let rate = RATE / 4.0;
    survives::<S>(FaultRates {
        lost: rate,
        late: rate,
        late_steps_max: 20,
        duplicated: rate,
        reordered: rate,
        truncated: rate,
        corrupted: rate,
    });
}
