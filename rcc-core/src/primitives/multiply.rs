//! `Multiply`: out = a × b, rounded once.

use crate::frame::Frame;
use crate::primitive::{Entry, Kernel, Port, Spec, UnitRule, each};

/// The row of the catalogue.
pub const ENTRY: Entry = Entry::new(
    Spec {
        name: "Multiply",
        summary: "The product of two numbers; its unit is the product of theirs.",
        inputs: &[
            Port::real("a", UnitRule::Var(0), "first operand"),
            Port::real("b", UnitRule::Var(1), "second operand"),
        ],
        outputs: &[Port::real("out", UnitRule::Product(0, 1), "result")],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
);

#[inline(always)]
fn step(frame: &mut Frame<'_>, [a, b, out]: [u32; 3]) {
    let (a, b) = (frame.real(a), frame.real(b));
    frame.set_real(out, a * b);
}

#[cfg(test)]
mod tests {
    use crate::testing::check_binary;

    #[test]
    fn worked_values_and_null() {
        check_binary(
            "Multiply",
            &[
                [2.0, 3.0, 6.0],
                [-0.5, 4.0, -2.0],
                [0.0, f64::INFINITY, f64::NAN],
            ],
        );
    }
}
