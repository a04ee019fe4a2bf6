//! A ring of words that keeps the newest records in preallocated memory and overwrites the oldest. Written by the
//! real-time thread; read by the thread that writes incident files, after it was handed over.

/// Greatest size of a ring, words: 2 GB.
pub const WORDS_MAX: usize = 1 << 28;
/// Smallest size of a ring, words; less would not hold a cycle.
pub const WORDS_MIN: usize = 1 << 12;

/// Records of the last cycles.
#[derive(Debug)]
pub struct RecordRing {
    words: Box<[u64]>,
    /// Index of the next word.
    place: usize,
    /// Words written since the ring was cleared.
    written: u64,
    /// Ring of the values of `written` at the beginning of each cycle.
    starts: Box<[u64]>,
    /// Cycles begun since the ring was cleared.
    cycles: u64,
}

impl RecordRing {
    /// A ring of `words` words that remembers at most `cycles` cycles; both are limited to the possible range. Touches
    /// all of its memory. Not for the real-time thread.
    pub fn new(words: usize, cycles: usize) -> Box<RecordRing> {
        // Filled with ones, so that the system maps the pages now and not at the first write.
        Box::new(RecordRing {
            words: vec![u64::MAX; words.clamp(WORDS_MIN, WORDS_MAX)].into(),
            place: 0,
            written: 0,
            starts: vec![u64::MAX; cycles.clamp(1, WORDS_MAX)].into(),
            cycles: 0,
        })
    }

    /// Capacity in words.
    pub fn capacity(&self) -> usize {
        self.words.len()
    }

    /// Greatest number of cycles that it contains.
    pub fn cycles_max(&self) -> usize {
        self.starts.len()
    }

    /// Words written since it was cleared.
    pub fn written(&self) -> u64 {
        self.written
    }

    /// Discards everything; the memory stays allocated.
    pub fn clear(&mut self) {
        (self.place, self.written, self.cycles) = (0, 0, 0);
    }

    /// Begins the next cycle.
    pub fn begin_cycle(&mut self) {
        let count = self.starts.len() as u64;
        let index = self.cycles.checked_rem(count).unwrap_or(0) as usize;
        if let Some(start) = self.starts.get_mut(index) {
            *start = self.written;
        }
        self.cycles += 1;
    }

    /// Appends words and overwrites the oldest. Returns false and writes nothing if there are more than the ring can
    /// hold.
    #[inline]
    pub fn push(&mut self, words: &[u64]) -> bool {
        let room = self.words.len() - self.place;
        if words.len() < room {
            if let Some(place) = self.words.get_mut(self.place..self.place + words.len()) {
                place.copy_from_slice(words);
            }
            self.place += words.len();
        } else if words.len() > self.words.len() {
            return false;
        } else {
            let (first, second) = words.split_at(room);
            if let Some(place) = self.words.get_mut(self.place..) {
                place.copy_from_slice(first);
            }
            if let Some(place) = self.words.get_mut(..second.len()) {
                place.copy_from_slice(second);
            }
            self.place = second.len();
        }
        self.written += words.len() as u64;
        true
    }

    /// The records of the oldest complete cycle and all later ones, in order, in two slices.
    pub fn newest(&self) -> [&[u64]; 2] {
        let Some(start) = self.oldest() else {
            return [&[], &[]];
        };
        let length = (self.written - start) as usize;
        match self.place.checked_sub(length) {
            Some(from) => [&self.words[from..self.place], &[]],
            None => [
                &self.words[self.words.len() - (length - self.place)..],
                &self.words[..self.place],
            ],
        }
    }

    /// Value of `written` at the beginning of the oldest complete cycle.
    fn oldest(&self) -> Option<u64> {
        let remembered = self.cycles.min(self.starts.len() as u64);
        (self.cycles - remembered..self.cycles)
            .map(|cycle| self.starts[(cycle % self.starts.len() as u64) as usize])
            .find(|start| self.written - start <= self.words.len() as u64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(ring: &RecordRing) -> Vec<u64> {
        ring.newest().concat()
    }

    #[test]
    fn an_overfull_ring_keeps_the_newest_whole_cycles() {
        let mut ring = RecordRing::new(WORDS_MIN, 10_000);
        let mut next = 0;
        for cycle in 0..5000 {
            ring.begin_cycle();
            for _ in 0..=cycle % 13 {
                assert!(ring.push(&[next]));
                next += 1;
            }
            let kept = all(&ring);
            assert_eq!(kept.last(), Some(&(next - 1)));
            assert!(kept.windows(2).all(|pair| pair[1] == pair[0] + 1));
            assert!(
                next < WORDS_MIN as u64 || kept.len() + 13 > WORDS_MIN,
                "{}",
                kept.len()
            );
        }
    }

    #[test]
    fn it_remembers_at_most_so_many_cycles() {
        let mut ring = RecordRing::new(WORDS_MIN, 3);
        for cycle in 0..10 {
            ring.begin_cycle();
            ring.push(&[cycle, cycle]);
        }
        assert_eq!(all(&ring), [7, 7, 8, 8, 9, 9]);
    }

    #[test]
    fn long_records_wrap_and_too_long_ones_are_refused() {
        let mut ring = RecordRing::new(WORDS_MIN, 100);
        let long: Vec<u64> = (0..3000).collect();
        for _ in 0..5 {
            ring.begin_cycle();
            assert!(ring.push(&long));
            assert_eq!(all(&ring), long);
        }
        assert!(!ring.push(&vec![0; WORDS_MIN + 1]));
        assert_eq!(all(&ring), long);
    }

    #[test]
    fn a_cleared_ring_is_empty() {
        let mut ring = RecordRing::new(WORDS_MIN, 100);
        ring.begin_cycle();
        ring.push(&[1]);
        ring.clear();
        assert!(all(&ring).is_empty());
        ring.begin_cycle();
        ring.push(&[2]);
        assert_eq!(all(&ring), [2]);
    }
}
