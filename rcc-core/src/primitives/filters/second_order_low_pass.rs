//! `SecondOrderLowPass`: a second-order low-pass filter given by cutoff and damping. Its coefficients are computed when
//! the net is prepared.

use core::f64::consts::FRAC_1_SQRT_2;

use crate::filter::{self, Biquad};
use crate::frame::{Frame, Preparation, PrepareFault};
use crate::primitive::{
    CatalogueEntry, DefaultValue, Example, Kernel, Parameter, Port, Prepare, Real, Slot, Spec,
    Step, UnitRule, operands,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "SecondOrderLowPass",
        summary: "Smooths a number by a second-order low-pass filter.",
        null: "a null input gives null and holds the state: filtering then continues as if no time had passed",
        undefined: "overflow",
        formula: "ω² / (s² + 2 damping ω s + ω²), ω = 2π cutoff; bilinear transform with prewarping \
                  (Oppenheim and Schafer, Discrete-Time Signal Processing, 3rd ed., 7.2.2)",
        examples: &[Example::new(
            "a step, Butterworth, with the cutoff at a quarter of the rate: starts in the steady state of the first input",
            "{cutoff: 2.5 Hz}",
            "in | out
             1 | 1
             1 | 1
             2 | 1.2928932188134525
             2 | 1.8786796564403576
             2 | 2.1213203435596424
             null | null
             2 | 2.0208152801713073",
        )
        .every_ms(100)],
        inputs: &[Port::real("in", UnitRule::Var(0), "number to filter")],
        outputs: &[Port::real("out", UnitRule::Var(0), "filtered number")],
        parameters: &[Parameter::real("cutoff", UnitRule::HERTZ, "frequency at which the gain is 1 / (2 damping), below half of the net's rate").above(0.0).below_nyquist(),
            Parameter::real("damping", UnitRule::ONE, "1/√2: maximally flat (Butterworth); 1: no overshoot")
                .default(DefaultValue::Real(FRAC_1_SQRT_2))
                .above(0.0),],
        state: filter::STATE,
        ..Spec::PLAIN
    },
    &[Kernel::each::<SecondOrderLowPass>()],
)
.prepared_by::<SecondOrderLowPass>();

operands! {
    struct SecondOrderLowPass { input: Slot<Real>, out: Slot<Real>, cutoff: Slot<Real>, damping: Slot<Real>, state: Slot<[Real; 8]> }
}

impl Step for SecondOrderLowPass {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        filter::step(frame, self.input, self.out, self.state)
    }
}

impl Prepare for SecondOrderLowPass {
    fn prepare(self, preparation: &mut Preparation<'_>) -> Result<(), PrepareFault> {
        let (cutoff_hz, damping) = (preparation.get(self.cutoff), preparation.get(self.damping));
        let low_pass = Biquad::low_pass(cutoff_hz, damping, preparation.dt_s);
        filter::prepare(preparation, self.state, low_pass);
        Ok(())
    }
}
