//! The values that delayed links carry: each source is copied once, and neighbours together.
//! The loader's threads.

use std::collections::BTreeMap;

use rcc_core::plan::Delay;

use super::Slot;
use super::arena::Bits;

/// What makes two delayed links the same; in the order of the sources.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct CopyKey {
    /// Which arena.
    pub store: u8,
    /// First element of the source.
    pub from: u32,
    /// The first value; its length is the width.
    pub initial: Bits,
}

/// Where the copies are.
pub type Copies = BTreeMap<CopyKey, Slot>;

/// The fewest copies that move every value: two of neighbours whose copies are neighbours too are one.
pub fn ranges(copies: &Copies) -> Vec<Delay> {
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

    use super::super::arena::Arena;
    use super::*;
    use crate::syntax::literal::Stored;

    #[test]
    fn neighbours_are_copied_together() {
        let (mut arena, mut copies) = (Arena::default(), Copies::new());
        for (from, initial) in [(3, 0.0), (4, 1.0), (6, 0.0)] {
            let initial = Stored::Reals(vec![initial]);
            let key = CopyKey {
                store: Store::Real as u8,
                from,
                initial: Bits::of(&initial),
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
