//! The checksum of incident files. Off the real-time thread.

const LANES: usize = 8;
const SEED: u64 = 0x243f_6a88_85a3_08d3;
const STEP: u64 = 0x9e37_79b9_7f4a_7c15;
const MIX: u64 = 0xff51_afd7_ed55_8ccd;

fn take(lane: u64, word: u64) -> u64 {
    (lane.rotate_left(29) ^ word).wrapping_mul(MIX)
}

/// A checksum of words. Eight lanes of 64 bits are initialized with `SEED + lane · STEP`. Word i goes to lane i mod 8:
/// `lane = (rotate_left(lane, 29) ^ word) · MIX`. Finally h starts as `2²¹ ·` the number of words; all lanes are taken
/// into h in order in the same way, and `h ^ (h >> 32)` is the checksum. Files that differ in one word never have the same
/// one.
#[derive(Clone, Copy, Debug)]
pub struct WordChecksum {
    lanes: [u64; LANES],
    count: u64,
}

impl Default for WordChecksum {
    fn default() -> WordChecksum {
        let mut lanes = [SEED; LANES];
        for (lane, number) in lanes.iter_mut().zip(0..) {
            *lane = lane.wrapping_add(STEP.wrapping_mul(number));
        }
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

    /// The checksum of all words so far.
    pub fn end(&self) -> u64 {
        let h = self.lanes.into_iter().fold(self.count << 21, take);
        h ^ h >> 32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checksum(words: &[u64]) -> u64 {
        let mut sum = WordChecksum::default();
        words.iter().for_each(|word| sum.take(*word));
        sum.end()
    }

    #[test]
    fn it_is_the_same_on_every_machine() {
        let words: Vec<u64> = (0..100).collect();
        assert_eq!(checksum(&words), 0xe511_8884_ed45_dbef);
    }

    #[test]
    fn one_changed_word_or_another_number_of_words_changes_it() {
        let mut words = vec![0.25f64.to_bits(); 100];
        let before = checksum(&words);
        assert_ne!(checksum(&words[..99]), before);
        for index in 0..words.len() {
            for bit in 0..64 {
                words[index] ^= 1 << bit;
                assert_ne!(checksum(&words), before);
                words[index] ^= 1 << bit;
            }
        }
    }
}
