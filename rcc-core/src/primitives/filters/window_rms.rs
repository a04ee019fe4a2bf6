//! `WindowRms`: the root mean square over a sliding window.

use crate::primitive::{
    CatalogueEntry, DefaultValue, Example, Fold, Kernel, MemorySpec, Spec, WINDOW, each_window,
    finite,
};
use crate::types::Store;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "WindowRms",
        summary: "The root mean square over a sliding window.",
        undefined: "overflow: a sum of squares out of range",
        formula: "sqrt((in(t)² + … + in(t-(n-1)·dt)²) / n), summed as a tree: Tangwongsan et al., General incremental sliding-window aggregation, PVLDB 8 (2015)",
        memory: MemorySpec::window(2).starting(DefaultValue::Real(0.0)),
        examples: &[
            Example::new(
                "a window of three cycles",
                "{window: 3 ms}",
                "in | out
                 3.0 | 3.0
                 -3.0 | 3.0
                 3.0 | 3.0
                 null | null",
            ),
            Example::new(
                "an array and a window of one cycle",
                "{window: 1 ms}",
                "in | out\n [1.0, 4.0] | [1.0, 4.0]\n [0.0, 8.0] | [0.0, 8.0]",
            ),
        ],
        ..WINDOW
    },
    &[Kernel::of(Store::Real, each_window::<RmsFold>)],
);

struct RmsFold;

impl Fold for RmsFold {
    #[inline(always)]
    fn leaf(value: f64) -> f64 {
        value * value
    }

    #[inline(always)]
    fn combine(a: f64, b: f64) -> f64 {
        a + b
    }

    #[inline(always)]
    fn result(root: f64, count: f64) -> f64 {
        finite(libm::sqrt(root / count))
    }
}
