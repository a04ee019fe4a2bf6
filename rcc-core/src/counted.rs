//! Nouns that agree with their count in texts for people: 1 late cycle, 2 late cycles. Pure, without heap; never used by
//! the real-time thread.

use core::fmt::{self, Display};

/// Displays an English noun, given in the singular, in the number of the count: `cycle`, `axes`, `entries`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Noun<'a>(pub u64, pub &'a str);

impl Display for Noun<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Noun(count, noun) = *self;
        if count == 1 {
            return f.write_str(noun);
        }
        if let Some(stem) = noun.strip_suffix("is") {
            return write!(f, "{stem}es");
        }
        match noun.strip_suffix('y') {
            Some(stem) if !stem.ends_with(['a', 'e', 'i', 'o', 'u']) => write!(f, "{stem}ies"),
            _ if ["s", "x", "ch", "sh"].iter().any(|end| noun.ends_with(end)) => {
                write!(f, "{noun}es")
            }
            _ => write!(f, "{noun}s"),
        }
    }
}

/// Displays a count and its noun, given in the singular: `1 late cycle`, `0 axes`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Counted<'a>(pub u64, pub &'a str);

impl<'a> Counted<'a> {
    /// Counts the elements of a collection.
    #[must_use]
    pub const fn of(length: usize, noun: &'a str) -> Counted<'a> {
        Counted(length as u64, noun)
    }
}

impl Display for Counted<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.0, Noun(self.0, self.1))
    }
}

#[cfg(test)]
mod tests {
    use std::string::ToString;

    use super::*;

    #[test]
    fn a_noun_agrees_with_its_count() {
        for (count, noun, text) in [
            (0, "error", "0 errors"),
            (1, "late cycle", "1 late cycle"),
            (2, "late cycle", "2 late cycles"),
            (7, "axis", "7 axes"),
            (1, "axis", "1 axis"),
            (3, "entry", "3 entries"),
            (3, "delay", "3 delays"),
            (2, "process", "2 processes"),
            (2, "switch", "2 switches"),
            (2, "time", "2 times"),
        ] {
            assert_eq!(Counted(count, noun).to_string(), text);
        }
    }
}
