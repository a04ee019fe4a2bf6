//! `AnyOf`: whether a truth value of an array is true: Or for any number of them.

use crate::frame::Frame;
use crate::primitive::{
    Dim, Elements, Entry, Example, Kernel, Port, PortType, Spec, UnitRule, choose, each,
};
use crate::types::{NULL_BOOL, Type};

/// The row of the catalogue.
pub const ENTRY: Entry = Entry::new(
    Spec {
        name: "AnyOf",
        summary: "True while an element of an array is true.",
        null: "a null element gives null",
        inputs: &[Port::new(
            "in",
            PortType::Array(Elements::Are(Type::Bool), Dim::Var(0)),
            UnitRule::Typed,
            "truth values",
        )],
        outputs: &[Port::bool("out", "one is true")],
        examples: &[Example::new(
            "three truth values",
            "",
            "in | out
             [false, false, false] | false
             [true, false, true] | true
             [true, null, false] | null",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
);

#[inline(always)]
fn step(frame: &mut Frame<'_>, [input, out, length]: [u32; 3]) -> Option<()> {
    let (mut result, mut null) = (0u8, 0);
    for i in 0..length {
        let value = frame.get_bool(input + i)?;
        null |= value & NULL_BOOL;
        result |= value & 1;
    }
    frame.put_bool(out, choose(null != 0, NULL_BOOL, result))
}
