//! `JointVelocity`: joint velocities from the difference of two exchanges with the arm.
//!
//! Time is counted in periods as reported by the device, not by the arrival of datagrams, which would add network
//! jitter to the velocity. Nothing is smoothed.

use crate::frame::Frame;
use crate::joints::{JOINTS_MAX, Joints};
use crate::primitive::{
    CatalogueEntry, Device, Int, Kernel, Parameter, Port, PortType, Real, Slot, Spec, StateSpec,
    Step, UnitRule, operands,
};
use crate::types::NULL_REAL;

/// Positions and set-points of the last exchange, and both velocities.
const REALS: usize = 4 * JOINTS_MAX;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "JointVelocity",
        summary: "Measured and commanded joint velocities: the change between the last two exchanges, per time.",
        null: "null while the device is lost and until its second exchange",
        undefined: "the device is lost or was lost one exchange before; it does not report its period",
        formula: "(q - q_before) / (periods of the device between the two exchanges × its period)",
        outputs: &[
            Port::new(
                "velocity",
                PortType::Joints,
                UnitRule::Joint(1),
                "velocity of the measured positions, A1 first",
            ),
            Port::new(
                "commanded",
                PortType::Joints,
                UnitRule::Joint(1),
                "velocity of the set-points that the driver sends",
            )
            .diagnostic(),
        ],
        parameters: &[Parameter::arm()],
        state: StateSpec {
            reals: REALS as u32,
            ints: 1,
            ..StateSpec::NONE
        },
        ..Spec::PLAIN
    },
    &[Kernel::each::<JointVelocity>()],
);

operands! {
    struct JointVelocity {
        velocity: Slot<Real>, commanded: Slot<Real>, device: Device, reals: Slot<[Real; 32]>,
        periods: Slot<Int>, width: u32,
    }
}

impl Step for JointVelocity {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let [was, held, mut rate, mut held_rate]: [Joints; 4] =
            bytemuck::cast(frame.get(self.reals)?);
        let Some(m) = frame.measured(self.device).copied() else {
            frame.put(self.reals, [NULL_REAL; REALS])?;
            frame.put_joints(self.velocity, self.width, None)?;
            return frame.put_joints(self.commanded, self.width, None);
        };
        let now = i64::try_from(m.periods).unwrap_or(i64::MAX);
        let passed = now.saturating_sub(frame.get(self.periods)?);
        if passed != 0 {
            // A restarted driver counts from 0 again: no difference can be computed then.
            let time = if passed > 0 {
                passed as f64 * m.period_ns as f64 * 1e-9
            } else {
                NULL_REAL
            };
            (rate, held_rate) = (
                quotient(&m.position, &was, time),
                quotient(&m.hold, &held, time),
            );
            let memory: [Joints; 4] = [m.position, m.hold, rate, held_rate];
            frame.put(self.reals, bytemuck::cast(memory))?;
            frame.put(self.periods, now)?;
        }
        frame.put_joints(self.velocity, self.width, Some(&rate))?;
        frame.put_joints(self.commanded, self.width, Some(&held_rate))
    }
}

/// Returns the change per time; null if a value is unknown, or if no time has passed.
fn quotient(now: &Joints, before: &Joints, time_s: f64) -> Joints {
    let mut rates = [0.0; JOINTS_MAX];
    for (rate, (now, before)) in rates.iter_mut().zip(now.iter().zip(before)) {
        *rate = (now - before) / time_s;
    }
    let known = rates.iter().all(|rate| rate.is_finite());
    if known {
        rates
    } else {
        [NULL_REAL; JOINTS_MAX]
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::PrimitiveHarness;

    #[test]
    fn divides_by_the_periods_of_the_device_and_keeps_it_between_exchanges() {
        let mut bench = PrimitiveHarness::new("JointVelocity");
        bench.device.measurement.period_ns = 2_000_000;
        bench.device.measurement.periods = 10;
        assert!(bench.step().real("velocity").is_nan(), "no difference yet");
        let m = &mut bench.device.measurement;
        (m.periods, m.position[0], m.hold[1]) = (12, 0.004, -0.008);
        assert_eq!(bench.step().reals("velocity", 2), [1.0, 0.0]);
        assert_eq!(bench.reals("commanded", 2), [0.0, -2.0]);
        assert_eq!(
            bench.step().reals("velocity", 2),
            [1.0, 0.0],
            "no new exchange"
        );
        bench.device.measurement.periods = 13;
        assert_eq!(bench.step().reals("velocity", 2), [0.0, 0.0], "it stands");
    }

    #[test]
    fn restarts_with_the_device_or_its_driver() {
        let mut bench = PrimitiveHarness::new("JointVelocity");
        bench.device.measurement.period_ns = 1_000_000;
        for periods in [5, 6] {
            bench.device.measurement.periods = periods;
            bench.step();
        }
        assert_eq!(bench.real("velocity"), 0.0);
        bench.device.measurement.periods = 1;
        assert!(
            bench.step().real("velocity").is_nan(),
            "the driver counts from 0 again"
        );
        bench.device.measurement.periods = 2;
        assert_eq!(bench.step().real("velocity"), 0.0);
        bench.device.present = false;
        assert!(bench.step().real("velocity").is_nan());
        bench.device.present = true;
        bench.device.measurement.periods = 3;
        assert!(
            bench.step().real("velocity").is_nan(),
            "what was before the loss does not count"
        );
    }
}
