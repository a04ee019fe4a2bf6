//! `Subtract`: out = a - b, rounded once.

use crate::frame::Frame;
use crate::primitive::{Entry, Kernel, Port, Spec, UnitRule, each};

/// The row of the catalogue.
pub const ENTRY: Entry = Entry::new(
    Spec {
        name: "Subtract",
        summary: "The difference of two numbers of the same unit.",
        inputs: &[
            Port::real("a", UnitRule::Var(0), "first operand"),
            Port::real("b", UnitRule::Var(0), "second operand"),
        ],
        outputs: &[Port::real("out", UnitRule::Var(0), "result")],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
);

#[inline(always)]
fn step(frame: &mut Frame<'_>, [a, b, out]: [u32; 3]) {
    let (a, b) = (frame.real(a), frame.real(b));
    frame.set_real(out, a - b);
}

#[cfg(test)]
mod tests {
    use crate::testing::check_binary;

    #[test]
    fn worked_values_and_null() {
        check_binary(
            "Subtract",
            &[
                [1.0, 2.0, -1.0],
                [0.3, 0.1, 0.19999999999999998],
                [f64::INFINITY, f64::INFINITY, f64::NAN],
            ],
        );
    }
}
