//! Short labels of constants for diagrams and tables: recognisable, but not meant to be read back. Runs in the command
//! line.

use crate::syntax::literal::{Literal, LiteralShape, Notation};

/// Longest text, characters.
const TEXT_MAX: usize = 24;
/// Most elements shown of a list.
const ELEMENTS_MAX: usize = 4;

/// Returns a constant as a label.
#[must_use]
pub fn literal_label(literal: &Literal) -> String {
    if let (LiteralShape::Real(..), Notation::Text(text)) = (&literal.shape, &literal.notation)
        && text.chars().count() <= TEXT_MAX
    {
        return text.clone();
    }
    match &literal.shape {
        LiteralShape::Real(value, unit) => match unit {
            Some(unit) if unit.to_string() != "1" => format!("{} {unit}", number(*value)),
            _ => number(*value),
        },
        LiteralShape::Text(text) if text.chars().count() > TEXT_MAX => {
            text.chars().take(TEXT_MAX - 1).chain(['…']).collect()
        }
        LiteralShape::Text(text) => text.clone(),
        LiteralShape::Rotation(elements) => format!("quat [{}]", numbers(elements)),
        LiteralShape::Pose([x, y, z, ..]) => format!("xyz [{}]", numbers(&[*x, *y, *z])),
        LiteralShape::List(elements) => {
            let shown = elements.iter().take(ELEMENTS_MAX).map(literal_label);
            let more = (elements.len() > ELEMENTS_MAX).then(|| "…".to_owned());
            let shown: Vec<String> = shown.chain(more).collect();
            format!("[{}]", shown.join(", "))
        }
        _ => literal.to_string(),
    }
}

fn numbers(values: &[f64]) -> String {
    let shown: Vec<String> = values.iter().map(|value| number(*value)).collect();
    shown.join(", ")
}

/// Formats a number with four significant digits, without trailing zeros.
fn number(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let size = value.abs().log10().floor();
    if (-4.0..6.0).contains(&size) {
        // From 0 to 7 in this range.
        let places = (3.0 - size).max(0.0) as usize;
        let text = format!("{value:.places$}");
        match text.contains('.') {
            true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
            false => text,
        }
    } else {
        let text = format!("{value:.3e}");
        let (digits, power) = text.split_once('e').unwrap_or((&text, "0"));
        let digits = digits.trim_end_matches('0').trim_end_matches('.');
        format!("{digits}e{power}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_four_digits() {
        for (value, text) in [
            (0.0, "0"),
            (12.0, "12"),
            (0.25, "0.25"),
            (std::f64::consts::PI, "3.142"),
            (123_456.7, "123457"),
            (-0.000_123_46, "-0.0001235"),
            (1e-9, "1e-9"),
            (2.5e12, "2.5e12"),
        ] {
            assert_eq!(number(value), text);
        }
    }
}
