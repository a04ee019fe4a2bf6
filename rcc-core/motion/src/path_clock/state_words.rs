//! The variable state of a path clock as plain words: the flight recorder copies it, replay resumes from it. Run by the
//! real-time thread (no allocation, no failure) and by replay.

use rcc_core::path::PathState;

use super::{ClockCommand, MotionEnd, PathClock, PlannedMotion};
use crate::jerk_profile::{JerkProfile, PROFILE_WORDS};

/// Number of words of a clock's state: the current motion, its end, the command, times and flags, the last state.
pub const CLOCK_WORDS: usize = PROFILE_WORDS + 4 + 3 + 4;

const ENDS: usize = PROFILE_WORDS;
const TIMES: usize = ENDS + 4;
const LAST: usize = TIMES + 3;

impl PathClock {
    /// The variable state as words; two clocks with equal words and equal bounds continue equally.
    #[must_use]
    pub fn words(&self) -> [u64; CLOCK_WORDS] {
        let (end, s, velocity) = match self.planned.end {
            MotionEnd::Rest => (0, 0.0, 0.0),
            MotionEnd::PieceEnd { s, velocity } => (1, s, velocity),
            MotionEnd::Passing => (2, 0.0, 0.0),
        };
        let (command, speed) = match self.command {
            ClockCommand::None => (0, 0.0),
            ClockCommand::Run(speed) => (1, speed),
            ClockCommand::Pause => (2, 0.0),
            ClockCommand::Stop => (3, 0.0),
        };
        let done = u64::from(self.last.done) | u64::from(self.last.stopping) << 1;
        let flags = done | end << 2 | command << 4;
        let last = [
            self.last.s,
            self.last.velocity,
            self.last.acceleration,
            self.last.jerk,
        ];
        let numbers = self.planned.profile.numbers();
        let numbers = numbers
            .into_iter()
            .chain([self.planned.until_s, s, velocity, speed, self.offset_s])
            .map(f64::to_bits);
        let words = numbers
            .chain([self.cycle, flags])
            .chain(last.map(f64::to_bits));
        let mut all = [0; CLOCK_WORDS];
        for (place, word) in all.iter_mut().zip(words) {
            *place = word;
        }
        all
    }

    /// Restores a clock from [`PathClock::words`]. Other words give a meaningless clock, which still cannot fail.
    #[must_use]
    pub fn from_words(words: &[u64; CLOCK_WORDS]) -> PathClock {
        let number = |index: usize| f64::from_bits(words[index]);
        let mut numbers = [0.0; PROFILE_WORDS];
        for (place, word) in numbers.iter_mut().zip(words) {
            *place = f64::from_bits(*word);
        }
        let (cycle, flags) = (words[TIMES + 1], words[TIMES + 2]);
        PathClock {
            command: match flags >> 4 & 3 {
                0 => ClockCommand::None,
                1 => ClockCommand::Run(number(ENDS + 3)),
                2 => ClockCommand::Pause,
                _ => ClockCommand::Stop,
            },
            planned: PlannedMotion {
                profile: JerkProfile::from_numbers(&numbers),
                end: match flags >> 2 & 3 {
                    1 => MotionEnd::PieceEnd {
                        s: number(ENDS + 1),
                        velocity: number(ENDS + 2),
                    },
                    2 => MotionEnd::Passing,
                    _ => MotionEnd::Rest,
                },
                until_s: number(ENDS),
            },
            offset_s: number(TIMES),
            cycle,
            last: PathState {
                s: number(LAST),
                velocity: number(LAST + 1),
                acceleration: number(LAST + 2),
                jerk: number(LAST + 3),
                done: flags & 1 != 0,
                stopping: flags & 2 != 0,
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{RUN, STOP, line, stairs};
    use super::*;

    #[test]
    fn a_clock_continues_from_its_words_without_a_difference() {
        for bounds in [line(), stairs()] {
            for stop_at in [50, 200, 10_000] {
                let mut clock = PathClock::new();
                for cycle in 0..3000 {
                    let mut copy = PathClock::from_words(&clock.words());
                    assert_eq!(copy, clock, "cycle {cycle}");
                    let speed_override = if cycle >= stop_at { STOP } else { RUN };
                    assert_eq!(
                        copy.step(&bounds, speed_override),
                        clock.step(&bounds, speed_override),
                        "cycle {cycle}"
                    );
                }
            }
        }
    }

    #[test]
    fn a_reset_clock_is_the_one_it_was_at_first() {
        let mut used = PathClock::new();
        for _ in 0..100 {
            used.step(&line(), RUN);
        }
        used.reset();
        assert_eq!(used.words(), PathClock::new().words());
    }

    #[test]
    fn a_clock_from_arbitrary_words_cannot_fail() {
        for word in [0, u64::MAX, 0x7ff8_0000_0000_0000, 1, 0x3ff0_0000_0000_0010] {
            let mut clock = PathClock::from_words(&[word; CLOCK_WORDS]);
            for step in 0..10 {
                clock.step(&stairs(), if step > 5 { STOP } else { RUN });
            }
        }
    }
}
