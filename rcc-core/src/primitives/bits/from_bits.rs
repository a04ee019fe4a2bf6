//! `FromBits`: an integer from an array of Bools, lowest bit first.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, DefaultValue, Dim, ElementType, Example, Int, Kernel, Parameter,
    ParameterKind, Port, PortType, Slot, Spec, Step, UnitRule, choose, operands,
};
use crate::types::{NULL_BOOL, NULL_INT, Type};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "FromBits",
        summary: "The integer whose bits are the elements of a Bool array.",
        null: "a null element gives null",
        undefined: "more than 63 significant bits",
        formula: "the sum of 2^i over all i with in[i]; if signed, the highest bit counts negative (two's complement)",
        inputs: &[Port::new(
            "in",
            PortType::Array(ElementType::Are(Type::Bool), Dim::Var(0)),
            UnitRule::Typed,
            "bits, lowest first",
        )],
        outputs: &[Port::int("out", "integer")],
        parameters: &[Parameter::new(
            "signed",
            ParameterKind::Value(PortType::Is(Type::Bool), UnitRule::Typed),
            "the highest bit is the sign bit",
        )
        .default(DefaultValue::Bool(false))],
        examples: &[
            Example::new(
                "unsigned",
                "",
                "in | out
                 [false, true, true] | 6
                 [null, true, true] | null",
            ),
            Example::new(
                "signed",
                "{signed: true}",
                "in | out\n [false, true, true] | -2",
            ),
        ],
        ..Spec::PLAIN
    },
    &[Kernel::each::<FromBits>()],
);

operands! {
    struct FromBits { input: Slot<Bool>, out: Slot<Int>, signed: Slot<Bool>, length: u32 }
}

impl Step for FromBits {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let FromBits { length, .. } = self;
        let signed = frame.get(self.signed)? & 1 == 1;
        let last = length.saturating_sub(1);
        let negative = signed && frame.get(self.input + last)? & 1 == 1;
        let (mut number, mut null) = (0i64, false);
        for i in 0..length {
            let bit = frame.get(self.input + i)?;
            null |= bit & NULL_BOOL != 0;
            // Above bit 62 only the sign extension is allowed.
            let differs = (bit & 1 == 1) != negative;
            null |= i > 62 && differs;
            number |= choose(i > 62, 0, i64::from(bit & 1) << i.min(62));
        }
        let sign = choose(negative, -1i64 << last.min(63), 0);
        let number = number | sign;
        frame.put(self.out, choose(null, NULL_INT, number))
    }
}
