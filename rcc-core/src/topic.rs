//! Values from net to net: a topic has a name, of which the executor knows a hash, and one type. For the loader and the
//! executor.

use serde::{Deserialize, Serialize};

/// A name under which one net publishes a value that others subscribe to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Topic {
    /// A hash of the name, not 0.
    pub key: u64,
    /// A hash of type and unit: of a topic all who publish and subscribe have the same.
    pub kind: u64,
}

impl Topic {
    /// The topic of this name with values of this type and unit, both as people write them.
    pub fn new(name: &str, ty: &str, unit: &str) -> Topic {
        Topic {
            key: hash([name]).max(1),
            kind: hash([ty, unit]),
        }
    }
}

/// FNV-1a, 64 bits (Fowler, Noll, Vo), of texts one after the other.
pub(crate) fn hash<'a>(texts: impl IntoIterator<Item = &'a str>) -> u64 {
    let mut hash = 0xcbf2_9ce4_8422_2325;
    for text in texts {
        for byte in text.bytes().chain([0]) {
            hash = (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3);
        }
    }
    hash
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_topic_is_its_name_and_its_kind_what_it_carries() {
        let force = Topic::new("tool/force", "Wrench", "");
        assert_eq!(force, Topic::new("tool/force", "Wrench", ""));
        let other = Topic::new("tool/force", "Real", "N");
        assert_eq!(force.key, other.key);
        assert_ne!(force.kind, other.kind);
        assert_ne!(other.kind, Topic::new("tool/force", "Real", "m").kind);
        // A text ends where it ends.
        assert_ne!(hash(["ab", "c"]), hash(["a", "bc"]));
    }
}
