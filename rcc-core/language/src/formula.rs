//! The formula pass, [`Net`] → [`Net`]: every expression becomes primitives of the catalogue, in the text's net and in all
//! fragments. All later passes, and everything that shows, watches, replays or exports a net, know primitives only. Runs
//! on the loader's threads.
//!
//! | module | does |
//! |---|---|
//! | `lexer`, `parser` | text → terms with their places |
//! | `functions` | operators and functions → primitives |
//! | `fold` | operations on constants → constants |
//! | `terms`, `values` | terms → operations, each common part once |
//! | `body`, `emit` | operations → primitives of the net or fragment |
//! | `products` | after the expansion of fragments: `*` → `Multiply` or `Scale` |
//! | `places` | places in the text of the net, words for generated ports |

mod body;
mod emit;
mod error;
mod fold;
mod functions;
mod lexer;
mod parser;
mod places;
mod products;
mod terms;
mod values;

use rcc_config::diagnostic::Diagnostic;
use rcc_config::yaml::Key;

use crate::leg_conditions;
use crate::source_map::SourceMap;
use crate::syntax::fragment::Fragment;
use crate::syntax::{Net, Primitive, PrimitiveKind, Source};
use body::BodyLowering;

pub use functions::{INFIX, SHORT_NAMES, functions, snake_case};
pub use places::PortWords;
pub use products::choose_products;

/// Type of a primitive that is an expression: `{type: Formula, parameters: {expr: "2 * x"}, inputs: {x: a.out}}`.
pub const FORMULA: &str = "Formula";
/// Its parameter.
pub const EXPRESSION: &str = "expr";
/// Longest text of an expression, bytes.
pub const LENGTH_MAX: usize = 4096;
/// Deepest nesting of parentheses, signs, arguments and branches.
pub const DEPTH_MAX: usize = 64;

/// Most elements of lists that the terms of all expressions of a net have together. A list is copied wherever it is
/// named: without a limit, one expression that names a list of 1024 elements 2000 times had two million links.
pub const LIST_ELEMENTS_MAX: usize = 1 << 20;

/// The list elements in the terms of all expressions of a net so far.
#[derive(Clone, Copy, Debug, Default)]
struct ListCount {
    elements: usize,
    /// The limit is exceeded, and this is reported.
    is_reported: bool,
}

/// Returns true for the parameter of a `Formula`.
pub(crate) fn is_expression(primitive: &Primitive, parameter: &Key) -> bool {
    is_formula(primitive) && parameter.name == EXPRESSION
}

/// Returns true for an entry `type: Formula`.
pub(crate) fn is_formula(primitive: &Primitive) -> bool {
    primitive.kind == PrimitiveKind::Type && primitive.type_name.name == FORMULA
}

/// Replaces all expressions of a net and of the fragments of its libraries by primitives, and returns the words for the
/// ports of these. A net without expressions stays as it is.
pub fn lower(
    net: &mut Net,
    library: &mut [Fragment],
    sources: &SourceMap,
    diagnostics: &mut Vec<Diagnostic>,
) -> PortWords {
    let mut words = PortWords::default();
    let mut lists = ListCount::default();
    let no_inputs = Vec::new();
    let own = (&mut net.primitives, &net.discard, no_inputs);
    let fragments = net.fragments.iter_mut().chain(library);
    let fragments = fragments.map(|fragment| {
        let inputs = fragment.inputs.iter();
        let inputs = inputs.map(|input| input.name.name.to_string()).collect();
        (&mut fragment.primitives, &fragment.discard, inputs)
    });
    for (primitives, discard, inputs) in std::iter::once(own).chain(fragments) {
        if primitives.iter().any(has_formula) {
            let body = BodyLowering::new(inputs, discard, sources, diagnostics);
            body.run(primitives, &mut words, &mut lists);
        }
    }
    words
}

/// Replaces all expressions of a net without libraries, and decides about its products. For programs that export a net.
pub fn lower_alone(net: &mut Net, text: &str, file: &str, diagnostics: &mut Vec<Diagnostic>) {
    leg_conditions::connect(net, &mut [], diagnostics);
    lower(net, &mut [], &SourceMap::new(file, text), diagnostics);
    choose_products(&mut net.primitives);
}

fn has_formula(primitive: &Primitive) -> bool {
    let inputs = primitive.inputs.iter().map(|(_, source)| source);
    is_formula(primitive) || inputs.chain(&primitive.active).any(contains_formula)
}

fn contains_formula(source: &Source) -> bool {
    match source {
        Source::Formula(_) => true,
        Source::List(list) => list.elements.iter().any(contains_formula),
        Source::Outcomes(outcomes) => outcomes.sources().any(contains_formula),
        Source::Link(_) | Source::Literal(_) | Source::Refused => false,
    }
}
