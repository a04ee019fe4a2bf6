//! Formats monitored values for people and programs; null remains null. Pure.

use rcc_core::types::NULL_INT;
use serde_json::{Number, Value};

/// The type of a record's elements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ElementType {
    /// Real; NaN is null.
    Real,
    /// Bool as 0 or 1; NaN is null.
    Bool,
    /// The bits of a 64-bit integer; the smallest integer is null.
    Int,
}

impl ElementType {
    /// Returns the element type of a named type: `Bool`, `Int[3]`, `Pose`, …
    #[must_use]
    pub fn of(ty: &str) -> ElementType {
        match ty.split('[').next() {
            Some("Bool") => ElementType::Bool,
            Some("Int") => ElementType::Int,
            _ => ElementType::Real,
        }
    }

    /// Formats an element as JSON.
    #[must_use]
    pub fn json(self, element: f64) -> Value {
        match self {
            ElementType::Real => Number::from_f64(element).map_or(Value::Null, Value::Number),
            ElementType::Bool if element.is_nan() => Value::Null,
            ElementType::Bool => Value::Bool(element != 0.0),
            ElementType::Int => match element.to_bits() as i64 {
                NULL_INT => Value::Null,
                number => Value::from(number),
            },
        }
    }

    /// Formats an element for people, null as `–`.
    #[must_use]
    pub fn human(self, element: f64) -> String {
        match (self, self.json(element)) {
            (_, Value::Null) => "–".to_owned(),
            (ElementType::Real, _) => format!("{element:.6}"),
            (_, value) => value.to_string(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn null_is_null_in_every_kind() {
        for (kind, null) in [
            (ElementType::Real, f64::NAN),
            (ElementType::Bool, f64::NAN),
            (ElementType::Int, f64::from_bits(NULL_INT as u64)),
        ] {
            assert_eq!(
                (kind.json(null), kind.human(null)),
                (Value::Null, "–".to_owned())
            );
        }
    }

    #[test]
    fn integers_keep_all_their_bits() {
        let number = -9_007_199_254_740_993_i64;
        let element = f64::from_bits(number as u64);
        assert_eq!(ElementType::Int.json(element), Value::from(number));
        assert_eq!(ElementType::of("Int[3]"), ElementType::Int);
    }

    #[test]
    fn booleans_are_words() {
        assert_eq!(ElementType::of("Bool").human(1.0), "true");
        assert_eq!(ElementType::of("Bool").json(0.0), Value::Bool(false));
    }
}
