//! `Quantize`: rounds to the nearest multiple of a step, like a coarse display or converter.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Parameter, Port, Spec, UnitRule, each, finite,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Quantize",
        summary: "The nearest multiple of a step.",
        undefined: "overflow",
        formula: "out = step · round(in / step), halves are rounded away from 0",
        examples: &[Example::new(
            "quarters",
            "{step: 0.25}",
            "in | out
             0.3 | 0.25
             0.125 | 0.25
             -0.125 | -0.25
             0.1 | 0
             null | null",
        )],
        inputs: &[Port::real("in", UnitRule::Var(0), "number")],
        outputs: &[Port::real("out", UnitRule::Var(0), "nearest multiple")],
        parameters: &[
            Parameter::real("step", UnitRule::Var(0), "distance between two results").above(0.0),
        ],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
);

#[inline(always)]
fn step(frame: &mut Frame<'_>, [input, out, step]: [u32; 3]) -> Option<()> {
    let (value, step) = (frame.get_real(input)?, frame.get_real(step)?);
    frame.put_real(out, finite(step * libm::round(value / step)))
}
