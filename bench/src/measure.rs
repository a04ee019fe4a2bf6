//! Compares subjects by measuring them in turns, round after round, so that a temporary disturbance of the machine
//! affects all of them. Used by the programs that write reports; runs in the calling thread.

use std::time::{Duration, Instant};

/// Something that runs cycles.
pub struct MeasuredSubject<'a>(Box<dyn FnMut(usize) -> Duration + 'a>);

impl<'a> MeasuredSubject<'a> {
    /// Creates a subject that runs the given number of cycles; the duration of the call is measured.
    pub fn new(mut run: impl FnMut(usize) + 'a) -> MeasuredSubject<'a> {
        MeasuredSubject::timing_itself(move |cycles| {
            let begun = Instant::now();
            run(cycles);
            begun.elapsed()
        })
    }

    /// Creates a subject that runs the given number of cycles and returns their duration itself, without any overhead.
    pub fn timing_itself(run: impl FnMut(usize) -> Duration + 'a) -> MeasuredSubject<'a> {
        MeasuredSubject(Box::new(run))
    }

    /// Runs the given number of cycles and returns their duration.
    pub fn run(&mut self, cycles: usize) -> Duration {
        (self.0)(cycles)
    }
}

/// Duration of one cycle of a subject, ns: the median of its rounds, and the fastest and slowest round.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimeStats {
    /// Median of the rounds.
    pub median: f64,
    /// The fastest round.
    pub low: f64,
    /// The slowest round.
    pub high: f64,
}

/// The amount of measurement.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    /// Number of rounds; each measures every subject once.
    pub rounds: usize,
    /// Number of stretches per round; the round's result is their median.
    pub stretches: usize,
    /// Length of a stretch.
    pub stretch: Duration,
}

impl Effort {
    /// Five rounds of 15 stretches of a millisecond: short enough to fall between two disturbances.
    pub const USUAL: Effort = Effort {
        rounds: 5,
        stretches: 15,
        stretch: Duration::from_millis(1),
    };

    /// One stretch, to find out whether a program still runs; its figures mean nothing.
    pub const SHORT: Effort = Effort {
        rounds: 1,
        stretches: 1,
        stretch: Duration::from_micros(100),
    };
}

/// Measures all subjects in turns and returns the results in their order. Every stretch starts with warm caches.
pub fn alternate(subjects: &mut [MeasuredSubject<'_>], effort: Effort) -> Vec<TimeStats> {
    let cycles: Vec<usize> = subjects
        .iter_mut()
        .map(|subject| fitting_cycles(subject, effort.stretch))
        .collect();
    let mut rounds = vec![Vec::with_capacity(effort.rounds); subjects.len()];
    for _ in 0..effort.rounds {
        for ((subject, &cycles), rounds) in subjects.iter_mut().zip(&cycles).zip(&mut rounds) {
            (subject.0)(cycles.div_ceil(4));
            let stretches = (0..effort.stretches)
                .map(|_| (subject.0)(cycles).as_nanos() as f64 / cycles as f64);
            rounds.push(median(stretches.collect()));
        }
    }
    rounds.into_iter().map(figure).collect()
}

/// Returns the number of cycles that take about the wanted time.
fn fitting_cycles(subject: &mut MeasuredSubject<'_>, wanted: Duration) -> usize {
    let mut cycles = 1;
    loop {
        let took = (subject.0)(cycles);
        if took * 4 >= wanted || cycles >= 1 << 24 {
            let ratio = wanted.as_nanos() as f64 / took.as_nanos().max(1) as f64;
            return ((cycles as f64 * ratio) as usize).max(1);
        }
        cycles *= 2;
    }
}

/// Summarizes the rounds of a subject.
#[must_use]
pub fn figure(rounds: Vec<f64>) -> TimeStats {
    let low = rounds.iter().copied().fold(f64::INFINITY, f64::min);
    let high = rounds.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    TimeStats {
        median: median(rounds),
        low,
        high,
    }
}

/// Returns the median; NaN of an empty list.
#[must_use]
pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::RefCell;

    #[test]
    fn subjects_take_turns() {
        let turns = RefCell::new(String::new());
        let note = |letter| {
            let turns = &turns;
            move |_| {
                let mut turns = turns.borrow_mut();
                if !turns.ends_with(letter) {
                    turns.push(letter);
                }
            }
        };
        let mut subjects = [
            MeasuredSubject::new(note('a')),
            MeasuredSubject::new(note('b')),
        ];
        let effort = Effort {
            rounds: 3,
            stretches: 2,
            stretch: Duration::from_micros(1),
        };
        assert_eq!(alternate(&mut subjects, effort).len(), 2);
        drop(subjects);
        assert!(turns.into_inner().ends_with("ababab"));
    }

    #[test]
    fn a_summary_has_the_median_and_both_extremes() {
        let figure = figure(vec![5.0, 1.0, 9.0, 2.0, 3.0]);
        assert_eq!(
            figure,
            TimeStats {
                median: 3.0,
                low: 1.0,
                high: 9.0
            }
        );
    }
}
