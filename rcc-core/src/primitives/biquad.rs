//! `Biquad`: a linear second-order filter given by its coefficients; higher orders are made by connecting several in
//! series.

use crate::filter;
use crate::frame::{Preparation, PrepareFault};
use crate::primitive::{
    CatalogueEntry, DefaultValue, Example, Kernel, Parameter, Port, Spec, UnitRule, each,
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
    &[Kernel::new(|frame, operands| {
        each(frame, operands, |frame, [input, out, _, _, _, _, _, state]| {
            filter::step(frame, input, out, state)
        });
    })],
)
.prepared_by(prepare);

fn prepare(preparation: &mut Preparation<'_>, operands: &[u32]) -> Result<(), PrepareFault> {
    if let &[_input, _out, b0, b1, b2, a1, a2, state] = operands {
        let [b0, b1, b2, a1, a2] = [b0, b1, b2, a1, a2].map(|slot| {
            let [value] = preparation.reals(slot);
            value
        });
        let biquad = filter::Biquad {
            b: [b0, b1, b2],
            a: [a1, a2],
        };
        filter::prepare(preparation, state, biquad);
    }
    Ok(())
}
