//! `ToBits`: an integer as an array of Bools, lowest bit first.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, DefaultValue, Dim, ElementType, Example, Int, Kernel, Parameter,
    ParameterKind, Port, PortType, Slot, Spec, Step, UnitRule, choose, operands,
};
use crate::types::{NULL_BOOL, NULL_INT, Type};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "ToBits",
        summary: "The lowest bits of an integer, and whether they represent it completely.",
        formula: "two's complement: out[i] = floor(in / 2^i) mod 2",
        inputs: &[Port::int("in", "integer")],
        outputs: &[
            Port::new(
                "out",
                PortType::Array(ElementType::Are(Type::Bool), Dim::Var(0)),
                UnitRule::Typed,
                "bits, lowest first",
            ),
            Port::bool("overflow", "the integer does not fit into `bits` bits").diagnostic(),
        ],
        parameters: &[
            Parameter::new("bits", ParameterKind::Length(0), "number of bits, 1 to 63")
                .at_least(1.0)
                .at_most(63.0),
            Parameter::new(
                "signed",
                ParameterKind::Value(PortType::Is(Type::Bool), UnitRule::Typed),
                "signed range -2^(bits-1) to 2^(bits-1)-1, otherwise 0 to 2^bits-1",
            )
            .default(DefaultValue::Bool(false)),
        ],
        examples: &[
            Example::new(
                "unsigned",
                "{bits: 3}",
                "in | out | overflow
                 6 | [false, true, true] | false
                 8 | [false, false, false] | true
                 -1 | [true, true, true] | true
                 null | null | null",
            ),
            Example::new(
                "signed",
                "{bits: 3, signed: true}",
                "in | out | overflow
                 -4 | [false, false, true] | false
                 4 | [false, false, true] | true",
            ),
        ],
        ..Spec::PLAIN
    },
    &[Kernel::each::<ToBits>()],
);

operands! {
    struct ToBits { input: Slot<Int>, out: Slot<Bool>, overflow: Slot<Bool>, signed: Slot<Bool>, length: u32 }
}

impl Step for ToBits {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let ToBits { length, .. } = self;
        let value = frame.get(self.input)?;
        let signed = u32::from(frame.get(self.signed)? & 1);
        let null = value == NULL_INT;
        for i in 0..length {
            let bit = (value >> i.min(63)) & 1;
            frame.put(self.out + i, choose(null, NULL_BOOL, bit as u8))?;
        }
        // The bits above must be all 0 or, if signed, all equal to the highest bit.
        let above = value >> length.saturating_sub(signed).min(63);
        let fits = (above == 0) | ((signed == 1) & (above == -1));
        frame.put(self.overflow, choose(null, NULL_BOOL, u8::from(!fits)))
    }
}
