//! `Less`: out = a < b, for two numbers of the same unit; null if either is null.

use crate::frame::Frame;
use crate::primitive::{Entry, Kernel, Port, Spec, UnitRule, each};
use crate::types::NULL_BOOL;

/// The row of the catalogue.
pub const ENTRY: Entry = Entry::new(
    Spec {
        name: "Less",
        summary: "True while the first number is less than the second.",
        inputs: &[
            Port::real("a", UnitRule::Var(0), "first operand"),
            Port::real("b", UnitRule::Var(0), "second operand"),
        ],
        outputs: &[Port::bool("out", "a < b")],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
);

#[inline(always)]
fn step(frame: &mut Frame<'_>, [a, b, out]: [u32; 3]) {
    let (a, b) = (frame.real(a), frame.real(b));
    let result = u8::from(a < b);
    frame.set_bool(
        out,
        if a.is_nan() | b.is_nan() {
            NULL_BOOL
        } else {
            result
        },
    );
}

#[cfg(test)]
mod tests {
    use crate::testing::Bench;

    #[test]
    fn compares_and_propagates_null() {
        let mut bench = Bench::new("Less");
        for (a, b) in [
            (1.0, 2.0),
            (2.0, 1.0),
            (1.0, 1.0),
            (f64::NEG_INFINITY, f64::INFINITY),
        ] {
            assert_eq!(
                bench.set_real("a", a).set_real("b", b).step().bool("out"),
                Some(a < b)
            );
        }
        for (a, b) in [(f64::NAN, 1.0), (1.0, f64::NAN)] {
            assert_eq!(
                bench.set_real("a", a).set_real("b", b).step().bool("out"),
                None
            );
        }
    }
}
