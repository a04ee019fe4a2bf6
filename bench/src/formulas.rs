//! A net of 500 formulas and the same net of the primitives that they stand for. Any thread.

pub use rcc_testing::formulas::FORMULAS;
use rcc_testing::formulas::chain;

/// Returns the text of the net, of formulas or of their primitives.
#[must_use]
pub fn net_of(formulas: bool) -> String {
    let chain = chain(formulas);
    format!(
        "net: formulas\nprimitives:\n{chain}  over: {{type: Greater, inputs: {{a: f0.out, b: 9 s}}}}\n  \
         end: {{type: Termination, inputs: {{done: over.out}}}}\n"
    )
}
