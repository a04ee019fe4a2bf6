//! `TrapezoidalProgress`: turns a uniform progress from 0 to 1 into one that accelerates, cruises and decelerates.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, DefaultValue, Example, Kernel, Parameter, Port, Real, Slot, Spec, Step,
    UnitRule, operands, real_unless,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "TrapezoidalProgress",
        summary: "A progress from 0 to 1 with a trapezoidal velocity profile: acceleration, constant velocity, deceleration.",
        formula: "t = in within 0 and 1, r = (1 - constant) / 2, v = 1 / (1 - r): v t² / (2 r) for t < r, 1 - v (1 - t)² / \
                  (2 r) for t > 1 - r, else v (t - r / 2) (Biagiotti and Melchiorri, Trajectory Planning for Automatic \
                  Machines and Robots, 2008, 3.2)",
        examples: &[
            Example::new(
                "half of the time at constant velocity",
                "",
                "in | out
                 -1 | 0
                 0 | 0
                 0.125 | 0.041666666666666664
                 0.25 | 0.16666666666666666
                 0.5 | 0.5
                 0.875 | 0.9583333333333334
                 1 | 1
                 3 | 1
                 null | null",
            ),
            Example::new(
                "triangular velocity profile",
                "{constant: 0}",
                "in | out\n 0.25 | 0.125\n 0.5 | 0.5\n 0.75 | 0.875",
            ),
            Example::new(
                "constant velocity only",
                "{constant: 1}",
                "in | out\n 0 | 0\n 0.25 | 0.25\n 1 | 1",
            ),
        ],
        inputs: &[Port::real(
            "in",
            UnitRule::ONE,
            "uniform progress, from 0 to 1",
        )],
        outputs: &[Port::real(
            "out",
            UnitRule::ONE,
            "progress that starts and ends at rest",
        )
        .within(0.0, 1.0)],
        parameters: &[Parameter::real(
            "constant",
            UnitRule::ONE,
            "fraction of the time at constant velocity; 1: no ramps",
        )
        .default(DefaultValue::Real(0.5))
        .at_least(0.0)
        .at_most(1.0)],
        ..Spec::PLAIN
    },
    &[Kernel::each::<TrapezoidalProgress>()],
);

operands! {
    struct TrapezoidalProgress { input: Slot<Real>, out: Slot<Real>, constant: Slot<Real> }
}

impl Step for TrapezoidalProgress {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let value = frame.get(self.input)?;
        let ramp = (1.0 - frame.get(self.constant)?) / 2.0;
        // The second half mirrors the first one.
        let (mirrored, t) = if value > 0.5 {
            (true, 1.0 - value)
        } else {
            (false, value)
        };
        let t = if t > 0.0 { t } else { 0.0 };
        let speed = 1.0 / (1.0 - ramp);
        let eased = if t < ramp {
            speed * t * t / (2.0 * ramp)
        } else {
            speed * (t - ramp / 2.0)
        };
        let progress = if mirrored { 1.0 - eased } else { eased };
        frame.put(self.out, real_unless(value.is_nan(), progress))
    }
}
