//! `Hypotenuse`: √(a² + b²) without intermediate overflow.

use crate::primitive::{CatalogueEntry, Example, Kernel, Port, Spec, UnitRule, each_finite};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Hypotenuse",
        summary: "The square root of the sum of two squares.",
        undefined: "overflow",
        formula: "out = √(a² + b²); libm (from FreeBSD msun), error below 1 unit in the last place",
        examples: &[Example::new(
            "a right triangle",
            "",
            "a | b | out
             3 | 4 | 5
             -5 | 12 | 13
             0 | -2 | 2
             3e200 | 4e200 | 5e200
             null | 4 | null",
        )],
        inputs: &[
            Port::real("a", UnitRule::Var(0), "first operand"),
            Port::real("b", UnitRule::Var(0), "second operand"),
        ],
        outputs: &[Port::real("out", UnitRule::Var(0), "result").within(0.0, f64::MAX)],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| {
        each_finite(frame, operands, libm::hypot);
    })],
);
