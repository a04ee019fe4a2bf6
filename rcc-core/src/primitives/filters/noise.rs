//! `Noise`: uniformly distributed pseudo-random numbers for tests; the same sequence in every run with the same seed.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, DefaultValue, Example, Int, Kernel, Parameter, Port, Real, Slot, Spec,
    StateSpec, Step, UnitRule, finite, operands,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Noise",
        summary: "Uniformly distributed pseudo-random numbers, the same in every run with the same seed.",
        null: "a null input gives null; the sequence continues",
        undefined: "overflow",
        formula: "SplitMix64 of the seed and the cycle number; the upper 53 bits give the number (Steele, Lea and Flood, Fast Splittable Pseudorandom Number Generators, OOPSLA 2014, fig. 16)",
        examples: &[Example::new(
            "first numbers for seed 1",
            "{seed: 1}",
            "amplitude | out
             1.0 | 0.1331231503445618
             null | null
             2.0 | 1.8840110143471849",
        )],
        inputs: &[
            Port::real("amplitude", UnitRule::Var(0), "largest distance from 0")
                .default(DefaultValue::Real(1.0)),
        ],
        outputs: &[Port::real(
            "out",
            UnitRule::Var(0),
            "from -amplitude (included) to amplitude (excluded)",
        )],
        parameters: &[Parameter::int("seed", "selects the sequence").default(DefaultValue::Int(1))],
        state: StateSpec {
            ints: 1,
            ..StateSpec::NONE
        },
        ..Spec::PLAIN
    },
    &[Kernel::each::<Noise>()],
);

operands! {
    struct Noise { amplitude: Slot<Real>, out: Slot<Real>, seed: Slot<Int>, count: Slot<Int> }
}

impl Step for Noise {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let (amplitude, number) = (frame.get(self.amplitude)?, frame.get(self.count)?);
        let next = number.wrapping_add(1).max(0);
        let bits = mixed(frame.get(self.seed)? as u64, next as u64);
        // 53 bits are exact in a Real; 2^52 is the middle of their range.
        let even = ((bits >> 11) as f64 - 4_503_599_627_370_496.0) / 4_503_599_627_370_496.0;
        frame.put(self.out, finite(amplitude * even))?;
        frame.put(self.count, next)
    }
}

/// Returns output `number` of SplitMix64.
#[inline(always)]
fn mixed(seed: u64, number: u64) -> u64 {
    let z = seed.wrapping_add(number.wrapping_mul(0x9e37_79b9_7f4a_7c15));
    let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
