//! A path clock as plain numbers, whole: for the flight recorder, which copies them, and for replay, which goes on from
//! them. Run by the real-time thread (no allocation, no failure) and by whoever replays.

use rcc_core::path::{PathLimits, PathState};

use super::PathClock;
use crate::profile::{PROFILE_WORDS, Profile};

/// Numbers that a clock consists of: limits and cycle time, plan, active motion, cycle, last state.
pub const CLOCK_WORDS: usize = 5 + 2 * PROFILE_WORDS + 1 + 4;

const ACTIVE: usize = 5 + PROFILE_WORDS;
const LAST: usize = ACTIVE + PROFILE_WORDS;

impl PathClock {
    /// Everything that the clock is, as words; two clocks with equal words go on equally.
    #[must_use]
    pub fn words(&self) -> [u64; CLOCK_WORDS] {
        let PathLimits {
            length,
            velocity,
            acceleration,
            jerk,
        } = self.limits;
        let head = [length, velocity, acceleration, jerk, self.dt_s];
        let last = [self.last.s, self.last.velocity, self.last.acceleration];
        let (plan, active) = (self.plan.numbers(), self.active.numbers());
        let numbers = head.iter().chain(&plan).chain(&active);
        let flags = u64::from(self.last.done) | u64::from(self.last.stopping) << 1;
        let bits = |number: &f64| number.to_bits();
        let words = numbers.map(bits).chain([self.cycle]);
        let words = words.chain(last.iter().map(bits)).chain([flags]);
        let mut all = [0; CLOCK_WORDS];
        for (place, word) in all.iter_mut().zip(words) {
            *place = word;
        }
        all
    }

    /// The clock that gave these [`PathClock::words`]. Other words give a clock of no use, which still cannot fail.
    #[must_use]
    pub fn from_words(words: &[u64; CLOCK_WORDS]) -> PathClock {
        let number = |index: usize| f64::from_bits(words[index]);
        let profile = |first: usize| {
            let mut numbers = [0.0; PROFILE_WORDS];
            for (place, word) in numbers.iter_mut().zip(words.iter().skip(first)) {
                *place = f64::from_bits(*word);
            }
            Profile::from_numbers(&numbers)
        };
        PathClock {
            limits: PathLimits {
                length: number(0),
                velocity: number(1),
                acceleration: number(2),
                jerk: number(3),
            },
            dt_s: number(4),
            plan: profile(5),
            active: profile(ACTIVE),
            cycle: words[LAST],
            last: PathState {
                s: number(LAST + 1),
                velocity: number(LAST + 2),
                acceleration: number(LAST + 3),
                done: words[LAST + 4] & 1 != 0,
                stopping: words[LAST + 4] & 2 != 0,
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: PathLimits = PathLimits {
        length: 0.3,
        velocity: 0.5,
        acceleration: 2.0,
        jerk: 20.0,
    };

    #[test]
    fn a_clock_goes_on_from_its_words_as_if_nothing_had_happened() {
        for stop_at in [50, 200, 10_000] {
            let mut clock = PathClock::new(LIMITS, 1e-3).unwrap();
            for cycle in 0..1000 {
                let mut copy = PathClock::from_words(&clock.words());
                assert_eq!(copy, clock, "cycle {cycle}");
                let stop = cycle >= stop_at;
                assert_eq!(copy.step(stop), clock.step(stop), "cycle {cycle}");
            }
        }
    }

    #[test]
    fn a_reset_clock_is_the_one_it_was_at_first() {
        let fresh = PathClock::new(LIMITS, 1e-3).unwrap();
        let mut used = fresh;
        for _ in 0..100 {
            used.step(false);
        }
        let mut copy = PathClock::from_words(&used.words());
        copy.reset();
        assert_eq!(copy.words(), fresh.words());
    }

    #[test]
    fn no_words_make_a_clock_that_fails() {
        for word in [0, u64::MAX, 0x7ff8_0000_0000_0000, 1] {
            let mut clock = PathClock::from_words(&[word; CLOCK_WORDS]);
            for step in 0..10 {
                clock.step(step > 5);
            }
        }
    }
}
