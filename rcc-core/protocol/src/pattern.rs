//! Patterns that select values: `line/move.pose`, `*/ik.joints[2]`, `fig?/*`. Pure functions.

use std::str::FromStr;

/// A pattern for `net/primitive.port`: `*` matches any characters, `?` one, and an element is given in brackets.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pattern {
    glob: String,
    /// Index of the only selected element, from 0.
    pub element: Option<usize>,
}

/// The text is not a valid pattern.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "invalid pattern `{given}`: write net/primitive.port or net/primitive.port[index], with * for any characters and ? for one"
)]
pub struct PatternError {
    given: String,
}

impl FromStr for Pattern {
    type Err = PatternError;

    fn from_str(given: &str) -> Result<Pattern, PatternError> {
        let failed = || PatternError {
            given: given.to_owned(),
        };
        let (glob, element) = match given.split_once('[') {
            None => (given, None),
            Some((glob, index)) => match index.strip_suffix(']').ok_or_else(failed)? {
                "*" => (glob, None),
                index => (glob, Some(index.parse().map_err(|_| failed())?)),
            },
        };
        if glob.is_empty() || glob.contains(char::is_whitespace) {
            return Err(failed());
        }
        Ok(Pattern {
            glob: glob.to_owned(),
            element,
        })
    }
}

impl Pattern {
    /// Returns true if the pattern matches this name. A pattern without `/` matches the port in any net.
    #[must_use]
    pub fn matches(&self, name: &str) -> bool {
        let name = match self.glob.contains('/') {
            true => name,
            false if self.glob == "*" => return true,
            false => name.split_once('/').map_or(name, |(_, port)| port),
        };
        matches(self.glob.as_bytes(), name.as_bytes())
    }
}

/// Returns true if `*` (any characters) and `?` (one) of a pattern make it this name.
#[must_use]
pub fn wildcard(pattern: &str, name: &str) -> bool {
    matches(pattern.as_bytes(), name.as_bytes())
}

/// Glob matching in at most pattern × name steps: only the last `*` is ever retried.
fn matches(glob: &[u8], name: &[u8]) -> bool {
    let (mut g, mut n) = (0, 0);
    let mut retry: Option<(usize, usize)> = None;
    while n < name.len() {
        match glob.get(g) {
            Some(b'*') => {
                retry = Some((g, n));
                g += 1;
            }
            Some(&byte) if byte == b'?' || Some(&byte) == name.get(n) => {
                g += 1;
                n += 1;
            }
            _ => match retry {
                Some((star, taken)) => {
                    retry = Some((star, taken + 1));
                    (g, n) = (star + 1, taken + 1);
                }
                None => return false,
            },
        }
    }
    glob.iter().skip(g).all(|byte| *byte == b'*')
}

#[cfg(test)]
mod tests {
    use super::*;

    fn means(pattern: &str, name: &str) -> bool {
        pattern
            .parse::<Pattern>()
            .is_ok_and(|pattern| pattern.matches(name))
    }

    #[test]
    fn stars_stand_for_any_characters() {
        assert!(means("line/move.pose", "line/move.pose"));
        assert!(means("*/move.*", "line/move.pose") && means("l?ne/*", "line/move.pose"));
        assert!(means("*a*b*c", "xaxbxbxc") && means("*", "line/move.pose"));
        assert!(!means("line/move", "line/move.pose") && !means("*a*b*c", "xaxbxbx"));
    }

    #[test]
    fn a_port_alone_matches_that_port_in_any_net() {
        assert!(means("move.pose", "line/move.pose") && !means("move.pose", "line/move.poses"));
    }

    #[test]
    fn an_element_is_separated_from_the_name() {
        let pattern: Result<Pattern, _> = "line/ik.joints[2]".parse();
        assert!(pattern.is_ok_and(|p| p.element == Some(2) && p.matches("line/ik.joints")));
        let all: Result<Pattern, _> = "line/ik.joints[*]".parse();
        assert!(all.is_ok_and(|p| p.element.is_none()));
    }

    #[test]
    fn invalid_patterns_are_refused() {
        for text in ["", "a[", "a[x]", "a[1", "[1]", "a b"] {
            assert!(text.parse::<Pattern>().is_err(), "{text}");
        }
    }
}
