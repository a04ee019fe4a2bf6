//! `Divide`: out = a / b, rounded once; a division by zero gives null.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, Real, Slot, Spec, Step, UnitRule, operands, real_unless,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Divide",
        summary: "The quotient of two numbers; its unit is the quotient of theirs.",
        undefined: "b = 0; overflow",
        examples: &[Example::new(
            "a quotient, and a division by zero",
            "",
            "a | b | out
                 6 | 3 | 2
                 1 | -4 | -0.25
                 1 | 0 | null
                 null | 1 | null",
        )],
        inputs: &[
            Port::real("a", UnitRule::Var(0), "first operand"),
            Port::real("b", UnitRule::Var(1), "second operand"),
        ],
        outputs: &[Port::real("out", UnitRule::Quotient(0, 1), "result")],
        ..Spec::PLAIN
    },
    &[Kernel::each::<Divide>()],
);

operands! {
    struct Divide { a: Slot<Real>, b: Slot<Real>, out: Slot<Real> }
}

impl Step for Divide {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let (a, b) = (frame.get(self.a)?, frame.get(self.b)?);
        frame.put(self.out, real_unless(b == 0.0, a / b))
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::check_binary;

    #[test]
    fn worked_values_and_null() {
        check_binary(
            "Divide",
            &[
                [6.0, 3.0, 2.0],
                [1.0, 0.0, f64::NAN],
                [0.0, 0.0, f64::NAN],
                [1.0, -0.0, f64::NAN],
            ],
        );
    }
}
