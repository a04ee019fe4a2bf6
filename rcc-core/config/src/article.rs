//! Articles of nouns in messages: `a` or `an`. Never real-time.

use std::fmt::Display;

/// Returns a noun with its article: `an Int`, `a Real`.
#[must_use]
pub fn with_article(noun: impl Display) -> String {
    let noun = noun.to_string();
    let lower = noun.to_ascii_lowercase();
    // By its sound: an Int, an UpDownCounter, but a unit.
    let is_vowel = lower.starts_with(['a', 'e', 'i', 'o', 'u']) && !lower.starts_with("uni");
    format!("{} {noun}", if is_vowel { "an" } else { "a" })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn articles_agree_with_their_nouns() {
        for (noun, text) in [
            ("Int", "an Int"),
            ("Int[3]", "an Int[3]"),
            ("Real", "a Real"),
            ("analog output", "an analog output"),
            ("digital input", "a digital input"),
            ("UpDownCounter", "an UpDownCounter"),
            ("unit", "a unit"),
        ] {
            assert_eq!(with_article(noun), text);
        }
    }
}
