//! `Cancel`: reports that CANCEL was requested. A net without it can only be aborted (Vistein et al. 2010, section
//! IV-C).

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, Example, Kernel, Port, Role, Slot, Spec, Step, operands,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Cancel",
        summary: "True from the cycle after CANCEL was requested.",
        null: "never null",
        examples: &[Example::new(
            "not requested",
            "",
            "requested
                 false",
        )],
        outputs: &[Port::bool("requested", "CANCEL was requested")],
        role: Role::Cancel,
        ..Spec::PLAIN
    },
    &[Kernel::each::<Cancel>()],
);

operands! {
    struct Cancel { requested: Slot<Bool> }
}

impl Step for Cancel {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let value = u8::from(frame.cancel_requested);
        frame.put(self.requested, value)
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::PrimitiveHarness;

    #[test]
    fn reports_the_request() {
        let mut bench = PrimitiveHarness::new("Cancel");
        assert_eq!(bench.step().bool("requested"), Some(false));
        bench.cancel_requested = true;
        assert_eq!(bench.step().bool("requested"), Some(true));
    }
}
