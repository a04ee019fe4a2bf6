//! `Median`: the median of three numbers: one faulty sensor of three is outvoted.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Int, Kernel, Port, Real, Slot, Spec, Step, UnitRule, choose, higher,
    lower, operands, real_unless,
};
use crate::types::NULL_INT;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Median",
        summary: "The median of three numbers.",
        examples: &[
            Example::new(
                "real numbers",
                "",
                "a | b | c | out
                 1.0 | 9.5 | 2.0 | 2.0
                 3.0 | 1.0 | 2.0 | 2.0
                 1.0 | 1.0 | 5.0 | 1.0
                 1.0 | null | 2.0 | null",
            ),
            Example::new(
                "integers",
                "",
                "a | b | c | out
                 1 | 9 | 2 | 2
                 null | 1 | 2 | null",
            )
            .whole(),
        ],
        inputs: &[
            Port::number("a", UnitRule::Var(0), "first number"),
            Port::number("b", UnitRule::Var(0), "second number"),
            Port::number("c", UnitRule::Var(0), "third number"),
        ],
        outputs: &[Port::number(
            "out",
            UnitRule::Var(0),
            "the middle one of the three",
        )],
        ..Spec::PLAIN
    },
    &[
        Kernel::each::<Median<Real>>(),
        Kernel::each::<Median<Int>>(),
    ],
);

operands! {
    struct Median<E> { a: Slot<E>, b: Slot<E>, c: Slot<E>, out: Slot<E> }
}

impl Step for Median<Real> {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let (a, b, c) = (frame.get(self.a)?, frame.get(self.b)?, frame.get(self.c)?);
        let null = a.is_nan() | b.is_nan() | c.is_nan();
        let middle = higher(lower(a, b), lower(higher(a, b), c));
        frame.put(self.out, real_unless(null, middle))
    }
}

impl Step for Median<Int> {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let (a, b, c) = (frame.get(self.a)?, frame.get(self.b)?, frame.get(self.c)?);
        let null = (a == NULL_INT) | (b == NULL_INT) | (c == NULL_INT);
        frame.put(
            self.out,
            choose(null, NULL_INT, a.min(b).max(a.max(b).min(c))),
        )
    }
}
