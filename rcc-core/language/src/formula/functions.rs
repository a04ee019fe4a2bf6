//! The operators and functions of expressions: each is a primitive of the catalogue without memory and without
//! required parameters. Runs on the loader's threads.

use std::collections::BTreeMap;
use std::sync::OnceLock;

use rcc_core::primitive::{MemorySpec, Role, Spec, StateSpec};
use rcc_core::primitives::{self, CATALOGUE};

/// An operator between two values.
#[derive(Debug)]
pub struct Infix {
    /// As written.
    pub symbol: &'static str,
    /// How strongly it binds; a higher number binds more strongly.
    pub power: u8,
    /// The primitive; empty for `*`, which is `Multiply` or `Scale` depending on the types.
    pub primitive: &'static str,
    /// The result is inverted by `Not`. Of known numbers, `a >= b` is `not (a < b)`, and null stays null.
    pub inverted: bool,
}

/// Binding power of comparisons, which cannot be chained.
pub const COMPARISON: u8 = 4;
/// Binding power of the operand of `not`.
pub const NOT: u8 = 3;
/// Binding power of the operand of the sign `-`.
pub const SIGN: u8 = 7;

/// The operators between two values.
pub const INFIX: &[Infix] = &[
    infix("or", 1, "Or", false),
    infix("and", 2, "And", false),
    infix("==", COMPARISON, "Equals", false),
    infix("!=", COMPARISON, "Equals", true),
    infix("<", COMPARISON, "Less", false),
    infix("<=", COMPARISON, "Greater", true),
    infix(">", COMPARISON, "Greater", false),
    infix(">=", COMPARISON, "Less", true),
    infix("+", 5, "Add", false),
    infix("-", 5, "Subtract", false),
    infix("*", 6, "", false),
    infix("/", 6, "Divide", false),
];

const fn infix(symbol: &'static str, power: u8, primitive: &'static str, inverted: bool) -> Infix {
    Infix {
        symbol,
        power,
        primitive,
        inverted,
    }
}

/// Short names of functions, as in mathematics and most languages, with their primitives.
pub const SHORT_NAMES: &[(&str, &str)] = &[
    ("acos", "ArcCosine"),
    ("asin", "ArcSine"),
    ("atan", "ArcTangent"),
    ("atan2", "ArcTangent"),
    ("ceil", "Ceiling"),
    ("clamp", "Limit"),
    ("cos", "Cosine"),
    ("exp", "Exponential"),
    ("hypot", "Hypotenuse"),
    ("ln", "Logarithm"),
    ("pow", "Power"),
    ("sin", "Sine"),
    ("sqrt", "SquareRoot"),
    ("tan", "Tangent"),
    ("trunc", "Truncate"),
    ("vector", "MakeVector"),
];

/// Functions of two values that also take more: `min(a, b, c)` is `min(min(a, b), c)`.
pub const REPEATED: &[&str] = &["Max", "Min"];

/// Returns the spec of a primitive that the tables above name.
pub fn spec(name: &str) -> &'static Spec {
    let found = primitives::find(name).map(|(_, entry)| &entry.spec);
    // A test looks every name of the tables up.
    found.unwrap_or(&Spec::PLAIN)
}

/// Returns true for a primitive that is a function of its inputs alone; its parameters, if it has any, have defaults.
pub fn is_function(spec: &Spec) -> bool {
    spec.role == Role::Plain
        && spec.state == StateSpec::NONE
        && spec.memory == MemorySpec::NONE
        && spec.parameters.iter().all(|one| one.default.is_some())
        && !spec.inputs.is_empty()
}

/// Returns all functions by name.
pub fn functions() -> &'static BTreeMap<String, &'static Spec> {
    static FUNCTIONS: OnceLock<BTreeMap<String, &'static Spec>> = OnceLock::new();
    FUNCTIONS.get_or_init(|| {
        let specs = CATALOGUE.iter().map(|entry| &entry.spec);
        let functions = specs.filter(|spec| is_function(spec));
        let by_name = functions.map(|spec| (snake_case(spec.name), spec));
        let short = SHORT_NAMES.iter();
        let short = short.map(|(name, primitive)| ((*name).to_owned(), spec(primitive)));
        by_name.chain(short).collect()
    })
}

/// Returns the name of a primitive's function: `SquareRoot` is `square_root`.
#[must_use]
pub fn snake_case(name: &str) -> String {
    let mut snake = String::with_capacity(name.len() + 4);
    let mut before = '_';
    for c in name.chars() {
        if c.is_ascii_uppercase() && before.is_ascii_lowercase() {
            snake.push('_');
        }
        snake.push(c.to_ascii_lowercase());
        before = c;
    }
    snake
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formula::lexer::KEYWORDS;

    #[test]
    fn every_name_of_the_tables_is_a_function() {
        let operators = INFIX.iter().map(|row| row.primitive);
        let operators = operators.filter(|name| !name.is_empty());
        let others = ["Not", "Negate", "Select", "Copy", "Multiply", "Scale"];
        let short = SHORT_NAMES.iter().map(|row| row.1);
        for name in operators.chain(others).chain(short) {
            assert!(is_function(spec(name)), "{name}");
            assert_eq!(spec(name).outputs.len(), 1, "{name}");
        }
        for (name, _) in SHORT_NAMES {
            let hides = CATALOGUE
                .iter()
                .find(|entry| snake_case(entry.spec.name) == *name);
            assert!(hides.is_none(), "{name}");
        }
    }

    #[test]
    fn functions_have_no_memory_and_take_required_arguments_first() {
        for (name, spec) in functions() {
            let required = spec.inputs.iter().map(|port| port.default.is_none());
            let required: Vec<bool> = required.collect();
            assert!(required.is_sorted_by(|a, b| a >= b), "{name}");
        }
        for name in ["sqrt", "square_root", "limit", "norm", "or_else", "xor"] {
            assert!(functions().contains_key(name), "{name}");
        }
        for name in ["time", "low_pass", "rising_edge", "constant", "monitor"] {
            assert!(!functions().contains_key(name), "{name}");
        }
        // `and`, `or` and `not` are operators.
        let hidden = KEYWORDS
            .iter()
            .filter(|word| functions().contains_key(**word));
        assert_eq!(hidden.collect::<Vec<_>>(), [&"and", &"or", &"not"]);
    }
}
