//! `Quantize`: rounds to the nearest multiple of a step, like a coarse display or converter.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Parameter, Port, Real, Slot, Spec, Step, UnitRule, finite,
    operands,
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
    &[Kernel::each::<Quantize>()],
);

operands! {
    struct Quantize { input: Slot<Real>, out: Slot<Real>, step: Slot<Real> }
}

impl Step for Quantize {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let (value, step) = (frame.get(self.input)?, frame.get(self.step)?);
        frame.put(self.out, finite(step * libm::round(value / step)))
    }
}
