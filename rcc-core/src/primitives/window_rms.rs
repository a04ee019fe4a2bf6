//! `WindowRms`: the root of the mean square of the last values.

use crate::primitive::{
    Entry, Example, Fold, Kernel, Literal, Memory, Parameter, ParameterKind, Port, Spec, State,
    UnitRule, each_window,
};
use crate::types::Store;

/// The row of the catalogue.
pub const ENTRY: Entry = Entry::new(
    Spec {
        name: "WindowRms",
        summary: "The root mean square of the values of a window that ends now.",
        null: "null while a null value is in the window, element by element; before the window is full it is over what there was",
        formula: "sqrt((in(t)² + … + in(t-(n-1)·dt)²) / n), summed as a tree: Tangwongsan et al., General incremental sliding-window aggregation, PVLDB 8 (2015): a tree, one node a doubling of the window and cycle",
        inputs: &[Port::linear(
            "in",
            UnitRule::Var(0),
            "a number, vector, array or matrix",
        )],
        outputs: &[Port::linear(
            "out",
            UnitRule::Var(0),
            "the result, of each element",
        )],
        parameters: &[Parameter::new(
            "window",
            ParameterKind::Window,
            "how long the window is, with the value of now; 1 to 10 000 cycles of the net",
        )
        .above(0.0)],
        state: State {
            ints: 2,
            ..State::NONE
        },
        memory: Memory::window(2).starting(Literal::Real(0.0)),
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
        ..Spec::PLAIN
    },
    &[Kernel::of(Store::Real, each_window::<Window>)],
);

struct Window;

impl Fold for Window {
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
        libm::sqrt(root / count)
    }
}
