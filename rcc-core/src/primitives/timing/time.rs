//! `Time`: logical time since START, 0 in the first cycle; one period per evaluated cycle, independent of the wall
//! clock.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, Real, Slot, Spec, Step, UnitRule, operands,
};
use crate::unit::Unit;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Time",
        summary: "Logical time since the command was started.",
        null: "never null",
        formula: "number of the cycle · period",
        examples: &[
            Example::new(
                "one period per cycle",
                "",
                "out
                 0 s
                 1 ms
                 2 ms",
            ),
            Example::new(
                "a slower net",
                "",
                "out
                 0 s
                 5 ms",
            )
            .every_ms(5),
        ],
        outputs: &[Port::real(
            "out",
            UnitRule::Is(Unit::SECOND),
            "time since START; 0 in the first cycle",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::each::<Time>()],
);

operands! {
    struct Time { out: Slot<Real> }
}

impl Step for Time {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let time_s = frame.cycle as f64 * frame.dt_s;
        frame.put(self.out, time_s)
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::PrimitiveHarness;

    #[test]
    fn counts_periods_from_zero() {
        let mut bench = PrimitiveHarness::new("Time");
        assert_eq!(bench.step().real("out"), 0.0);
        assert_eq!(bench.step().real("out"), 1e-3);
        bench.cycle = 3_600_000;
        assert_eq!(bench.step().real("out"), 3600.0);
    }
}
