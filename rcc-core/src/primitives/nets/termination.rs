//! `Termination`: ends the command in the cycle in which its condition, or one of its named outcomes, is true. Every net
//! has exactly one (Vistein et al. 2010, section IV-C).
//!
//! A group of operands is one condition; the groups of a plan are the outcomes in the order of the text, so the first
//! one that is true in a cycle is the outcome.

use crate::frame::Frame;
use crate::primitive::{Bool, CatalogueEntry, Kernel, Port, Role, Slot, Spec, Step, operands};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Termination",
        summary: "Ends the command when its input, or one of its named outcomes, becomes true.",
        null: "a null input does not end the command",
        inputs: &[Port::bool(
            "done",
            "true: the command ends; or outcomes by their names: `{arrived: move.done, touched: touch.out}`",
        )],
        role: Role::Termination,
        ..Spec::PLAIN
    },
    &[Kernel::each::<Termination>()],
);

operands! {
    struct Termination { done: Slot<Bool> }
}

impl Step for Termination {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        frame.terminated |= frame.get(self.done)? == 1;
        frame.outcome += u32::from(!frame.terminated);
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::PrimitiveHarness;

    #[test]
    fn only_true_ends_the_command() {
        let mut bench = PrimitiveHarness::new("Termination");
        for (done, over) in [(Some(false), false), (None, false), (Some(true), true)] {
            assert_eq!(bench.set_bool("done", done).step().terminated, over);
            assert_eq!(
                bench.outcome,
                u32::from(!over),
                "one condition was not true"
            );
        }
    }
}
