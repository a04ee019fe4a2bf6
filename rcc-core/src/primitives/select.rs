//! `Select`: selects one of two values of any type, by a condition.
//!
//! Null depends only on the condition and the selected value.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, NullRule, Port, PortType, Spec, UnitRule, choose, each,
    real_unless,
};
use crate::types::{NULL_BOOL, NULL_INT, NULL_REAL, Store};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Select",
        summary: "Selects one of two values, by a condition.",
        null: "a null condition gives null; among the values, only the selected one matters",
        null_rule: NullRule::FirstAndAnyKnown,
        examples: &[
            Example::new(
                "only the condition and the selected value matter",
                "",
                "condition | yes | no | out
                 true | 1.5 | 2.5 | 1.5
                 false | 1.5 | 2.5 | 2.5
                 true | 1.5 | null | 1.5
                 false | 1.5 | null | null
                 null | 1.5 | 2.5 | null",
            ),
            Example::new(
                "vectors of integers",
                "",
                "condition | yes | no | out
                 true | [1, 2] | [3, 4] | [1, 2]
                 false | [1, 2] | [3, 4] | [3, 4]",
            ),
        ],
        inputs: &[
            Port::bool("condition", "condition"),
            Port::new(
                "yes",
                PortType::Any,
                UnitRule::Var(0),
                "value while the condition is true",
            ),
            Port::new(
                "no",
                PortType::Any,
                UnitRule::Var(0),
                "value while the condition is false",
            ),
        ],
        outputs: &[Port::new(
            "out",
            PortType::Any,
            UnitRule::Var(0),
            "selected value",
        )],
        ..Spec::PLAIN
    },
    &[
        Kernel::single(Store::Real, |frame, operands| {
            each(frame, operands, step_real);
        }),
        Kernel::of(Store::Real, |frame, operands| {
            each(frame, operands, wide_real);
        }),
        Kernel::single(Store::Bool, |frame, operands| {
            each(frame, operands, step_bool);
        }),
        Kernel::of(Store::Bool, |frame, operands| {
            each(frame, operands, wide_bool);
        }),
        Kernel::single(Store::Int, |frame, operands| {
            each(frame, operands, step_int);
        }),
        Kernel::of(Store::Int, |frame, operands| {
            each(frame, operands, wide_int);
        }),
    ],
);

#[inline(always)]
fn step_real(frame: &mut Frame<'_>, [condition, yes, no, out]: [u32; 4]) -> Option<()> {
    let condition = frame.get_bool(condition)?;
    let value = frame.get_real(choose(condition == 1, yes, no))?;
    frame.put_real(out, real_unless(condition & NULL_BOOL != 0, value))
}

#[inline(always)]
fn step_bool(frame: &mut Frame<'_>, [condition, yes, no, out]: [u32; 4]) -> Option<()> {
    let condition = frame.get_bool(condition)?;
    let value = frame.get_bool(choose(condition == 1, yes, no))?;
    frame.put_bool(out, choose(condition & NULL_BOOL != 0, NULL_BOOL, value))
}

#[inline(always)]
fn step_int(frame: &mut Frame<'_>, [condition, yes, no, out]: [u32; 4]) -> Option<()> {
    let condition = frame.get_bool(condition)?;
    let value = frame.get_int(choose(condition == 1, yes, no))?;
    frame.put_int(out, choose(condition & NULL_BOOL != 0, NULL_INT, value))
}

#[inline]
fn wide_real(frame: &mut Frame<'_>, [condition, yes, no, out, width]: [u32; 5]) {
    let condition = frame.bool(condition);
    let source = if condition == 1 { yes } else { no };
    for i in 0..width {
        let value = frame.real(source + i);
        frame.set_real(
            out + i,
            if condition & NULL_BOOL != 0 {
                NULL_REAL
            } else {
                value
            },
        );
    }
}

#[inline]
fn wide_bool(frame: &mut Frame<'_>, [condition, yes, no, out, width]: [u32; 5]) {
    let condition = frame.bool(condition);
    let source = if condition == 1 { yes } else { no };
    for i in 0..width {
        let value = frame.bool(source + i);
        frame.set_bool(
            out + i,
            if condition & NULL_BOOL != 0 {
                NULL_BOOL
            } else {
                value
            },
        );
    }
}

#[inline]
fn wide_int(frame: &mut Frame<'_>, [condition, yes, no, out, width]: [u32; 5]) {
    let condition = frame.bool(condition);
    let source = if condition == 1 { yes } else { no };
    for i in 0..width {
        let value = frame.int(source + i);
        frame.set_int(
            out + i,
            if condition & NULL_BOOL != 0 {
                NULL_INT
            } else {
                value
            },
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::PrimitiveHarness;

    #[test]
    fn only_the_selected_value_matters() {
        let mut bench = PrimitiveHarness::wide("Select", Some(Store::Real), 3);
        bench.set_reals("yes", &[1.0, 2.0, 3.0]);
        assert_eq!(
            bench
                .set_bool("condition", Some(true))
                .step()
                .reals("out", 3),
            [1.0, 2.0, 3.0]
        );
        assert!(
            bench
                .set_bool("condition", Some(false))
                .step()
                .reals("out", 3)
                .iter()
                .all(|v| v.is_nan())
        );
        assert!(
            bench
                .set_bool("condition", None)
                .step()
                .reals("out", 3)
                .iter()
                .all(|v| v.is_nan())
        );
    }

    #[test]
    fn arrays_are_selected_as_a_whole() {
        let mut bench = PrimitiveHarness::wide("Select", Some(Store::Bool), 2);
        bench
            .set_bool("condition", Some(false))
            .set_bool("no", Some(true));
        assert_eq!(bench.step().bool("out"), Some(true));
        let mut bench = PrimitiveHarness::wide("Select", Some(Store::Int), 2);
        bench.set_bool("condition", Some(true)).set_int("yes", 7);
        assert_eq!(bench.step().int("out"), 7);
    }

    #[test]
    fn works_for_single_values() {
        let mut bench = PrimitiveHarness::wide("Select", Some(Store::Real), 1);
        bench.set_real("yes", 1.0).set_bool("condition", Some(true));
        assert_eq!(bench.step().real("out"), 1.0);
        for condition in [Some(false), None] {
            let out = bench.set_bool("condition", condition).step().real("out");
            assert!(out.is_nan(), "{condition:?}");
        }

        let mut bench = PrimitiveHarness::wide("Select", Some(Store::Bool), 1);
        bench
            .set_bool("yes", Some(true))
            .set_bool("no", Some(false))
            .set_bool("condition", Some(true));
        assert_eq!(bench.step().bool("out"), Some(true));
        let mut bench = PrimitiveHarness::wide("Select", Some(Store::Int), 1);
        bench
            .set_int("yes", 7)
            .set_int("no", 8)
            .set_bool("condition", Some(false));
        assert_eq!(bench.step().int("out"), 8);
        assert_eq!(
            bench.set_bool("condition", None).step().int("out"),
            NULL_INT
        );
    }
}
