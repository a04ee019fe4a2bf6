//! A chain of 500 formulas, and the same chain of the primitives that they stand for. Any thread.

/// Number of formulas, each of three operations.
pub const FORMULAS: usize = 500;

/// Returns the primitives of a net: time `f0`, then `f1` to `f500`, each a formula or its primitives, and a monitor of the
/// last.
#[must_use]
pub fn chain(formulas: bool) -> String {
    let mut text = String::from("  f0: {type: Time}\n");
    for number in 1..=FORMULAS {
        let before = format!("f{}.out", number - 1);
        text.push_str(&match formulas {
            true => format!(
                "  f{number}: {{type: Formula, parameters: {{expr: 'clamp(({before} - 2 s) * 3, 0 s, 100 s)'}}}}\n"
            ),
            false => format!(
                "  s{number}: {{type: Subtract, inputs: {{a: {before}, b: 2 s}}}}
  m{number}: {{type: Multiply, inputs: {{a: s{number}.out, b: 3}}}}
  f{number}: {{type: Limit, inputs: {{in: m{number}.out, low: 0 s, high: 100 s}}}}\n"
            ),
        });
    }
    text.push_str("  watch: {type: Monitor, inputs: {value: f500.out}}\n");
    text
}
