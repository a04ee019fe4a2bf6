//! Packets that are lost, late, duplicated, reordered, truncated or corrupted, drawn from a seed.
//! Test code only; a failure prints its seed, `RCC_SEED` repeats it.

use rcc_core::message::{DeviceState, SetPoint};

use super::super::Subject;
use super::super::bench::{Bench, Executor};
use super::super::real::with_seeds;
use super::rest::{Motion, motion_of};
use crate::proxy::Rates;

/// Exchanges under faults of an arm, in virtual time, and of a device with a clock of its own.
const EXCHANGES: [usize; 2] = [4000, 150];
/// Cycles for which outputs are on, then off.
const BLINK: u64 = 20;

/// Nets that follow each other: motions there and back, or blinking outputs.
struct Nets {
    owner: u64,
    cycle: u64,
    motion: Option<Motion>,
}

impl Nets {
    fn next<S: Subject>(&mut self, bench: &Bench<S>) -> SetPoint {
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

fn survives<S: Subject>(rates: Rates) {
    let [arm, io] = EXCHANGES;
    with_seeds(|seed| {
        let mut bench = Bench::<S>::ready(seed);
        let is_arm = bench.device.robot.is_some();
        let corrupts = rates.corrupted > 0.0;
        // Without checks on the wire the device could not know either; that would test the device.
        let to_device = if corrupts && !S::CHECKED {
            Rates::NONE
        } else {
            rates
        };
        let values = [bench.inputs.analog[0], bench.all_on(1).analog[0], 0.0];
        let mut nets = Nets {
            owner: 1,
            cycle: 0,
            motion: None,
        };
        bench.set_rates(rates, to_device);
        for _ in 0..if is_arm { arm } else { io } {
            let entry = nets.next(&bench);
            bench.step(Executor::Writes(entry));
            if bench.last.is_ok() && (S::CHECKED || !corrupts) {
                let value = bench.inputs.analog[0];
                assert!(values.contains(&value), "nobody has sent {value}");
            }
        }
        let faults: u64 = bench
            .between
            .counts()
            .iter()
            .map(|counts| counts.faults())
            .sum();
        assert!(faults > 0, "the proxy did nothing");
        bench.set_rates(Rates::NONE, Rates::NONE);
        bench.until_ready();
        let on = bench.all_on(nets.owner + 1);
        bench.until(Executor::Writes(on), "all outputs on", |bench| {
            bench.told_as(true)
        });
        let null = Executor::Writes(SetPoint::NONE);
        bench.until(null, "all outputs released", |bench| bench.told_as(false));
        assert_eq!(bench.judge.violations, [""; 0]);
        assert_eq!(bench.subject.complaints(), [""; 0]);
    });
}

/// One in twenty-five, each way.
const RATE: f64 = 0.04;

/// Packets that do not arrive.
pub fn survives_lost_packets<S: Subject>() {
    survives::<S>(Rates {
        lost: RATE,
        ..Rates::NONE
    });
}

/// Packets that arrive up to 20 steps later.
pub fn survives_late_packets<S: Subject>() {
    survives::<S>(Rates {
        late: RATE,
        late_steps_max: 20,
        ..Rates::NONE
    });
}

/// Packets that arrive twice.
pub fn survives_duplicated_packets<S: Subject>() {
    survives::<S>(Rates {
        duplicated: RATE,
        ..Rates::NONE
    });
}

/// Packets that overtake each other.
pub fn survives_reordered_packets<S: Subject>() {
    survives::<S>(Rates {
        reordered: RATE,
        ..Rates::NONE
    });
}

/// Packets that end too early.
pub fn survives_truncated_packets<S: Subject>() {
    survives::<S>(Rates {
        truncated: RATE,
        ..Rates::NONE
    });
}

/// Packets with other bits, or other bytes altogether.
pub fn survives_corrupted_packets<S: Subject>() {
    survives::<S>(Rates {
        corrupted: RATE,
        ..Rates::NONE
    });
}

/// Everything, a little.
pub fn survives_all_faults_at_once<S: Subject>() {
    let rate = RATE / 4.0;
    survives::<S>(Rates {
        lost: rate,
        late: rate,
        late_steps_max: 20,
        duplicated: rate,
        reordered: rate,
        truncated: rate,
        corrupted: rate,
    });
}
