//! `WindowMean`: the mean over a sliding window.

use crate::primitive::{
    CatalogueEntry, DefaultValue, Example, Fold, Kernel, MemorySpec, Spec, WINDOW, each_window,
    finite,
};
use crate::types::Store;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "WindowMean",
        summary: "The mean over a sliding window.",
        undefined: "overflow: a sum out of range",
        formula: "(in(t) + … + in(t-(n-1)·dt)) / n, summed as a tree, which does not drift: Tangwongsan et al., General incremental sliding-window aggregation, PVLDB 8 (2015)",
        memory: MemorySpec::window(2).starting(DefaultValue::Real(0.0)),
        examples: &[
            Example::new(
                "a window of three cycles",
                "{window: 3 ms}",
                "in | out
                 3.0 | 3.0
                 6.0 | 4.5
                 0.0 | 3.0
                 null | null
                 3.0 | null
                 9.0 | null
                 6.0 | 6.0",
            ),
            Example::new(
                "an array and a window of two cycles",
                "{window: 2 ms}",
                "in | out\n [1.0, 4.0] | [1.0, 4.0]\n [0.0, null] | [0.5, null]\n [2.0, 6.0] | [1.0, null]\n [2.0, 8.0] | [2.0, 7.0]",
            ),
        ],
        ..WINDOW
    },
    &[Kernel::of(Store::Real, each_window::<MeanFold>)],
);

struct MeanFold;

impl Fold for MeanFold {
    #[inline(always)]
    fn leaf(value: f64) -> f64 {
        value
    }

    #[inline(always)]
    fn combine(a: f64, b: f64) -> f64 {
        a + b
    }

    #[inline(always)]
    fn result(root: f64, count: f64) -> f64 {
        finite(root / count)
    }
}
