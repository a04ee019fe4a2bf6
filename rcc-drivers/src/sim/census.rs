//! For tests that provoke each variant of an enumeration: the names of all of them, from a match that is exhaustive. A variant
//! that is missing there does not compile, and one that no case provokes fails the test.
//! Runs in the test harness.

use std::collections::BTreeSet;

/// Defines the names of all variants, and a function that names a value, from the same list of patterns.
macro_rules! variants {
    ($all:ident, $name:ident, $type:ty: $($variant:pat),+ $(,)?) => {
        const $all: &[&str] = &[$(stringify!($variant)),+];
        fn $name(value: &$type) -> &'static str {
            match value {
                $($variant => stringify!($variant)),+
            }
        }
    };
}

pub(super) use variants;

/// Returns the names as a set.
pub(super) fn all(names: &[&'static str]) -> BTreeSet<&'static str> {
    names.iter().copied().collect()
}
