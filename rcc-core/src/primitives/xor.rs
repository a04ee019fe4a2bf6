//! `Xor`: exactly one is true; null if either is null.

use crate::frame::Frame;
use crate::primitive::{Entry, Kernel, Port, Spec, each};
use crate::types::NULL_BOOL;

/// The row of the catalogue.
pub const ENTRY: Entry = Entry::new(
    Spec {
        name: "Xor",
        summary: "True while exactly one of two is true.",
        inputs: &[
            Port::bool("a", "first operand"),
            Port::bool("b", "second operand"),
        ],
        outputs: &[Port::bool("out", "a is not b")],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
);

#[inline(always)]
fn step(frame: &mut Frame<'_>, [a, b, out]: [u32; 3]) {
    let (a, b) = (frame.bool(a), frame.bool(b));
    let null = (a | b) & NULL_BOOL != 0;
    frame.set_bool(out, if null { NULL_BOOL } else { a ^ b });
}

#[cfg(test)]
mod tests {
    use crate::testing::check_truth_table;

    #[test]
    fn truth_table() {
        let (no, yes, null) = (Some(false), Some(true), None);
        check_truth_table(
            "Xor",
            [[no, yes, null], [yes, no, null], [null, null, null]],
        );
    }
}
