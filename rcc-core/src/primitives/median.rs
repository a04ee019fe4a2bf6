//! `Median`: the median of three numbers: one faulty sensor of three is outvoted.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, Spec, UnitRule, choose, each, higher, lower, real_unless,
};
use crate::types::{NULL_INT, Store};

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
        Kernel::of(Store::Real, |frame, operands| {
            each(frame, operands, step_real);
        }),
        Kernel::of(Store::Int, |frame, operands| {
            each(frame, operands, step_int);
        }),
    ],
);

#[inline(always)]
fn step_real(frame: &mut Frame<'_>, [a, b, c, out]: [u32; 4]) -> Option<()> {
    let (a, b, c) = (frame.get_real(a)?, frame.get_real(b)?, frame.get_real(c)?);
    let null = a.is_nan() | b.is_nan() | c.is_nan();
    let middle = higher(lower(a, b), lower(higher(a, b), c));
    frame.put_real(out, real_unless(null, middle))
}

#[inline(always)]
fn step_int(frame: &mut Frame<'_>, [a, b, c, out]: [u32; 4]) -> Option<()> {
    let (a, b, c) = (frame.get_int(a)?, frame.get_int(b)?, frame.get_int(c)?);
    let null = (a == NULL_INT) | (b == NULL_INT) | (c == NULL_INT);
    frame.put_int(out, choose(null, NULL_INT, a.min(b).max(a.max(b).min(c))))
}
