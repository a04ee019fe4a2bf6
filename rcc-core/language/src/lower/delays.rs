//! The values that delayed links carry: each source is copied once, and adjacent ranges together. Runs on the loader's
//! threads.

use std::collections::BTreeMap;

use rcc_core::plan::Delay;

use super::SlotRange;
use crate::syntax::stored_value::StoredValue;

/// Identifies the copy that delayed links share; ordered by source.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct DelayKey {
    /// Number of the arena.
    pub store: u8,
    /// First slot of the source.
    pub from: u32,
    /// Initial value; its length is the width.
    pub initial: StoredValue,
}

/// Slots of the copies.
pub type DelayCopies = BTreeMap<DelayKey, SlotRange>;

/// Returns the fewest copies that move every value: adjacent sources with adjacent copies are merged.
pub fn ranges(copies: &DelayCopies) -> Vec<Delay> {
    let mut ranges: Vec<Delay> = Vec::new();
    for (key, copy) in copies {
        match ranges.last_mut() {
            Some(last)
                if last.store == copy.store
                    && last.from + last.width == key.from
                    && last.to + last.width == copy.slot =>
            {
                last.width += copy.width;
            }
            _ => ranges.push(Delay {
                store: copy.store,
                from: key.from,
                to: copy.slot,
                width: copy.width,
            }),
        }
    }
    ranges
}

#[cfg(test)]
mod tests {
    use rcc_core::types::Store;

    use super::super::arena::ArenaBuilder;
    use super::*;

    #[test]
    fn adjacent_values_are_copied_together() {
        let (mut arena, mut copies) = (ArenaBuilder::default(), DelayCopies::new());
        for (from, initial) in [(3, 0.0), (4, 1.0), (6, 0.0)] {
            let initial = StoredValue::real(initial);
            let key = DelayKey {
                store: Store::Real as u8,
                from,
                initial: initial.clone(),
            };
            copies.insert(key, arena.variable(&initial));
        }
        let range = |from, to, width| Delay {
            store: Store::Real,
            from,
            to,
            width,
        };
        assert_eq!(ranges(&copies), [range(3, 0, 2), range(6, 2, 1)]);
    }
}
