//! `DeviceStatus`: the state of a device and of the connection to it.
//!
//! A cycle has no clock: the age is counted in evaluations of the net, so that a replay gives the same value.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Device, Int, Kernel, Parameter, Port, Real, Slot, Spec, StateSpec, Step,
    UnitRule, operands,
};
use crate::types::{NULL_INT, NULL_REAL};
use crate::unit::Unit;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "DeviceStatus",
summary: "State, connection quality and age of a device's measurements; `IsNull` of an output tells that the device is lost.",
null: "null while the device is lost",
undefined: "the device is lost",
outputs: &[Port::int("state", "1 online, cannot be commanded; 2 ready; 3 commanded by a net; 4 being brought to rest").diagnostic(), Port::int("reason", "reason why it is not ready, a number of its driver that `rcc-cli devices` explains; 0: no reason").diagnostic(), Port::real("quality", UnitRule::Is(Unit::ONE), "quality of the connection, 1 is best").diagnostic(), Port::real("age", UnitRule::Is(Unit::SECOND), "time since the last new measurement, in whole periods of the net; 0: new in this cycle").diagnostic(), Port::int("late", "number of exchanges that the driver answered late since it started").diagnostic(), Port::int("refused", "number of datagrams that the driver refused since it started").diagnostic(), Port::int("starved", "number of times that the driver had no set-point in time while commanded since it started").diagnostic()],
parameters: &[Parameter::device()],
state: StateSpec { ints: 2, ..StateSpec::NONE },
        ..Spec::PLAIN
    },
    &[Kernel::each::<DeviceStatus>()],
);

operands! {
    struct DeviceStatus {
        state: Slot<Int>, reason: Slot<Int>, quality: Slot<Real>, age: Slot<Real>, late: Slot<Int>,
        refused: Slot<Int>, starved: Slot<Int>, device: Device, memory: Slot<[Int; 2]>,
    }
}

impl Step for DeviceStatus {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let Some(m) = frame.measured(self.device).copied() else {
            for slot in [
                self.state,
                self.reason,
                self.late,
                self.refused,
                self.starved,
            ] {
                frame.put(slot, NULL_INT)?;
            }
            frame.put(self.quality, NULL_REAL)?;
            return frame.put(self.age, NULL_REAL);
        };
        // The last sequence number, and the number of evaluations since then.
        let [seen, waited] = frame.get(self.memory)?;
        let sequence = whole(m.sequence);
        let waited = if sequence == seen {
            waited.saturating_add(1)
        } else {
            0
        };
        frame.put(self.memory, [sequence, waited])?;
        frame.put(self.age, waited as f64 * frame.dt_s)?;
        frame.put(self.quality, f64::from(m.quality_permille) / 1000.0)?;
        frame.put(self.state, i64::from(m.state))?;
        frame.put(self.reason, i64::from(m.reason))?;
        let counts = [
            (self.late, m.late),
            (self.refused, m.refused),
            (self.starved, m.starved),
        ];
        for (slot, count) in counts {
            frame.put(slot, whole(count))?;
        }
        Some(())
    }
}

fn whole(count: u64) -> i64 {
    i64::try_from(count).unwrap_or(i64::MAX)
}

#[cfg(test)]
mod tests {
    use crate::testing::PrimitiveHarness;
    use crate::types::NULL_INT;

    #[test]
    fn the_age_grows_until_something_new_is_measured() {
        let mut bench = PrimitiveHarness::new("DeviceStatus");
        bench.device.measurement.sequence = 7;
        assert_eq!(bench.step().real("age"), 0.0);
        assert_eq!(bench.step().real("age"), 0.001);
        assert_eq!(bench.step().real("age"), 0.002);
        bench.device.measurement.sequence = 8;
        assert_eq!(bench.step().real("age"), 0.0);
    }

    #[test]
    fn gives_the_state_and_the_counters_and_null_when_lost() {
        let mut bench = PrimitiveHarness::new("DeviceStatus");
        let m = &mut bench.device.measurement;
        (m.state, m.reason, m.quality_permille) = (2, 5, 875);
        (m.late, m.refused, m.starved) = (3, 4, u64::MAX);
        bench.step();
        let ints = ["state", "reason", "late", "refused", "starved"].map(|name| bench.int(name));
        assert_eq!(ints, [2, 5, 3, 4, i64::MAX]);
        assert_eq!(bench.real("quality"), 0.875);
        bench.device.present = false;
        bench.step();
        assert_eq!(bench.int("state"), NULL_INT);
        assert!(bench.real("age").is_nan() && bench.real("quality").is_nan());
    }
}
