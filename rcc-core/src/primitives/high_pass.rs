//! `HighPass`: a first-order high-pass filter given by its cutoff. Its coefficients are computed when the net is
//! prepared.

use crate::filter::{self, Biquad};
use crate::frame::{Preparation, PrepareFault};
use crate::primitive::{CatalogueEntry, Example, Kernel, Parameter, Port, Spec, UnitRule, each};

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
    &[Kernel::new(|frame, operands| {
        each(frame, operands, |frame, [input, out, _, state]| filter::step(frame, input, out, state));
    })],
)
.prepared_by(prepare);

fn prepare(preparation: &mut Preparation<'_>, operands: &[u32]) -> Result<(), PrepareFault> {
    if let &[_input, _out, cutoff, state] = operands {
        let [cutoff_hz] = preparation.reals(cutoff);
        let high_pass = Biquad::high_pass(cutoff_hz, preparation.dt_s);
        filter::prepare(preparation, state, high_pass);
    }
    Ok(())
}
