//! `WindowMax`: the maximum over a sliding window.

use crate::primitive::{
    CatalogueEntry, DefaultValue, Example, Fold, Kernel, MemorySpec, Spec, WINDOW, each_window,
};
use crate::types::Store;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "WindowMax",
        summary: "The maximum over a sliding window.",
        formula: "Tangwongsan et al., General incremental sliding-window aggregation, PVLDB 8 (2015): a tree, with one node per doubling of the window in each cycle",
        memory: MemorySpec::window(2).starting(DefaultValue::Real(f64::MIN)),
        examples: &[
            Example::new(
                "a window of three cycles",
                "{window: 3 ms}",
                "in | out
                 2.0 | 2.0
                 5.0 | 5.0
                 3.0 | 5.0
                 4.0 | 5.0
                 1.0 | 4.0
                 null | null
                 7.0 | null
                 8.0 | null
                 6.0 | 8.0",
            ),
            Example::new(
                "an array and a window of one cycle",
                "{window: 1 ms}",
                "in | out\n [1.0, 4.0] | [1.0, 4.0]\n [0.0, 8.0] | [0.0, 8.0]",
            ),
        ],
        ..WINDOW
    },
    &[Kernel::of(Store::Real, each_window::<MaxFold>)],
);

struct MaxFold;

impl Fold for MaxFold {
    #[inline(always)]
    fn leaf(value: f64) -> f64 {
        value
    }

    #[inline(always)]
    fn combine(a: f64, b: f64) -> f64 {
        if a.is_nan() | (a > b) { a } else { b }
    }

    #[inline(always)]
    fn result(root: f64, _: f64) -> f64 {
        root
    }
}
