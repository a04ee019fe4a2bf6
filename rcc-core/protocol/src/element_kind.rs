//! Formats elements of monitored values for people and programs; null remains null. Pure.

use rcc_core::types::NULL_INT;
use serde_json::{Number, Value};

/// How the elements of a monitored value are written in its records.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ElementKind {
    /// Real; NaN is null.
    Real,
    /// Bool as 0 or 1; NaN is null.
    Bool,
    /// The bits of a 64-bit integer; the smallest integer is null.
    Int,
}

impl ElementKind {
    /// Returns the element type of a named type: `Bool`, `Int[3]`, `Pose`, …
    #[must_use]
    pub fn of(ty: &str) -> ElementKind {
        match ty.split('[').next() {
            Some("Bool") => ElementKind::Bool,
            Some("Int") => ElementKind::Int,
            _ => ElementKind::Real,
        }
    }

    /// Formats an element as JSON.
    #[must_use]
    pub fn json(self, element: f64) -> Value {
        match self {
            ElementKind::Real => Number::from_f64(element).map_or(Value::Null, Value::Number),
            ElementKind::Bool if element.is_nan() => Value::Null,
            ElementKind::Bool => Value::Bool(element != 0.0),
            ElementKind::Int => match element.to_bits() as i64 {
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
            (ElementKind::Real, _) => format!("{element:.6}"),
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
            (ElementKind::Real, f64::NAN),
            (ElementKind::Bool, f64::NAN),
            (ElementKind::Int, f64::from_bits(NULL_INT as u64)),
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
        assert_eq!(ElementKind::Int.json(element), Value::from(number));
        assert_eq!(ElementKind::of("Int[3]"), ElementKind::Int);
    }

    #[test]
    fn booleans_are_words() {
        assert_eq!(ElementKind::of("Bool").human(1.0), "true");
        assert_eq!(ElementKind::of("Bool").json(0.0), Value::Bool(false));
    }
}
