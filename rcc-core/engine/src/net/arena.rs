//! The slots of a net in one block of memory: reals, Ints and Bools, each padded with 0 to whole blocks of the hash, so
//! that the hash reads it from one end to the other. Allocated with the net; used by the real-time thread.

use bytemuck::Zeroable;

use crate::hash::{HashedBlock, hash};
use crate::input::ArenaSlices;

/// See the module.
#[derive(Debug)]
pub(super) struct Arena {
    blocks: Box<[HashedBlock]>,
    /// Index of the first block of Ints, and of Bools.
    first: [usize; 2],
    /// Number of reals, Ints, Bools.
    lengths: [usize; 3],
}

/// The first elements of some blocks.
fn elements<T: bytemuck::Pod>(blocks: &[HashedBlock], length: usize) -> &[T] {
    let all: &[T] = bytemuck::cast_slice(blocks);
    all.get(..length).unwrap_or(all)
}

fn elements_mut<T: bytemuck::Pod>(blocks: &mut [HashedBlock], length: usize) -> &mut [T] {
    let all: &mut [T] = bytemuck::cast_slice_mut(blocks);
    let length = length.min(all.len());
    all.split_at_mut(length).0
}

impl Arena {
    /// Allocates an arena with these values. Not for the real-time thread.
    pub(super) fn new(reals: &[f64], bools: &[u8], ints: &[i64]) -> Arena {
        let bytes = [size_of_val(reals), size_of_val(ints), size_of_val(bools)];
        let [real_blocks, int_blocks, bool_blocks] =
            bytes.map(|bytes| bytes.div_ceil(size_of::<HashedBlock>()));
        let count = real_blocks + int_blocks + bool_blocks;
        let mut arena = Arena {
            blocks: vec![HashedBlock::zeroed(); count].into(),
            first: [real_blocks, real_blocks + int_blocks],
            lengths: [reals.len(), ints.len(), bools.len()],
        };
        arena.copy_from(reals, bools, ints);
        arena
    }

    /// Sets all values; the numbers are those of [`Arena::new`].
    pub(super) fn copy_from(&mut self, reals: &[f64], bools: &[u8], ints: &[i64]) {
        let here = self.slices_mut();
        here.reals.copy_from_slice(reals);
        here.bools.copy_from_slice(bools);
        here.ints.copy_from_slice(ints);
    }

    /// Reals, Bools, Ints.
    #[inline]
    pub(super) fn slices(&self) -> (&[f64], &[u8], &[i64]) {
        let ([ints_at, bools_at], [reals, ints, bools]) = (self.first, self.lengths);
        let (rest, bool_blocks) = self.blocks.split_at(bools_at);
        let (real_blocks, int_blocks) = rest.split_at(ints_at);
        (
            elements(real_blocks, reals),
            elements(bool_blocks, bools),
            elements(int_blocks, ints),
        )
    }

    #[inline]
    pub(super) fn slices_mut(&mut self) -> ArenaSlices<'_> {
        let ([ints_at, bools_at], [reals, ints, bools]) = (self.first, self.lengths);
        let (rest, bool_blocks) = self.blocks.split_at_mut(bools_at);
        let (real_blocks, int_blocks) = rest.split_at_mut(ints_at);
        ArenaSlices {
            reals: elements_mut(real_blocks, reals),
            bools: elements_mut(bool_blocks, bools),
            ints: elements_mut(int_blocks, ints),
        }
    }

    /// The hash of all slots.
    #[inline]
    pub(super) fn hash(&self) -> u64 {
        let (reals, others) = self.blocks.split_at(self.first[0]);
        hash(reals, others, self.lengths)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_arenas_of_any_size_are_apart_and_keep_their_values() {
        for count in [0, 1, 15, 16, 17, 127, 128, 129] {
            let reals: Vec<f64> = (0..count).map(|i| i as f64 + 0.5).collect();
            let ints: Vec<i64> = (0..count).map(|i| -(i as i64)).collect();
            let bools: Vec<u8> = (0..count).map(|i| (i % 3) as u8).collect();
            let mut arena = Arena::new(&reals, &bools, &ints);
            assert_eq!(arena.slices(), (&reals[..], &bools[..], &ints[..]));
            arena.slices_mut().ints.fill(7);
            assert_eq!(
                arena.slices(),
                (&reals[..], &bools[..], &vec![7; count][..])
            );
            arena.copy_from(&reals, &bools, &ints);
            assert_eq!(arena.slices(), (&reals[..], &bools[..], &ints[..]));
        }
    }
}
