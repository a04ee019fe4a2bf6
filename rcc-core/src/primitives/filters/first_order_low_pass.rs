//! `FirstOrderLowPass`: a first-order lag (PT1) given by its time constant. Its gain is computed when the net is
//! prepared.

use crate::frame::{Frame, Preparation, PrepareFault};
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Parameter, Port, Prepare, Real, Slot, Spec, StateSpec, Step,
    UnitRule, finite, operands,
};
use crate::types::NULL_REAL;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "FirstOrderLowPass",
        summary: "Smooths a number by a first-order low-pass filter with a time constant.",
        null: "a null input gives null and holds the state: it then continues from the last output",
        undefined: "overflow",
        formula: "out += (in - out) · (1 - e^(-dt / T)), the exact step response of 1 / (1 + T s) (Åström and Wittenmark, Computer-Controlled Systems, 3rd ed., table 2.1); LowPass takes the gain itself",
        examples: &[Example::new(
            "after one time constant, 1/e of a step remains",
            "{time_constant: 0.3 s}",
            "in | out
             1 | 1
             0 | 0.7165313105737893
             0 | 0.5134171190325921
             null | null
             0 | 0.36787944117144233",
        )
        .every_ms(100)],
        inputs: &[Port::real("in", UnitRule::Var(0), "number to smooth")],
        outputs: &[Port::real("out", UnitRule::Var(0), "smoothed number; starts at the first input")],
        parameters: &[
            Parameter::real("time_constant", UnitRule::SECOND, "T: after this time 1/e of a step remains; cutoff 1 / (2π T)").above(0.0),
        ],
        // gain, last output
        state: StateSpec {
            reals: 2,
            ..StateSpec::NONE
        },
        ..Spec::PLAIN
    },
    &[Kernel::each::<FirstOrderLowPass>()],
)
.prepared_by::<FirstOrderLowPass>();

impl Prepare for FirstOrderLowPass {
    fn prepare(self, preparation: &mut Preparation<'_>) -> Result<(), PrepareFault> {
        let time_constant_s = preparation.get(self.time_constant);
        let gain = -libm::expm1(-preparation.dt_s / time_constant_s);
        preparation.put(self.state, [gain, NULL_REAL]);
        Ok(())
    }
}

operands! {
    struct FirstOrderLowPass {
        input: Slot<Real>, out: Slot<Real>, time_constant: Slot<Real>, state: Slot<[Real; 2]>,
    }
}

impl Step for FirstOrderLowPass {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let (value, [gain, before]) = (frame.get(self.input)?, frame.get(self.state)?);
        let moved = before + (value - before) * gain;
        let now = finite(if before.is_nan() { value } else { moved });
        frame.put(self.out, now)?;
        frame.put(self.state, [gain, if now.is_nan() { before } else { now }])
    }
}
