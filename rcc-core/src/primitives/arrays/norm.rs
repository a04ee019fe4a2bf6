//! `Norm`: the Euclidean length of a vector.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, Real, Slot, Spec, Step, TypeFamily, UnitRule, operands,
};
use crate::types::NULL_REAL;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Norm",
        summary: "The Euclidean length of a vector or array.",
        null: "a null element gives null",
        undefined: "overflow: an infinite element, a result out of range",
        formula: "square root of the sum of squares, by hypot, so that no square overflows",
        examples: &[Example::new(
            "any size",
            "",
            "in | out\n\
             [2.0, -3.0, 6.0] | 7\n\
             [3e200, 0.0, -4e200] | 5e200\n\
             [0.0, 0.0, 0.0] | 0\n\
             null | null",
        )],
        inputs: &[Port::of(
            "in",
            TypeFamily::Vector,
            UnitRule::Var(0),
            "vector",
        )],
        outputs: &[Port::real("out", UnitRule::Var(0), "length").within(0.0, f64::MAX)],
        ..Spec::PLAIN
    },
    &[Kernel::each::<Norm>()],
);

operands! {
    struct Norm for Real { input: Slot<Real>, out: Slot<Real>, width: u32 }
}

impl Step for Norm {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let mut length = 0.0;
        let mut null = false;
        for i in 0..self.width {
            let element = frame.get(self.input + i)?;
            // The hypotenuse of infinity and NaN is infinite.
            null |= !element.is_finite();
            length = libm::hypot(length, element);
        }
        let known = !null && length.is_finite();
        frame.put(self.out, if known { length } else { NULL_REAL })
    }
}
