//! Topics: values that one net publishes for others. A topic has a name, of which the executor knows only a hash, and
//! one type. For the loader and the executor.

use serde::{Deserialize, Serialize};

use crate::fnv;

/// A topic: published by one net, subscribed to by others.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Topic {
    /// Hash of the name, never 0.
    pub key: u64,
    /// Hash of type and unit; the same for the publisher and all subscribers.
    pub kind: u64,
}

impl Topic {
    /// Returns the topic `name` with values of this type and unit, as written in nets.
    pub fn new(name: &str, ty: &str, unit: &str) -> Topic {
        Topic {
            key: hash([name]).max(1),
            kind: hash([ty, unit]),
        }
    }
}

/// Returns a hash of the texts in sequence.
fn hash<'a>(texts: impl IntoIterator<Item = &'a str>) -> u64 {
    texts.into_iter().fold(fnv::EMPTY, add)
}

/// Adds a text to a hash.
pub(crate) const fn add(hash: u64, text: &str) -> u64 {
    fnv::step(fnv::add(hash, text.as_bytes()), 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_topic_has_a_key_by_name_and_a_kind_by_type_and_unit() {
        let force = Topic::new("tool/force", "Wrench", "");
        assert_eq!(force, Topic::new("tool/force", "Wrench", ""));
        let other = Topic::new("tool/force", "Real", "N");
        assert_eq!(force.key, other.key);
        assert_ne!(force.kind, other.kind);
        assert_ne!(other.kind, Topic::new("tool/force", "Real", "m").kind);
        // The boundary between texts is part of the hash.
        assert_ne!(hash(["ab", "c"]), hash(["a", "bc"]));
    }
}
