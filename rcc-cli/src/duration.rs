//! Durations in arguments. Pure.

use std::time::Duration;

use rcc_core::duration::{DurationError, parse_seconds};

/// Parses `500ms`, `2s`, `1min`, or seconds without a unit.
///
/// # Errors
/// Returns a message for any other text, and for durations outside of 1 ms to one day.
pub fn duration(text: &str) -> Result<Duration, String> {
    let text = text.trim();
    match parse_seconds(text) {
        Err(DurationError::Unit) => Err(format!(
            "invalid duration `{text}`: write 500ms, 2s or 1min"
        )),
        Ok(seconds) if (1e-3..=86_400.0).contains(&seconds) => Ok(Duration::from_secs_f64(seconds)),
        _ => Err(format!(
            "invalid duration `{text}`: must be between 1ms and 1440min"
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_have_a_unit_or_are_seconds() {
        assert_eq!(duration("500ms"), Ok(Duration::from_millis(500)));
        assert_eq!(duration("1.5"), Ok(Duration::from_millis(1500)));
        assert_eq!(duration("1 min"), Ok(Duration::from_secs(60)));
    }

    #[test]
    fn invalid_durations_are_refused() {
        for text in ["", "s", "-1s", "0s", "5 h", "1e9s", "nan"] {
            assert!(duration(text).is_err(), "{text}");
        }
    }
}
