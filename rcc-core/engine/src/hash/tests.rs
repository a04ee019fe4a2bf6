use super::*;

type Words = Vec<u64>;

/// The definition, word by word.
fn defined(reals: &[f64], bools: &[u8], ints: &[i64]) -> u64 {
    let step = |lane: u64, word: u64| {
        let x = lane ^ word;
        let x = x ^ (x >> 32);
        let (low, high) = (x & 0xffff_ffff, x >> 32);
        (low.wrapping_mul(FACTOR).wrapping_add(high << 32)).rotate_left(32)
    };
    let mut lanes: Words = (0..32)
        .map(|i| SEED.wrapping_add(STEP.wrapping_mul(i)))
        .collect();
    let null_or = |value: &f64| match value.is_nan() {
        true => NULL,
        false => value.to_bits(),
    };
    let real_words: Words = reals.iter().map(null_or).collect();
    let int_words: Words = ints.iter().map(|value| *value as u64).collect();
    let bool_words: Words = bools.chunks(8).map(packed).collect();
    let padded = |mut words: Words| {
        words.resize(words.len().next_multiple_of(16), 0);
        words
    };
    let behind_reals = [padded(int_words), padded(bool_words)].concat();
    for words in [padded(real_words), behind_reals] {
        for (index, word) in words.into_iter().enumerate() {
            lanes[index % 32] = step(lanes[index % 32], word);
        }
    }
    while lanes.len() > 1 {
        let upper = lanes.split_off(lanes.len() / 2);
        let pairs = lanes.iter().zip(upper);
        lanes = pairs
            .map(|(lower, upper)| step(*lower, upper.rotate_left(32)))
            .collect();
    }
    let lengths =
        reals.len() as u64 + (ints.len() as u64) * (1 << 21) + (bools.len() as u64) * (1 << 42);
    let mut h = lanes[0] ^ lengths;
    for _ in 0..2 {
        h = h.wrapping_mul(MIX);
        h ^= h >> 32;
    }
    h
}

fn blocks(words: impl Iterator<Item = u64>) -> Vec<HashedBlock> {
    let words: Words = words.collect();
    let block = |words: &[u64]| {
        let mut block = HashedBlock::zeroed();
        block.0[..words.len()].copy_from_slice(words);
        block
    };
    words.chunks(WORDS).map(block).collect()
}

fn parts(
    reals: &[f64],
    bools: &[u8],
    ints: &[i64],
) -> (Vec<HashedBlock>, Vec<HashedBlock>, [usize; 3]) {
    let mut others = blocks(ints.iter().map(|value| value.cast_unsigned()));
    others.extend(blocks(bools.chunks(8).map(packed)));
    let lengths = [reals.len(), ints.len(), bools.len()];
    (
        blocks(reals.iter().map(|value| value.to_bits())),
        others,
        lengths,
    )
}

fn hash_of(reals: &[f64], bools: &[u8], ints: &[i64]) -> u64 {
    let (reals, others, lengths) = parts(reals, bools, ints);
    hash(&reals, &others, lengths)
}

/// Calls `each` with arenas of every length below `lengths`: of one type only, and of all three.
fn each_length(lengths: u32, each: impl Fn(&[f64], &[u8], &[i64])) {
    for count in 0..lengths {
        let real = |i| match i % 5 {
            3 => f64::NAN,
            _ => f64::from(i) / 3.0,
        };
        let reals: Vec<f64> = (0..count).map(real).collect();
        let bools: Vec<u8> = (0..count).map(|i| (i % 3) as u8).collect();
        let ints: Vec<i64> = (0..count).map(|i| i64::from(i) - 7).collect();
        each(&reals, &[], &[]);
        each(&[], &bools, &[]);
        each(&[], &[], &ints);
        each(&reals, &bools, &ints);
    }
}

#[test]
fn it_is_as_defined_for_every_length_with_and_without_wide_vectors() {
    each_length(140, |reals, bools, ints| {
        let wanted = defined(reals, bools, ints);
        let lengths = [reals.len(), ints.len(), bools.len()];
        assert_eq!(hash_of(reals, bools, ints), wanted, "{lengths:?}");
        let (real_blocks, others, _) = parts(reals, bools, ints);
        let plain = Blocks {
            reals: &real_blocks,
            others: &others,
            lengths: packed_lengths(lengths),
        };
        assert_eq!(plain.run(), wanted, "{lengths:?}");
    });
}

#[test]
fn it_is_the_same_on_every_machine() {
    assert_eq!(
        hash_of(&[1.0, f64::NAN, -0.0], &[0, 1, 2], &[i64::MIN, 7]),
        0xf75c_23ac_b345_2351
    );
}

#[test]
fn every_nan_is_null_and_minus_zero_is_not_zero() {
    let other = f64::from_bits(0xfff8_0000_dead_beef);
    assert_eq!(hash_of(&[f64::NAN], &[], &[]), hash_of(&[other], &[], &[]));
    assert_ne!(hash_of(&[0.0], &[], &[]), hash_of(&[-0.0], &[], &[]));
    assert_ne!(
        hash_of(&[f64::INFINITY], &[], &[]),
        hash_of(&[f64::NAN], &[], &[])
    );
}

#[test]
fn one_changed_slot_changes_it() {
    let mut reals = vec![0.25; 100];
    let before = hash_of(&reals, &[], &[]);
    for index in 0..100 {
        for bit in 0..64 {
            let value = reals[index];
            reals[index] = f64::from_bits(value.to_bits() ^ 1 << bit);
            assert_ne!(hash_of(&reals, &[], &[]), before);
            reals[index] = value;
        }
    }
}

/// Two slots that change in the ways of numbers: sign, a digit, a factor of two, null, one for the other.
#[test]
fn two_changed_slots_change_it() {
    let reals: Vec<f64> = (0..120).map(|i| f64::from(i) * 0.37 - 20.0).collect();
    let changes: [fn(f64) -> f64; 6] = [
        |x| -x,
        |x| 2.0 * x,
        |x| x + 1.0,
        |_| f64::NAN,
        |_| 0.0,
        |x| f64::from_bits(x.to_bits() ^ 1),
    ];
    let mut seen = std::collections::BTreeSet::new();
    let mut states = 1;
    seen.insert(hash_of(&reals, &[], &[]));
    for first in 0..reals.len() {
        for second in first + 1..reals.len() {
            let mut changed = reals.clone();
            changed.swap(first, second);
            seen.insert(hash_of(&changed, &[], &[]));
            for change in changes {
                for index in [first, second] {
                    changed[index] = change(reals[index]);
                }
                seen.insert(hash_of(&changed, &[], &[]));
            }
            states += 1 + changes.len();
        }
    }
    // No two of the states are the same, and no two of their hashes.
    assert_eq!(seen.len(), states);
}
