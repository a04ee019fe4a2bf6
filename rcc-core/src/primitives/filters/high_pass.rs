//! `HighPass`: a first-order high-pass filter given by its cutoff. Its coefficients are computed when the net is
//! prepared.

use crate::filter::{self, Biquad};
use crate::frame::{Frame, Preparation, PrepareFault};
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Parameter, Port, Prepare, Real, Slot, Spec, Step, UnitRule,
    operands,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "HighPass",
        summary: "Removes mean and slow drift from a number by a first-order high-pass filter.",
        null: "a null input gives null and holds the state: filtering then continues as if no time had passed",
        undefined: "overflow",
        formula: "s / (s + ω), ω = 2π cutoff; bilinear transform with prewarping \
                  (Oppenheim and Schafer, Discrete-Time Signal Processing, 3rd ed., 7.2.2)",
        examples: &[Example::new(
            "a step, with the cutoff at a quarter of the rate; a constant gives 0",
            "{cutoff: 2.5 Hz}",
            "in | out\n 5 | 0\n 5 | 0\n 7 | 1\n 7 | 0\n null | null\n 6 | -0.5",
        )
        .every_ms(100)],
        inputs: &[Port::real("in", UnitRule::Var(0), "number to filter")],
        outputs: &[Port::real("out", UnitRule::Var(0), "filtered number")],
        parameters: &[Parameter::real("cutoff", UnitRule::HERTZ, "frequency at which the gain is 1/√2, below half of the net's rate").above(0.0).below_nyquist()],
        state: filter::STATE,
        ..Spec::PLAIN
    },
    &[Kernel::each::<HighPass>()],
)
.prepared_by::<HighPass>();

operands! {
    struct HighPass { input: Slot<Real>, out: Slot<Real>, cutoff: Slot<Real>, state: Slot<[Real; 8]> }
}

impl Step for HighPass {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        filter::step(frame, self.input, self.out, self.state)
    }
}

impl Prepare for HighPass {
    fn prepare(self, preparation: &mut Preparation<'_>) -> Result<(), PrepareFault> {
        let cutoff_hz = preparation.get(self.cutoff);
        let high_pass = Biquad::high_pass(cutoff_hz, preparation.dt_s);
        filter::prepare(preparation, self.state, high_pass);
        Ok(())
    }
}
