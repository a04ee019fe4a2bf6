//! `Notch`: a band-stop filter for one frequency. Its coefficients are computed when the net is prepared.

use crate::filter::{self, Biquad};
use crate::frame::{Frame, Preparation, PrepareFault};
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Parameter, Port, Prepare, Real, Slot, Spec, Step, UnitRule,
    operands,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Notch",
        summary: "Removes one frequency from a number, e.g. a resonance.",
        null: "a null input gives null and holds the state: filtering then continues as if no time had passed",
        undefined: "overflow",
        formula: "(s² + ω²) / (s² + ω s / quality + ω²), ω = 2π frequency; bilinear transform with prewarping \
                  (Oppenheim and Schafer, Discrete-Time Signal Processing, 3rd ed., 7.2.2)",
        examples: &[Example::new(
            "notch at a quarter of the rate: an oscillation with a period of four cycles vanishes, a constant remains",
            "{frequency: 2.5 Hz, quality: 1}",
            "in | out
             3 | 3
             4 | 3.6666666666666665
             3 | 3
             2 | 2.7777777777777777
             null | null
             3 | 3",
        )
        .every_ms(100)],
        inputs: &[Port::real("in", UnitRule::Var(0), "number to filter")],
        outputs: &[Port::real("out", UnitRule::Var(0), "filtered number")],
        parameters: &[Parameter::real("frequency", UnitRule::HERTZ, "frequency to remove, below half of the net's rate").above(0.0).below_nyquist(),
            Parameter::real("quality", UnitRule::ONE, "frequency / width of the band between the -3 dB points").above(0.0),],
        state: filter::STATE,
        ..Spec::PLAIN
    },
    &[Kernel::each::<Notch>()],
)
.prepared_by::<Notch>();

operands! {
    struct Notch { input: Slot<Real>, out: Slot<Real>, frequency: Slot<Real>, quality: Slot<Real>, state: Slot<[Real; 8]> }
}

impl Step for Notch {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        filter::step(frame, self.input, self.out, self.state)
    }
}

impl Prepare for Notch {
    fn prepare(self, preparation: &mut Preparation<'_>) -> Result<(), PrepareFault> {
        let (frequency_hz, quality) = (
            preparation.get(self.frequency),
            preparation.get(self.quality),
        );
        let notch = Biquad::notch(frequency_hz, quality, preparation.dt_s);
        filter::prepare(preparation, self.state, notch);
        Ok(())
    }
}
