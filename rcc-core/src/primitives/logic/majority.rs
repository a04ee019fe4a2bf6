//! `Majority`: two-out-of-three voting: the value on which at least two of three conditions agree, even if the third is
//! unknown.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, Example, Kernel, NullRule, Port, Slot, Spec, Step, choose, operands,
};
use crate::types::NULL_BOOL;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Majority",
        summary: "The value on which at least two of three conditions agree.",
        null: "null unless two known inputs agree: one may be null",
        // Any two known inputs are sufficient; requiring the first one is a safe approximation.
        null_rule: NullRule::FirstAndAnyKnown,
        formula: "2oo3 voting (IEC 61508-6, B.3.2.2.5)",
        examples: &[Example::new(
            "two of three decide",
            "",
            "a | b | c | out
             true | true | false | true
             false | true | false | false
             true | null | true | true
             null | false | false | false
             true | null | false | null
             null | null | true | null",
        )],
        inputs: &[
            Port::bool("a", "first condition"),
            Port::bool("b", "second condition"),
            Port::bool("c", "third condition"),
        ],
        outputs: &[Port::bool("out", "value of the majority")],
        ..Spec::PLAIN
    },
    &[Kernel::each::<Majority>()],
);

operands! {
    struct Majority { a: Slot<Bool>, b: Slot<Bool>, c: Slot<Bool>, out: Slot<Bool> }
}

impl Step for Majority {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let (a, b, c) = (frame.get(self.a)?, frame.get(self.b)?, frame.get(self.c)?);
        let votes = |value: u8| u8::from(a == value) + u8::from(b == value) + u8::from(c == value);
        let result = choose(votes(1) >= 2, 1, choose(votes(0) >= 2, 0, NULL_BOOL));
        frame.put(self.out, result)
    }
}
