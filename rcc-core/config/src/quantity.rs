//! Numbers with a unit as people write them: `100 Hz`, `12 N`, `0.25 m/s`, `deg(30)`, `rad(pi/2)`. Converted to SI
//! once, when a text is read; never on the real-time thread.

use std::f64::consts::PI;

use rcc_core::unit::{UNIT_NAMES, Unit};
use thiserror::Error;

use crate::diagnostic::closest;
use crate::yaml::{Node, Value};

/// Maximum nesting of parentheses in `deg(…)` and `rad(…)`.
const DEPTH_MAX: usize = 16;

/// A number in SI units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quantity {
    /// Value in SI units.
    pub value: f64,
    /// SI unit; `None` for a bare number, which takes the unit of the place where it is used.
    pub unit: Option<Unit>,
}

/// Reason why a text is not a quantity.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum QuantityError {
    /// The value is neither a number nor text.
    #[error("expected a number or a number with a unit, found {found}")]
    NotANumber {
        /// Type of the value.
        found: &'static str,
    },
    /// The text does not begin with a number.
    #[error("`{text}` is neither a number nor a number with a unit such as `12 N` or `deg(30)`")]
    NoNumber {
        /// The text.
        text: String,
    },
    /// The unit is not known.
    #[error("unknown unit `{name}`{}", did_you_mean(.suggestion.as_deref()))]
    UnknownUnit {
        /// Name of the unit as written.
        name: String,
        /// A known unit with a similar name.
        suggestion: Option<String>,
    },
    /// The expression in `deg(…)` or `rad(…)` cannot be evaluated.
    #[error("cannot evaluate `{text}`: use numbers, pi, + - * / and parentheses")]
    Expression {
        /// The expression.
        text: String,
    },
    /// The number is beyond the range of `f64`.
    #[error("`{text}` is too large")]
    TooLarge {
        /// The text.
        text: String,
    },
}

fn did_you_mean(suggestion: Option<&str>) -> String {
    suggestion.map_or(String::new(), |name| format!(", did you mean `{name}`?"))
}

/// Returns true if a text is meant as a quantity: it begins like a number, or with `deg(` or `rad(`.
#[must_use]
pub fn looks_like(text: &str) -> bool {
    let unsigned = text.trim_start_matches(['+', '-']).trim_start();
    unsigned.starts_with(|c: char| c.is_ascii_digit() || c == '.')
        || unsigned.starts_with("deg(")
        || unsigned.starts_with("rad(")
}

/// Reads a number, or a text with a number and a unit.
///
/// # Errors
/// Returns a [`QuantityError`]. A number in quotes is text without a unit and is refused.
pub fn of(node: &Node) -> Result<Quantity, QuantityError> {
    match &node.value {
        #[allow(clippy::cast_precision_loss)] // Nobody writes 2^53 metres.
        Value::Int(value) => Ok(Quantity {
            value: *value as f64,
            unit: None,
        }),
        Value::Real(value) => Ok(Quantity {
            value: *value,
            unit: None,
        }),
        Value::Text(text) => parse(text),
        _ => Err(QuantityError::NotANumber { found: node.kind() }),
    }
}

/// Reads a number with a unit.
///
/// # Errors
/// Returns a [`QuantityError`].
pub fn parse(text: &str) -> Result<Quantity, QuantityError> {
    let text = text.trim();
    let (sign, rest) = match text.strip_prefix('-') {
        Some(rest) => (-1.0, rest.trim_start()),
        None => (1.0, text.strip_prefix('+').unwrap_or(text).trim_start()),
    };
    for (name, factor) in [("deg(", PI / 180.0), ("rad(", 1.0)] {
        if let Some(inside) = rest.strip_prefix(name) {
            let value = angle(inside, text)?;
            return finite(sign * value * factor, Some(Unit::RADIAN), text);
        }
    }
    let end = number_length(rest);
    let (number, unit) = rest.split_at_checked(end).unwrap_or((rest, ""));
    let no_number = || QuantityError::NoNumber {
        text: text.to_string(),
    };
    let value: f64 = number.parse().map_err(|_| no_number())?;
    let unit = unit.trim();
    if unit.is_empty() {
        return Err(no_number());
    }
    let (unit, factor) = Unit::parse(unit).ok_or_else(|| unknown_unit(unit))?;
    finite(sign * value * factor, Some(unit), text)
}

fn finite(value: f64, unit: Option<Unit>, text: &str) -> Result<Quantity, QuantityError> {
    if value.is_finite() {
        Ok(Quantity { value, unit })
    } else {
        Err(QuantityError::TooLarge {
            text: text.to_string(),
        })
    }
}

fn unknown_unit(unit: &str) -> QuantityError {
    let known = |name: &str| Unit::parse(name).is_some();
    let part = unit
        .split(['*', '/', '·'])
        .map(|part| part.split('^').next().unwrap_or(part).trim())
        .find(|part| !known(part));
    let name = part.unwrap_or(unit);
    let near = closest(name, UNIT_NAMES.iter().map(|named| named.name));
    QuantityError::UnknownUnit {
        name: name.to_string(),
        suggestion: near.map(ToString::to_string),
    }
}

/// Returns the length of the unsigned number at the beginning of a text.
fn number_length(text: &str) -> usize {
    let bytes = text.as_bytes();
    let digits = |from: usize| {
        let rest = bytes.get(from..).unwrap_or(&[]);
        from + rest.iter().take_while(|byte| byte.is_ascii_digit()).count()
    };
    let mut end = digits(0);
    if bytes.get(end) == Some(&b'.') {
        end = digits(end + 1);
    }
    if matches!(bytes.get(end), Some(b'e' | b'E')) {
        let signed = usize::from(matches!(bytes.get(end + 1), Some(b'+' | b'-')));
        let exponent = digits(end + 1 + signed);
        if exponent > end + 1 + signed {
            end = exponent;
        }
    }
    end
}

/// Evaluates the expression in parentheses; `inside` still has the closing one.
fn angle(inside: &str, whole: &str) -> Result<f64, QuantityError> {
    let fault = || QuantityError::Expression {
        text: whole.to_string(),
    };
    let inside = inside.strip_suffix(')').ok_or_else(fault)?;
    let mut expression = Expression {
        rest: inside,
        depth: 0,
    };
    let value = expression.sum().ok_or_else(fault)?;
    expression.skip();
    if expression.rest.is_empty() && !value.is_nan() {
        Ok(value)
    } else {
        Err(fault())
    }
}

/// Parser of `sum = product (± product)*`, `product = factor (×÷ factor)*`, `factor = ±factor | number | pi | (sum)`.
struct Expression<'a> {
    rest: &'a str,
    depth: usize,
}

impl Expression<'_> {
    fn skip(&mut self) {
        self.rest = self.rest.trim_start();
    }

    fn eat(&mut self, text: &str) -> bool {
        self.skip();
        match self.rest.strip_prefix(text) {
            Some(rest) => {
                self.rest = rest;
                true
            }
            None => false,
        }
    }

    fn sum(&mut self) -> Option<f64> {
        let mut value = self.product()?;
        loop {
            if self.eat("+") {
                value += self.product()?;
            } else if self.eat("-") {
                value -= self.product()?;
            } else {
                return Some(value);
            }
        }
    }

    fn product(&mut self) -> Option<f64> {
        let mut value = self.factor()?;
        loop {
            if self.eat("*") {
                value *= self.factor()?;
            } else if self.eat("/") {
                value /= self.factor()?;
            } else {
                return Some(value);
            }
        }
    }

    fn factor(&mut self) -> Option<f64> {
        self.depth += 1;
        if self.depth > DEPTH_MAX {
            return None;
        }
        let value = if self.eat("-") {
            -self.factor()?
        } else if self.eat("+") {
            self.factor()?
        } else if self.eat("(") {
            let value = self.sum()?;
            if !self.eat(")") {
                return None;
            }
            value
        } else if self.eat("pi") {
            PI
        } else {
            let (number, rest) = self.rest.split_at_checked(number_length(self.rest))?;
            self.rest = rest;
            number.parse().ok()?
        };
        self.depth -= 1;
        Some(value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantities_become_si() {
        for (text, value, unit) in [
            ("100 Hz", 100.0, Unit::HERTZ),
            ("1 ms", 1e-3, Unit::SECOND),
            ("1ms", 1e-3, Unit::SECOND),
            ("12 N", 12.0, Unit::NEWTON),
            ("-0.25 m/s", -0.25, Unit::METRE_PER_SECOND),
            ("1e3 mm", 1.0, Unit::METRE),
            ("50 %", 0.5, Unit::ONE),
            ("deg(30)", 30.0 * (PI / 180.0), Unit::RADIAN),
            ("-deg(30)", -30.0 * (PI / 180.0), Unit::RADIAN),
            ("rad(pi/2)", PI / 2.0, Unit::RADIAN),
            ("rad(-(1 + 2)*pi / 4)", -3.0 * PI / 4.0, Unit::RADIAN),
            ("170 deg", 170.0 * (PI / 180.0), Unit::RADIAN),
        ] {
            let quantity = parse(text).unwrap();
            assert_eq!(quantity.unit, Some(unit), "{text}");
            assert!(
                (quantity.value - value).abs() < 1e-12,
                "{text} = {}",
                quantity.value
            );
        }
    }

    #[test]
    fn invalid_quantities_are_refused() {
        for text in [
            "",
            "12",
            "N",
            "12 furlong",
            "deg(",
            "deg()",
            "deg(1",
            "deg(x)",
            "rad(1/0)",
            "rad(0/0)",
            "1e400 m",
            "é",
            "-",
        ] {
            assert!(parse(text).is_err(), "{text}");
        }
        assert!(parse(&format!("rad({}1{})", "(".repeat(99), ")".repeat(99))).is_err());
        assert!(parse(&format!("rad({}1)", "-".repeat(99_999))).is_err());
    }

    #[test]
    fn a_mistyped_unit_gets_a_suggestion() {
        let error = parse("12 khz").unwrap_err();
        assert_eq!(error.to_string(), "unknown unit `khz`, did you mean `kHz`?");
    }

    #[test]
    fn references_do_not_look_like_quantities() {
        assert!(
            ["12 N", "-deg(3)", ".5 m", "rad(pi)"]
                .into_iter()
                .all(looks_like)
        );
        assert!(
            !["traj.q", "degree.out", "", "pi"]
                .into_iter()
                .any(looks_like)
        );
    }
}
