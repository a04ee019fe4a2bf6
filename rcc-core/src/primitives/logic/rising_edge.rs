//! `RisingEdge`: true in the cycle in which its input changes from false to true.
//!
//! There is no edge in the first cycle, unless `initial` gives the value before it. A null input gives null and is
//! skipped: an edge is a change from the last known value.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, DefaultValue, Example, Kernel, Parameter, ParameterKind, Port, Slot,
    Spec, StateSpec, Step, UnitRule, choose, operands,
};
use crate::types::{NULL_BOOL, Type};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "RisingEdge",
        summary: "True for one cycle when its input becomes true.",
        null: "a null input gives null; the last known value is kept",
        formula: "R_TRIG of IEC 61131-3, table 44, but null instead of false before the first cycle",
        examples: &[
            Example::new(
                "only a change counts, also across null",
                "",
                "in | out
                 true | false
                 false | false
                 true | true
                 true | false
                 false | false
                 null | null
                 true | true",
            ),
            Example::new(
                "initially false",
                "{initial: false}",
                "in | out
                 true | true
                 true | false",
            ),
        ],
        inputs: &[Port::bool("in", "signal to watch")],
        outputs: &[Port::bool("out", "true in the cycle of the change")],
        parameters: &[Parameter::new(
            "initial",
            ParameterKind::Start(Type::Bool, UnitRule::Typed),
            "value before the first cycle; null: no edge at the first known value",
        )
        .default(DefaultValue::Null)],
        state: StateSpec {
            bools: 1,
            ..StateSpec::NONE
        },
        ..Spec::PLAIN
    },
    &[Kernel::each::<RisingEdge>()],
);

operands! {
    struct RisingEdge { input: Slot<Bool>, out: Slot<Bool>, last: Slot<Bool> }
}

impl Step for RisingEdge {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let (now, before) = (frame.get(self.input)?, frame.get(self.last)?);
        let null = now & NULL_BOOL != 0;
        let edge = u8::from((now == 1) & (before == 0));
        frame.put(self.out, choose(null, NULL_BOOL, edge))?;
        frame.put(self.last, choose(null, before, now))
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::PrimitiveHarness;

    #[test]
    fn only_the_change_counts() {
        let mut bench = PrimitiveHarness::new("RisingEdge");
        let (no, yes) = (Some(false), Some(true));
        for (input, out) in [
            (yes, no),
            (no, no),
            (yes, yes),
            (yes, no),
            (None, None),
            (yes, no),
            (no, no),
            (None, None),
            (yes, yes),
        ] {
            assert_eq!(bench.set_bool("in", input).step().bool("out"), out);
        }
    }
    #[test]
    fn the_initial_value_counts_as_the_value_before_the_first_cycle() {
        let mut bench = PrimitiveHarness::new("RisingEdge");
        bench.start_bool(false).set_bool("in", Some(true));
        assert_eq!(bench.step().bool("out"), Some(true));
        assert_eq!(bench.step().bool("out"), Some(false));
    }
}
