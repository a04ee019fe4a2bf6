//! FNV-1a, 64 bits (Fowler, Noll, Vo): a hash that is stable across builds and machines, unlike the hashers of the
//! standard library. Pure functions; the build script of `rcc-engine` includes this file.

/// Hash of no bytes.
pub const EMPTY: u64 = 0xcbf2_9ce4_8422_2325;

/// Adds a byte to a hash.
#[must_use]
pub const fn step(hash: u64, byte: u8) -> u64 {
    (hash ^ byte as u64).wrapping_mul(0x100_0000_01b3)
}

/// Adds bytes to a hash.
#[must_use]
pub const fn add(mut hash: u64, mut bytes: &[u8]) -> u64 {
    while let [first, rest @ ..] = bytes {
        hash = step(hash, *first);
        bytes = rest;
    }
    hash
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Test vectors of the authors (draft-eastlake-fnv, appendix C).
    #[test]
    fn known_texts_have_known_hashes() {
        assert_eq!(add(EMPTY, b""), 0xcbf2_9ce4_8422_2325);
        assert_eq!(add(EMPTY, b"a"), 0xaf63_dc4c_8601_ec8c);
        assert_eq!(add(EMPTY, b"foobar"), 0x8594_4171_f739_67e8);
    }
}
