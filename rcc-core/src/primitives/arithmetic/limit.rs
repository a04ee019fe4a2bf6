//! `Limit`: limits a number to a range.
//!
//! A lower bound above the upper one gives null.

use crate::frame::Frame;
use crate::primitive::{
    ByElement, CatalogueEntry, Element, Example, Int, Kernel, Port, Real, Slot, Spec, Step,
    UnitRule, choose, operands, real_unless,
};
use crate::types::NULL_INT;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Limit",
        summary: "Limits a number, or each element of a vector, array or matrix, to a range.",
        null: "a null input gives null, and so does `low` above `high`",
        undefined: "low > high",
        examples: &[Example::new(
            "inside, below and above the range",
            "",
            "in | low | high | out
             0.5 | -1.0 | 2.0 | 0.5
             -3.0 | -1.0 | 2.0 | -1
             7.5 | -1.0 | 2.0 | 2
             0.5 | 2.0 | -1.0 | null
             null | -1.0 | 2.0 | null",
        )],
        inputs: &[
            Port::linear("in", UnitRule::Var(0), "number to limit"),
            Port::linear("low", UnitRule::Var(0), "lower bound"),
            Port::linear("high", UnitRule::Var(0), "upper bound"),
        ],
        outputs: &[Port::linear(
            "out",
            UnitRule::Var(0),
            "the number, `low` or `high`",
        )],
        ..Spec::PLAIN
    },
    &[
        Kernel::scalar::<Limit<Real>>(),
        Kernel::by_element::<Limit<Real>>(),
        Kernel::scalar::<Limit<Int>>(),
        Kernel::by_element::<Limit<Int>>(),
    ],
);

operands! {
    struct Limit<E> { input: Slot<E>, low: Slot<E>, high: Slot<E>, out: Slot<E> }
}

impl Step for Limit<Real> {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let value = frame.get(self.input)?;
        let (low, high) = (frame.get(self.low)?, frame.get(self.high)?);
        // A NaN is neither less nor greater and passes through; a NaN bound fails the order check.
        let raised = if value < low { low } else { value };
        let limited = if raised > high { high } else { raised };
        let in_order = low <= high;
        frame.put(self.out, real_unless(!in_order, limited))
    }
}

impl Step for Limit<Int> {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let value = frame.get(self.input)?;
        let (low, high) = (frame.get(self.low)?, frame.get(self.high)?);
        let limited = value.max(low).min(high);
        let null = (value == NULL_INT) | (low == NULL_INT) | (low > high);
        frame.put(self.out, choose(null, NULL_INT, limited))
    }
}

impl<E: Element> ByElement for Limit<E>
where
    Limit<E>: Step,
{
    #[inline(always)]
    fn element(self, i: u32) -> Self {
        Limit {
            input: self.input + i,
            low: self.low + i,
            high: self.high + i,
            out: self.out + i,
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::PrimitiveHarness;
    use crate::types::{NULL_INT, Store};

    #[test]
    fn stays_between_the_bounds() {
        let mut bench = PrimitiveHarness::wide("Limit", Some(Store::Real), 1);
        bench.set_real("low", -1.0).set_real("high", 2.0);
        for (input, out) in [(0.5, 0.5), (-3.0, -1.0), (f64::MAX, 2.0), (2.0, 2.0)] {
            assert_eq!(bench.set_real("in", input).step().real("out"), out);
        }
        let mut bench = PrimitiveHarness::wide("Limit", Some(Store::Int), 1);
        bench.set_int("low", -1).set_int("high", 2);
        for (input, out) in [(1, 1), (-3, -1), (i64::MAX, 2)] {
            assert_eq!(bench.set_int("in", input).step().int("out"), out);
        }
    }

    #[test]
    fn null_and_bounds_out_of_order_give_null() {
        let nan = f64::NAN;
        for (input, low, high) in [
            (nan, 0.0, 1.0),
            (0.5, nan, 1.0),
            (0.5, 0.0, nan),
            (0.5, 1.0, 0.0),
        ] {
            let mut bench = PrimitiveHarness::wide("Limit", Some(Store::Real), 1);
            bench
                .set_real("in", input)
                .set_real("low", low)
                .set_real("high", high);
            assert!(bench.step().real("out").is_nan(), "{input} {low} {high}");
        }
        for (input, low, high) in [
            (NULL_INT, 0, 1),
            (1, NULL_INT, 2),
            (1, 0, NULL_INT),
            (1, 2, 1),
        ] {
            let mut bench = PrimitiveHarness::wide("Limit", Some(Store::Int), 1);
            bench
                .set_int("in", input)
                .set_int("low", low)
                .set_int("high", high);
            assert_eq!(bench.step().int("out"), NULL_INT, "{input} {low} {high}");
        }
    }
}
