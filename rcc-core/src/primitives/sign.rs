//! `Sign`: -1, 0 or 1.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, Spec, UnitRule, choose, each, real_unless,
};
use crate::types::{NULL_INT, Store};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Sign",
        summary: "The sign of a number: -1, 0 or 1.",
        examples: &[
            Example::new(
                "real numbers",
                "",
                "in | out
                 2.5 | 1.0
                 -0.1 | -1.0
                 0.0 | 0.0
                 null | null",
            ),
            Example::new(
                "integers",
                "",
                "in | out
                 7 | 1
                 -7 | -1
                 0 | 0
                 null | null",
            )
            .whole(),
        ],
        inputs: &[Port::number("in", UnitRule::Var(0), "number")],
        outputs: &[Port::number("out", UnitRule::ONE, "its sign").within(-1.0, 1.0)],
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
fn step_real(frame: &mut Frame<'_>, [input, out]: [u32; 2]) -> Option<()> {
    let value = frame.get_real(input)?;
    let sign = f64::from(i8::from(value > 0.0) - i8::from(value < 0.0));
    frame.put_real(out, real_unless(value.is_nan(), sign))
}

#[inline(always)]
fn step_int(frame: &mut Frame<'_>, [input, out]: [u32; 2]) -> Option<()> {
    let value = frame.get_int(input)?;
    frame.put_int(out, choose(value == NULL_INT, NULL_INT, value.signum()))
}
