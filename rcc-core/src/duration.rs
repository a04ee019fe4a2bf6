//! Parser of durations in command-line options: `500ms`, `2s`, `1min`. Quantities of nets and configurations are parsed
//! by `rcc_config::quantity`. Used off the real-time thread.

/// Reason why a text is not a duration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DurationError {
    /// The unit is neither `ms` nor `s` nor `min`.
    Unit,
    /// There is no number before the unit.
    Number,
}

/// Parses an unsigned decimal number with its unit, or seconds without one; returns s.
///
/// # Errors
/// Returns which part of the text is wrong.
pub fn parse_seconds(text: &str) -> Result<f64, DurationError> {
    let text = text.trim();
    let digits = text.find(|c: char| !c.is_ascii_digit() && c != '.');
    let (number, unit) = text
        .split_at_checked(digits.unwrap_or(text.len()))
        .unwrap_or((text, ""));
    let factor = match unit.trim() {
        "ms" => 1e-3,
        "s" | "" => 1.0,
        "min" => 60.0,
        _ => return Err(DurationError::Unit),
    };
    let number: f64 = number.parse().map_err(|_| DurationError::Number)?;
    Ok(number * factor)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_duration_is_a_number_with_an_optional_unit() {
        for (text, seconds) in [("500ms", 0.5), (" 2 s ", 2.0), ("1.5", 1.5), ("1min", 60.0)] {
            assert_eq!(parse_seconds(text), Ok(seconds), "{text}");
        }
        for text in ["5 h", "-1s", "1e3s", "2 m", "nan"] {
            assert_eq!(parse_seconds(text), Err(DurationError::Unit), "{text}");
        }
        for text in ["", "s", "1.2.3 ms", "."] {
            assert_eq!(parse_seconds(text), Err(DurationError::Number), "{text}");
        }
    }
}
