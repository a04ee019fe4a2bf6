//! `Cancel`: reports that CANCEL was requested. A net without it can only be aborted (Vistein et al. 2010, section
//! IV-C).

use crate::frame::Frame;
use crate::primitive::{CatalogueEntry, Example, Kernel, Port, Role, Spec, each};

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
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
);

#[inline(always)]
fn step(frame: &mut Frame<'_>, [requested]: [u32; 1]) {
    let value = u8::from(frame.cancel_requested);
    frame.set_bool(requested, value);
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
