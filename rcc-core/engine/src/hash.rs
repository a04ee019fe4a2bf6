//! Hash of all slots of a net after a cycle, which replay compares. Run by the real-time thread after each evaluation,
//! and by replay; no allocation, no failure.
//!
//! Definition. Thirty-two lanes of 64 bits are initialized with `SEED + lane · STEP`. The arenas follow each other: reals
//! as their bits, with every NaN replaced by [`NULL`] (any NaN is null, and which one an operation returns may differ
//! between builds); then Ints; then Bools, eight per word, the first in the lowest byte. Each arena is padded with 0 to
//! whole blocks of sixteen words. Blocks go to the lower and the upper half of the lanes in turns; the first block of
//! reals, and the first one behind the reals, to the lower half. Each word of a block goes to its lane of that half by the
//! step `x = lane ^ word, x = x ^ (x >> 32), lane = rotate_left(low(x) · FACTOR + high(x) · 2³², 32)`, where low and high
//! are the halves of x. Then the upper half of the lanes, each rotated by 32, is taken into the lower half as words, until
//! one is left: `h`. Finally h is exclusive-or-ed with the lengths, `reals + 2²¹ · ints + 2⁴² · bools`, and mixed: twice
//! `h · MIX`, then `h ^ (h >> 32)`.
//!
//! Each step is a bijection of the lane for a given word, and of the word for a given lane, because FACTOR is odd: two
//! states that differ in one slot never have the same hash; other states collide with a probability near 2⁻⁶⁴. A step
//! needs products of 32 bits only, which vectors have: a processor computes four or eight lanes at once. The steps of one
//! lane wait for each other; two halves keep the processor busy meanwhile.

use bytemuck::{Pod, Zeroable};
use rcc_os::wide::{WideWork, with_wide_vectors};

mod checksum;

pub use checksum::WordChecksum;

/// Number of words in a block, and of lanes that it goes to.
pub const WORDS: usize = 16;
/// The word for every null `Real`.
const NULL: u64 = u64::MAX;
const SEED: u64 = 0x243f_6a88_85a3_08d3;
const STEP: u64 = 0x9e37_79b9_7f4a_7c15;
/// Odd.
const FACTOR: u64 = 0x9e37_79b1;
const MIX: u64 = 0xff51_afd7_ed55_8ccd;
const LOW: u64 = 0xffff_ffff;

/// Words of an arena that are hashed together, on two lines of the cache.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(128))]
pub struct HashedBlock(pub [u64; WORDS]);

#[inline(always)]
fn take(lane: u64, word: u64) -> u64 {
    let x = lane ^ word;
    // A change of any bit reaches the product.
    let x = x ^ x >> 32;
    // low · FACTOR + high · 2³², as low · (FACTOR − 1) + x: one operation less.
    (x & LOW)
        .wrapping_mul(FACTOR - 1)
        .wrapping_add(x)
        .rotate_left(32)
}

/// The word of a `Real` with these bits.
#[inline(always)]
pub fn real_word(bits: u64) -> u64 {
    if f64::from_bits(bits).is_nan() {
        NULL
    } else {
        bits
    }
}

/// The blocks of a net.
struct Blocks<'a> {
    reals: &'a [HashedBlock],
    others: &'a [HashedBlock],
    lengths: u64,
}

impl WideWork for Blocks<'_> {
    type Result = u64;

    #[inline(always)]
    fn run(self) -> u64 {
        let mut lanes = FIRST;
        take_blocks(&mut lanes, self.reals, real_word);
        take_blocks(&mut lanes, self.others, |word| word);
        end(lanes, self.lengths)
    }
}

/// Takes blocks into the lower and the upper half of the lanes in turns.
#[inline(always)]
fn take_blocks(
    lanes: &mut [[u64; WORDS]; 2],
    blocks: &[HashedBlock],
    word_of: impl Fn(u64) -> u64 + Copy,
) {
    let [lower, upper] = lanes;
    let (pairs, last) = blocks.as_chunks::<2>();
    for [even, odd] in pairs {
        take_block(lower, even, word_of);
        take_block(upper, odd, word_of);
    }
    for even in last {
        take_block(lower, even, word_of);
    }
}

#[inline(always)]
fn take_block(lanes: &mut [u64; WORDS], block: &HashedBlock, word_of: impl Fn(u64) -> u64) {
    for (lane, word) in lanes.iter_mut().zip(block.0) {
        *lane = take(*lane, word_of(word));
    }
}

/// The lanes before the first word.
const FIRST: [[u64; WORDS]; 2] = {
    let (mut lanes, mut seed) = ([[0; WORDS]; 2], SEED);
    let mut rest: &mut [u64] = lanes.as_flattened_mut();
    while let Some((lane, after)) = rest.split_first_mut() {
        *lane = seed;
        seed = seed.wrapping_add(STEP);
        rest = after;
    }
    lanes
};

/// Takes the upper lanes into the lower ones.
#[inline(always)]
fn half<const N: usize>(lower: &[u64], upper: &[u64]) -> [u64; N] {
    let mut taken = [0; N];
    for ((place, lower), upper) in taken.iter_mut().zip(lower).zip(upper) {
        // Rotated, or the same change in both would give the same hash.
        *place = take(*lower, upper.rotate_left(32));
    }
    taken
}

#[inline(always)]
fn end([lower, upper]: [[u64; WORDS]; 2], lengths: u64) -> u64 {
    let sixteen: [u64; 16] = half(&lower, &upper);
    let (lower, upper) = sixteen.split_at(8);
    let eight: [u64; 8] = half(lower, upper);
    let (lower, upper) = eight.split_at(4);
    let four: [u64; 4] = half(lower, upper);
    let [a, b, c, d] = four;
    let [a, b]: [u64; 2] = half(&[a, b], &[c, d]);
    let [h]: [u64; 1] = half(&[a], &[b]);
    mixed(mixed(h ^ lengths))
}

#[inline(always)]
fn mixed(h: u64) -> u64 {
    let h = h.wrapping_mul(MIX);
    h ^ h >> 32
}

/// The numbers of elements of the arenas in one word: reals, Ints, Bools.
#[inline(always)]
fn packed_lengths([reals, ints, bools]: [usize; 3]) -> u64 {
    reals as u64 | (ints as u64) << 21 | (bools as u64) << 42
}

/// The hash of three arenas, each in whole blocks; `lengths` are the numbers of their elements: reals, Ints, Bools.
#[inline]
pub fn hash(reals: &[HashedBlock], others: &[HashedBlock], lengths: [usize; 3]) -> u64 {
    let lengths = packed_lengths(lengths);
    with_wide_vectors(Blocks {
        reals,
        others,
        lengths,
    })
}

/// At most eight bytes as a word, the first in the lowest byte.
pub fn packed(bytes: &[u8]) -> u64 {
    let mut word = [0; 8];
    for (place, byte) in word.iter_mut().zip(bytes) {
        *place = *byte;
    }
    u64::from_le_bytes(word)
}

#[cfg(test)]
mod tests;
