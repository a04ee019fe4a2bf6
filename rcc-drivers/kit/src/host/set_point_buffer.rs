//! Ring buffer of an executor's set-points, without gaps up to the newest.
//! Pure; run by the host's thread, which updates it often enough to miss none.

use rcc_core::message::{CommandImage, MAGIC, SET_POINTS, SetPoint};

/// Capacity in set-points: how far a device may fall behind before it must stop.
pub const BUFFER_LENGTH: usize = SET_POINTS;

/// Largest valid cycle number: 285 years at 1 µs. An image with a larger number is ignored.
const SEQUENCE_MAX: u64 = 1 << 53;
/// Longest executor period that a cell's configuration allows, ns.
const PERIOD_MAX_NS: u64 = 1_000_000_000;

/// Result of reading the command board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BufferUpdate {
    /// No new set-points.
    None,
    /// Further set-points of the same executor; some between the last and these may be missing.
    Continued,
    /// First set-points of another executor: the buffer was cleared.
    NewExecutor,
}

/// The newest set-points of one executor, indexed by cycle number.
#[derive(Clone, Debug)]
pub struct SetPointBuffer {
    /// [`BUFFER_LENGTH`] of them, on the heap: a session is moved through stacks of 2 MiB.
    entries: Box<[SetPoint]>,
    /// Incarnation of the executor; 0 = none yet.
    executor: u64,
    /// Cycles `oldest..=newest` are buffered; none if `newest` is 0.
    oldest: u64,
    newest: u64,
    stamp_ns: u64,
    period_ns: u64,
}

impl Default for SetPointBuffer {
    fn default() -> Self {
        Self {
            entries: vec![SetPoint::NONE; BUFFER_LENGTH].into(),
            executor: 0,
            oldest: 1,
            newest: 0,
            stamp_ns: 0,
            period_ns: 1,
        }
    }
}

impl SetPointBuffer {
    /// Copies the new set-points. Ignores an image that has not been written yet, or whose numbers no executor can
    /// produce.
    pub fn update(&mut self, image: &CommandImage) -> BufferUpdate {
        if image.head.magic != MAGIC
            || !(1..=SEQUENCE_MAX).contains(&image.head.sequence)
            || !(1..=PERIOD_MAX_NS).contains(&image.head.period_ns)
            || image.head.executor == 0
        {
            return BufferUpdate::None;
        }
        let other = image.head.executor != self.executor;
        if !other && image.head.sequence <= self.newest {
            return BufferUpdate::None;
        }
        let ring_oldest = image
            .head
            .sequence
            .saturating_sub(SET_POINTS as u64 - 1)
            .max(1);
        let first = if other {
            ring_oldest
        } else {
            ring_oldest.max(self.newest + 1)
        };
        if other || first > self.newest + 1 {
            self.oldest = first;
        }
        for sequence in first..=image.head.sequence {
            match (self.entries.get_mut(index(sequence)), image.at(sequence)) {
                (Some(place), Some(entry)) => *place = *entry,
                _ => self.oldest = sequence + 1,
            }
        }
        self.newest = image.head.sequence;
        self.oldest = self
            .oldest
            .max((self.newest + 1).saturating_sub(BUFFER_LENGTH as u64));
        self.executor = image.head.executor;
        self.stamp_ns = image.head.stamp_ns;
        self.period_ns = image.head.period_ns;
        if other {
            BufferUpdate::NewExecutor
        } else {
            BufferUpdate::Continued
        }
    }

    /// Returns the set-point of cycle `sequence`, if it is buffered.
    #[must_use]
    pub fn at(&self, sequence: u64) -> Option<&SetPoint> {
        (self.oldest..=self.newest)
            .contains(&sequence)
            .then(|| self.entries.get(index(sequence)))
            .flatten()
    }

    /// Returns the set-point of cycle `sequence`, if it is buffered and commands the joints.
    #[must_use]
    pub fn commanded(&self, sequence: u64) -> Option<&SetPoint> {
        self.at(sequence).filter(|entry| commands_joints(entry))
    }

    /// Returns the number of the newest cycle; 0 = none.
    #[must_use]
    pub fn newest(&self) -> u64 {
        self.newest
    }

    /// Returns the number of the oldest buffered cycle.
    #[must_use]
    pub fn oldest(&self) -> u64 {
        self.oldest
    }

    /// Returns the executor's incarnation; 0 = none yet.
    #[must_use]
    pub fn executor(&self) -> u64 {
        self.executor
    }

    /// Returns the CLOCK_MONOTONIC time at which the newest set-point was written, ns.
    #[must_use]
    pub fn stamp_ns(&self) -> u64 {
        self.stamp_ns
    }

    /// Returns the executor's period, ns; greater than 0.
    #[must_use]
    pub fn period_ns(&self) -> u64 {
        self.period_ns
    }
}

/// Returns true if the set-point has a position and an owner.
#[must_use]
pub fn commands_joints(entry: &SetPoint) -> bool {
    entry.has_position == 1 && entry.owner != 0
}

fn index(sequence: u64) -> usize {
    // Less than BUFFER_LENGTH.
    (sequence % BUFFER_LENGTH as u64) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(executor: u64, sequence: u64) -> CommandImage {
        let mut image = CommandImage::new(executor, 1);
        for entry in 1..=sequence {
            image.push(entry, entry, SetPoint::NONE);
        }
        image
    }

    fn buffered(buffer: &SetPointBuffer) -> Vec<u64> {
        (0..500)
            .filter_map(|sequence| buffer.at(sequence).map(|entry| entry.logical_ns))
            .collect()
    }

    #[test]
    fn buffers_as_many_as_a_driver_may_fall_behind() {
        let mut buffer = SetPointBuffer::default();
        for sequence in [5, 14, 240, 250, 400] {
            buffer.update(&image(1, sequence));
        }
        assert_eq!(buffered(&buffer), (145..=400).collect::<Vec<_>>());
    }

    #[test]
    fn set_points_before_a_gap_are_dropped() {
        let mut buffer = SetPointBuffer::default();
        buffer.update(&image(1, 16));
        assert_eq!(buffer.update(&image(1, 273)), BufferUpdate::Continued);
        assert_eq!(buffered(&buffer), (18..=273).collect::<Vec<_>>());
    }

    #[test]
    fn a_missing_set_point_is_a_gap() {
        let mut buffer = SetPointBuffer::default();
        let mut image = image(1, 20);
        image.set_points[12].logical_ns = 0;
        buffer.update(&image);
        assert_eq!(buffered(&buffer), (13..=20).collect::<Vec<_>>());
    }

    #[test]
    fn another_executor_clears_the_buffer() {
        let mut buffer = SetPointBuffer::default();
        assert_eq!(buffer.update(&image(1, 40)), BufferUpdate::NewExecutor);
        assert_eq!(buffer.update(&image(1, 40)), BufferUpdate::None);
        assert_eq!(buffer.update(&image(2, 3)), BufferUpdate::NewExecutor);
        assert_eq!((buffered(&buffer), buffer.executor()), (vec![1, 2, 3], 2));
    }

    #[test]
    fn an_image_with_impossible_numbers_is_ignored() {
        let mut buffer = SetPointBuffer::default();
        buffer.update(&image(1, 20));
        let before = buffered(&buffer);
        let (mut far, mut slow) = (image(1, 21), image(1, 21));
        far.head.sequence = u64::MAX;
        slow.head.period_ns = u64::MAX;
        for hostile in [far, slow] {
            assert_eq!(buffer.update(&hostile), BufferUpdate::None);
        }
        assert_eq!(buffered(&buffer), before);
    }

    #[test]
    fn an_unwritten_board_is_ignored() {
        let mut buffer = SetPointBuffer::default();
        let mut unwritten = image(1, 3);
        unwritten.head.magic = 0;
        assert_eq!(buffer.update(&unwritten), BufferUpdate::None);
        assert_eq!(buffered(&buffer), Vec::<u64>::new());
    }
}
