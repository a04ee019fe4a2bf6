//! `Time`: logical time since START, 0 in the first cycle; one period per evaluated cycle, independent of the wall
//! clock.

use crate::frame::Frame;
use crate::primitive::{CatalogueEntry, Example, Kernel, Port, Spec, UnitRule, each};
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
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
);

#[inline(always)]
fn step(frame: &mut Frame<'_>, [out]: [u32; 1]) {
    let time_s = frame.cycle as f64 * frame.dt_s;
    frame.set_real(out, time_s);
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
