//! `Biquad`: a linear second-order filter given by its coefficients; higher orders are made by connecting several in
//! series.

use crate::filter;
use crate::frame::{Frame, Preparation, PrepareFault};
use crate::primitive::{
    CatalogueEntry, DefaultValue, Example, Kernel, Parameter, Port, Prepare, Real, Slot, Spec,
    Step, UnitRule, operands,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Biquad",
        summary: "A linear second-order filter given by its coefficients.",
        null: "a null input gives null and holds the state: filtering then continues as if no time had passed",
        undefined: "overflow: unstable coefficients",
        formula: "out = b0 in + b1 in₁ + b2 in₂ - a1 out₁ - a2 out₂ (the last two cycles' values), H(z) = (b0 + b1/z + \
                  b2/z²) / (1 + a1/z + a2/z²); transposed direct form II (Oppenheim and Schafer, Discrete-Time Signal \
                  Processing, 3rd ed., 6.3.4)",
        examples: &[
            Example::new(
                "the mean of the last two inputs",
                "{b0: 0.5, b1: 0.5}",
                "in | out\n 1 | 1\n 3 | 2\n 5 | 4\n null | null\n 7 | 6",
            ),
            Example::new(
                "an integrating filter starts at rest",
                "{b0: 1, a1: -1}",
                "in | out\n 1 | 1\n 3 | 4\n 5 | 9",
            ),
        ],
        inputs: &[Port::real("in", UnitRule::Var(0), "number to filter")],
        outputs: &[Port::real(
            "out",
            UnitRule::Var(0),
            "filtered number; it starts in the steady state of the first input",
        )],
        parameters: &[
            Parameter::real("b0", UnitRule::ONE, "part of the input"),
            Parameter::real("b1", UnitRule::ONE, "coefficient of the last cycle's input").default(DefaultValue::Real(0.0)),
            Parameter::real("b2", UnitRule::ONE, "coefficient of the input two cycles ago").default(DefaultValue::Real(0.0)),
            Parameter::real("a1", UnitRule::ONE, "coefficient of the last cycle's output, subtracted").default(DefaultValue::Real(0.0)),
            Parameter::real("a2", UnitRule::ONE, "coefficient of the output two cycles ago, subtracted").default(DefaultValue::Real(0.0)),
        ],
        state: filter::STATE,
        ..Spec::PLAIN
    },
    &[Kernel::each::<Biquad>()],
)
.prepared_by::<Biquad>();

operands! {
    struct Biquad { input: Slot<Real>, out: Slot<Real>, b0: Slot<Real>, b1: Slot<Real>, b2: Slot<Real>, a1: Slot<Real>, a2: Slot<Real>, state: Slot<[Real; 8]> }
}

impl Step for Biquad {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        filter::step(frame, self.input, self.out, self.state)
    }
}

impl Prepare for Biquad {
    fn prepare(self, preparation: &mut Preparation<'_>) -> Result<(), PrepareFault> {
        let biquad = filter::Biquad {
            b: [self.b0, self.b1, self.b2].map(|slot| preparation.get(slot)),
            a: [self.a1, self.a2].map(|slot| preparation.get(slot)),
        };
        filter::prepare(preparation, self.state, biquad);
        Ok(())
    }
}
