//! `FromBits`: a whole number from truth values, the lowest bit first.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, DefaultValue, Dim, ElementType, Example, Kernel, Parameter, ParameterKind,
    Port, PortType, Spec, UnitRule, choose, each,
};
use crate::types::{NULL_BOOL, NULL_INT, Type};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "FromBits",
        summary: "The whole number that truth values are the bits of.",
        null: "a null element gives null",
        undefined: "more than 63 bits that the number needs",
        formula: "the sum of 2^i over all i with in[i]; with a sign the highest bit counts negative (two's complement)",
        inputs: &[Port::new(
            "in",
            PortType::Array(ElementType::Are(Type::Bool), Dim::Var(0)),
            UnitRule::Typed,
            "its bits, the lowest first",
        )],
        outputs: &[Port::int("out", "the number")],
        parameters: &[Parameter::new(
            "signed",
            ParameterKind::Value(PortType::Is(Type::Bool), UnitRule::Typed),
            "the highest bit is the sign",
        )
        .default(DefaultValue::Bool(false))],
        examples: &[
            Example::new(
                "without a sign",
                "",
                "in | out
                 [false, true, true] | 6
                 [null, true, true] | null",
            ),
            Example::new(
                "with a sign",
                "{signed: true}",
                "in | out\n [false, true, true] | -2",
            ),
        ],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
);

#[inline(always)]
fn step(frame: &mut Frame<'_>, [input, out, signed, length]: [u32; 4]) -> Option<()> {
    let signed = frame.get_bool(signed)? & 1 == 1;
    let last = length.saturating_sub(1);
    let negative = signed && frame.get_bool(input + last)? & 1 == 1;
    let (mut number, mut null) = (0i64, false);
    for i in 0..length {
        let bit = frame.get_bool(input + i)?;
        null |= bit & NULL_BOOL != 0;
        // Above bit 62 only the sign may go on.
        let differs = (bit & 1 == 1) != negative;
        null |= i > 62 && differs;
        number |= choose(i > 62, 0, i64::from(bit & 1) << i.min(62));
    }
    let sign = choose(negative, -1i64 << last.min(63), 0);
    let number = number | sign;
    frame.put_int(out, choose(null, NULL_INT, number))
}
