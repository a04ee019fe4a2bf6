//! Sets of rows of the table of rules. Used by the real-time thread, its recorder, and replay.

use rcc_protocol::rules::RULES_MAX;

/// A set of rows of the table; bit r of word r / 64 is row r.
pub type RuleSet = [u64; RULES_MAX / 64];

/// Adds a row to a set.
pub fn insert(set: &mut RuleSet, slot: usize) {
    if let Some(word) = set.get_mut(slot / 64) {
        *word |= 1 << (slot % 64);
    }
}

/// Returns true if a row is in a set.
pub fn contains(set: &RuleSet, slot: usize) -> bool {
    let word = set.get(slot / 64).copied().unwrap_or(0);
    word >> (slot % 64) & 1 == 1
}
