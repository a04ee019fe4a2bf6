//! `Abs`: out = |in|.

use crate::frame::Frame;
use crate::primitive::{Entry, Kernel, Port, Spec, UnitRule, each};

/// The row of the catalogue.
pub const ENTRY: Entry = Entry::new(
    Spec {
        name: "Abs",
        summary: "The absolute value of a number.",
        inputs: &[Port::real("in", UnitRule::Var(0), "operand")],
        outputs: &[Port::real("out", UnitRule::Var(0), "result")],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
);

#[inline(always)]
fn step(frame: &mut Frame<'_>, [input, out]: [u32; 2]) {
    let value = frame.real(input);
    frame.set_real(out, value.abs());
}

#[cfg(test)]
mod tests {
    use crate::testing::Bench;

    #[test]
    fn worked_values_and_null() {
        let mut bench = Bench::new("Abs");
        for (input, out) in [(1.5, 1.5), (-1.5, 1.5), (f64::NEG_INFINITY, f64::INFINITY)] {
            assert_eq!(bench.set_real("in", input).step().real("out"), out);
        }
        assert!(bench.set_real("in", f64::NAN).step().real("out").is_nan());
    }
}
