//! Version 1 of the hash of all slots, with which incidents up to format 7 were recorded, and the checksum of incident
//! files. Off the real-time thread.
//!
//! Definition. Eight lanes of 64 bits are initialized with `SEED + lane · STEP`. The arenas follow each
//! other: reals as their bits, with every NaN replaced by the bit pattern [`NULL`] (any NaN is null, and which one an
//! operation returns may differ between builds); then Ints; then Bools, eight per word, the first in the lowest byte,
//! the last word padded with 0. In each arena word i goes to lane i mod 8: `lane = (rotate_left(lane, 29) ^ word) ·
//! MIX`. Finally h starts as the three lengths, `reals + 2²¹ · ints + 2⁴² · bools`; all lanes are mixed into h in order
//! in the same way, and `h ^ (h >> 32)` is the hash.
//!
//! Each step is a bijection of the lane for a given word, and of the word for a given lane: two states that differ in
//! one slot never have the same hash; other states collide with a probability near 2⁻⁶⁴.

use super::{packed, packed_lengths};

/// Bit pattern that represents every null `Real`.
const NULL: u64 = 0x7ff8_0000_0000_0000;

const LANES: usize = 8;
const SEED: u64 = 0x243f_6a88_85a3_08d3;
const STEP: u64 = 0x9e37_79b9_7f4a_7c15;
const MIX: u64 = 0xff51_afd7_ed55_8ccd;
const INFINITE: u64 = 0x7ff0_0000_0000_0000;

#[inline(always)]
fn take(lane: u64, word: u64) -> u64 {
    (lane.rotate_left(29) ^ word).wrapping_mul(MIX)
}

/// The bits of a `Real`, with one pattern for null.
#[inline(always)]
fn real_word(value: f64) -> u64 {
    let bits = value.to_bits();
    if bits & (u64::MAX >> 1) > INFINITE {
        NULL
    } else {
        bits
    }
}

#[inline(always)]
fn arena<T: Copy>(lanes: &mut [u64; LANES], values: &[T], word: impl Fn(T) -> u64) {
    let (blocks, rest) = values.as_chunks::<LANES>();
    let mut all = *lanes;
    for block in blocks {
        for (lane, value) in all.iter_mut().zip(block) {
            *lane = take(*lane, word(*value));
        }
    }
    for (lane, value) in all.iter_mut().zip(rest) {
        *lane = take(*lane, word(*value));
    }
    *lanes = all;
}

/// The hash of three arenas.
#[inline]
pub fn hash(reals: &[f64], bools: &[u8], ints: &[i64]) -> u64 {
    let mut lanes = lanes();
    arena(&mut lanes, reals, real_word);
    arena(&mut lanes, ints, i64::cast_unsigned);
    let (words, rest) = bools.as_chunks::<8>();
    arena(&mut lanes, words, u64::from_le_bytes);
    if !rest.is_empty() {
        // The lane of the word after the whole words.
        let word = packed(rest);
        if let Some(lane) = lanes.get_mut(words.len() % LANES) {
            *lane = take(*lane, word);
        }
    }
    end(
        lanes,
        packed_lengths([reals.len(), ints.len(), bools.len()]),
    )
}

#[inline(always)]
fn lanes() -> [u64; LANES] {
    let mut lanes = [0; LANES];
    let mut seed = SEED;
    for lane in &mut lanes {
        *lane = seed;
        seed = seed.wrapping_add(STEP);
    }
    lanes
}

#[inline(always)]
fn end(lanes: [u64; LANES], lengths: u64) -> u64 {
    let all = lanes.into_iter().fold(lengths, take);
    all ^ all >> 32
}

/// The same hash over Ints alone, word by word: the checksum of incident files.
#[derive(Clone, Copy, Debug)]
pub struct WordChecksum {
    lanes: [u64; LANES],
    count: u64,
}

impl Default for WordChecksum {
    fn default() -> WordChecksum {
        let lanes = lanes();
        WordChecksum { lanes, count: 0 }
    }
}

impl WordChecksum {
    /// Adds a word.
    pub fn take(&mut self, word: u64) {
        if let Some(lane) = self.lanes.get_mut((self.count % LANES as u64) as usize) {
            *lane = take(*lane, word);
        }
        self.count += 1;
    }

    /// The hash of all words so far.
    pub fn end(&self) -> u64 {
        end(self.lanes, self.count << 21)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hash::tests::{assert_nulls_and_signs, each_length};

    /// The definition, word by word.
    fn defined(reals: &[f64], bools: &[u8], ints: &[i64]) -> u64 {
        let mut lanes: Vec<u64> = (0..8)
            .map(|i| SEED.wrapping_add(STEP.wrapping_mul(i)))
            .collect();
        let null_or = |value: &f64| {
            if value.is_nan() {
                NULL
            } else {
                value.to_bits()
            }
        };
        let reals_words: Vec<u64> = reals.iter().map(null_or).collect();
        let int_words: Vec<u64> = ints.iter().map(|value| *value as u64).collect();
        let bool_words: Vec<u64> = bools.chunks(8).map(packed).collect();
        for words in [reals_words, int_words, bool_words] {
            for (index, word) in words.into_iter().enumerate() {
                lanes[index % 8] = take(lanes[index % 8], word);
            }
        }
        let mut h =
            reals.len() as u64 + (ints.len() as u64) * (1 << 21) + (bools.len() as u64) * (1 << 42);
        for lane in lanes {
            h = take(h, lane);
        }
        h ^ h >> 32
    }

    #[test]
    fn it_is_as_defined_for_every_length() {
        each_length(70, |reals, bools, ints| {
            let lengths = [reals.len(), ints.len(), bools.len()];
            assert_eq!(
                hash(reals, bools, ints),
                defined(reals, bools, ints),
                "{lengths:?}"
            );
        });
    }

    #[test]
    fn a_sum_is_the_hash_of_ints() {
        let ints: Vec<i64> = (0..100).map(|i| i * i - 50).collect();
        for count in 0..ints.len() {
            let mut sum = WordChecksum::default();
            ints[..count]
                .iter()
                .for_each(|value| sum.take(value.cast_unsigned()));
            assert_eq!(sum.end(), hash(&[], &[], &ints[..count]));
        }
    }

    #[test]
    fn it_is_the_same_on_every_machine() {
        assert_eq!(
            hash(&[1.0, f64::NAN, -0.0], &[0, 1, 2], &[i64::MIN, 7]),
            0x2dd1_21ac_d0af_1c7e
        );
    }

    #[test]
    fn every_nan_is_null_and_minus_zero_is_not_zero() {
        assert_nulls_and_signs(hash);
    }

    #[test]
    fn one_changed_slot_changes_it() {
        let mut reals = vec![0.25; 100];
        let before = hash(&reals, &[], &[]);
        for index in 0..100 {
            for bit in [0, 31, 52, 63] {
                let value = reals[index];
                reals[index] = f64::from_bits(value.to_bits() ^ 1 << bit);
                assert_ne!(hash(&reals, &[], &[]), before);
                reals[index] = value;
            }
        }
    }
}
