//! Which frames have been sent to the program, and which of them it has answered. Pure; used by the threads of the
//! program's lines.
//!
//! An answer names its frame, so that it says exactly how far the program is. A line that is refused does not: it is
//! taken for the answer to the oldest frame that has none, so that a program whose answer is invalid is asked again, and the
//! next answer corrects what was assumed.

use std::collections::VecDeque;
use std::time::Instant;

/// Number of newest frames whose times are kept: more than await their answers, unless the program writes this number of
/// wrong lines while it works on one frame.
const TIMES_MAX: usize = 64;

/// The frames that were sent to one life of the program; numbers start at 1.
#[derive(Debug, Default)]
pub struct SentFrames {
    /// When the newest frames were sent, oldest first.
    times: VecDeque<Instant>,
    /// Number of the newest frame; 0: none was sent.
    newest: u64,
    /// Number of the newest frame that was answered by its number.
    answered: u64,
    /// The same, with the frames whose answers are assumed to be lines that were refused.
    assumed: u64,
}

impl SentFrames {
    /// Adds a frame that is sent now; returns its number.
    pub fn push(&mut self, now: Instant) -> u64 {
        if self.times.len() == TIMES_MAX {
            self.times.pop_front();
        }
        self.times.push_back(now);
        self.newest += 1;
        self.newest
    }

    /// Takes an answer to this frame, and with it to all older ones. Returns when the frame was sent; `None` if it was
    /// not, if it or a newer one was answered before, or if its time is not kept any more.
    pub fn answer(&mut self, number: u64) -> Option<Instant> {
        if number <= self.answered || number > self.newest {
            return None;
        }
        (self.answered, self.assumed) = (number, number);
        let behind = usize::try_from(self.newest - number).ok()?;
        let place = self.times.len().checked_sub(behind + 1)?;
        self.times.get(place).copied()
    }

    /// Takes a line that was refused.
    pub fn refuse(&mut self) {
        self.assumed = self.newest.min(self.assumed + 1);
    }

    /// Returns true if the newest frame is answered, or assumed to be.
    pub fn all_answered(&self) -> bool {
        self.assumed == self.newest
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    /// Times of the frames 1 to `count`, which are sent a second apart.
    fn sent(frames: &mut SentFrames, count: u32) -> Vec<Instant> {
        let start = Instant::now();
        let times: Vec<_> = (0..count)
            .map(|second| start + Duration::from_secs(second.into()))
            .collect();
        for (time, number) in times.iter().zip(1..) {
            assert_eq!(frames.push(*time), number);
        }
        times
    }

    #[test]
    fn an_answer_has_the_age_of_its_own_frame_and_is_taken_once() {
        let mut frames = SentFrames::default();
        assert_eq!((frames.answer(0), frames.answer(1)), (None, None));
        let times = sent(&mut frames, 3);
        assert_eq!(frames.answer(2), Some(times[1]));
        assert!(!frames.all_answered());
        assert_eq!(
            [2, 1, 0, 4].map(|number| frames.answer(number)),
            [None; 4],
            "answered before, or never sent"
        );
        assert!(!frames.all_answered());
        assert_eq!(frames.answer(3), Some(times[2]));
        assert!(frames.all_answered());
    }

    #[test]
    fn a_refused_line_lets_one_frame_out_until_an_answer_says_how_far_the_program_is() {
        let mut frames = SentFrames::default();
        frames.refuse();
        let times = sent(&mut frames, 1);
        assert!(!frames.all_answered(), "a line before the first frame");
        frames.refuse();
        assert!(frames.all_answered());
        let second = times[0] + Duration::from_secs(1);
        assert_eq!(frames.push(second), 2);
        assert_eq!(frames.answer(1), Some(times[0]));
        assert!(!frames.all_answered(), "the second one is outstanding");
        assert_eq!(frames.answer(2), Some(second));
        assert!(frames.all_answered());
    }

    #[test]
    fn a_program_that_answers_with_wrong_lines_only_is_asked_again_each_time() {
        let mut frames = SentFrames::default();
        let start = Instant::now();
        for _ in 0..2 * TIMES_MAX {
            frames.push(start);
            assert!(!frames.all_answered());
            frames.refuse();
            assert!(frames.all_answered());
        }
        let newest = frames.push(start);
        assert_eq!(frames.answer(newest), Some(start));
    }

    #[test]
    fn wrong_lines_beside_the_answers_do_not_let_frames_pile_up() {
        let mut frames = SentFrames::default();
        let start = Instant::now();
        // Five wrong lines while the program works on each frame; each may let one out.
        for number in 1..=1000 {
            for _ in 0..5 {
                if frames.all_answered() {
                    frames.push(start);
                }
                frames.refuse();
            }
            assert!(frames.newest <= number + 5, "{frames:?}");
            assert_eq!(frames.answer(number), Some(start));
        }
        // They end: after the frames that are outstanding there is one at a time again.
        for number in 1001..=frames.newest {
            assert!(!frames.all_answered());
            assert_eq!(frames.answer(number), Some(start));
        }
        assert!(frames.all_answered());
    }

    #[test]
    fn a_frame_whose_time_is_forgotten_says_how_far_the_program_is_nevertheless() {
        let mut frames = SentFrames::default();
        let times = sent(&mut frames, 100);
        assert_eq!(frames.answer(100 - 64), None);
        frames.refuse();
        assert!(!frames.all_answered());
        assert_eq!(frames.answer(100 - 63), Some(times[36]));
    }
}
