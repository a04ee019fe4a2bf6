//! Connection quality, from the answers in a window of 100 cycles.
//! Pure; run by the clock thread. KUKA publishes no thresholds; all of them are our own.

/// The four ratings of a connection on a wire.
pub trait QualityScale: Copy + PartialOrd {
    /// From the worst to the best.
    const LEVELS: [Self; 4];
}

impl QualityScale for crate::fri_lwr::wire::Quality {
    const LEVELS: [Self; 4] = [Self::Unacceptable, Self::Bad, Self::Ok, Self::Perfect];
}

impl QualityScale for crate::fri_iiwa::wire::Quality {
    const LEVELS: [Self; 4] = [Self::Poor, Self::Fair, Self::Good, Self::Excellent];
}

/// Thresholds of the connection quality. All values are our own. The names are those of the LWR; an iiwa calls the same
/// ratings EXCELLENT, GOOD, FAIR and POOR.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct QualityThresholds {
    /// Smallest answered share of the last 100 cycles for PERFECT; mean delay + 2 × jitter must also be below half a
    /// period.
    pub perfect: f64,
    /// Smallest answered share for OK.
    pub ok: f64,
    /// Smallest answered share for BAD; below it the quality is UNACCEPTABLE.
    pub bad: f64,
    /// Cycles for which a better quality must last before it takes effect; a worse one takes effect at once.
    pub raise_cycles: u32,
}

impl Default for QualityThresholds {
    fn default() -> Self {
        Self {
            perfect: 0.99,
            ok: 0.95,
            bad: 0.80,
            raise_cycles: 50,
        }
    }
}

/// Length of the window, cycles.
pub const WINDOW: usize = 100;

/// The last [`WINDOW`] cycles and the present quality.
#[derive(Clone, Debug)]
pub struct QualityMeter<Q> {
    rules: QualityThresholds,
    period_s: f64,
    /// Delay of each answer, s; `None` is a miss. Cycles before the start count as misses.
    window: [Option<f64>; WINDOW],
    next: usize,
    quality: Q,
    better_for: u32,
    figures: QualityFigures,
}

/// Statistics of the window.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct QualityFigures {
    /// Number of answered cycles among the last [`WINDOW`].
    pub answered: usize,
    /// Mean delay of the answers, s.
    pub latency_s: f64,
    /// Standard deviation of that delay, s.
    pub jitter_s: f64,
}

impl<Q: QualityScale> QualityMeter<Q> {
    /// A connection without any answer yet.
    pub fn new(rules: QualityThresholds, period_s: f64) -> Self {
        Self {
            rules,
            period_s,
            window: [None; WINDOW],
            next: 0,
            quality: Q::LEVELS[0],
            better_for: 0,
            figures: QualityFigures::default(),
        }
    }

    /// Records one cycle: the delay of the answer in s, or a miss.
    pub fn record(&mut self, delay_s: Option<f64>) {
        self.window[self.next] = delay_s;
        self.next = (self.next + 1) % WINDOW;
        self.figures = figures(&self.window);
        let judged = self.judge();
        if judged <= self.quality {
            self.quality = judged;
            self.better_for = 0;
            return;
        }
        self.better_for += 1;
        if self.better_for >= self.rules.raise_cycles {
            self.quality = judged;
            self.better_for = 0;
        }
    }

    /// Returns the present quality.
    pub fn quality(&self) -> Q {
        self.quality
    }

    /// Returns the present statistics.
    pub fn figures(&self) -> QualityFigures {
        self.figures
    }

    fn judge(&self) -> Q {
        let [unacceptable, bad, ok, perfect] = Q::LEVELS;
        let rate = self.figures.answered as f64 / WINDOW as f64;
        let delay = self.figures.latency_s + 2.0 * self.figures.jitter_s;
        if rate >= self.rules.perfect && delay < 0.5 * self.period_s {
            perfect
        } else if rate >= self.rules.ok {
            ok
        } else if rate >= self.rules.bad {
            bad
        } else {
            unacceptable
        }
    }
}

fn figures(window: &[Option<f64>]) -> QualityFigures {
    let answered = window.iter().flatten().count();
    let count = answered.max(1) as f64;
    let latency_s = window.iter().flatten().sum::<f64>() / count;
    let variance = window
        .iter()
        .flatten()
        .map(|delay| (delay - latency_s).powi(2))
        .sum::<f64>()
        / count;
    QualityFigures {
        answered,
        latency_s,
        jitter_s: variance.sqrt(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fri_lwr::wire::Quality;
    use std::collections::BTreeSet;

    fn meter_after(answers: usize, delay_s: f64) -> QualityMeter<Quality> {
        let mut meter = QualityMeter::new(QualityThresholds::default(), 1e-3);
        for _ in 0..answers {
            meter.record(Some(delay_s));
        }
        meter
    }

    #[test]
    fn a_fresh_connection_is_unacceptable_and_rises_after_its_hold_time() {
        assert_eq!(meter_after(0, 0.0).quality(), Quality::Unacceptable);
        // 80 answers give BAD, which takes effect 50 cycles later; by then the window is full.
        assert_eq!(meter_after(128, 1e-4).quality(), Quality::Unacceptable);
        assert_eq!(meter_after(129, 1e-4).quality(), Quality::Perfect);
    }

    #[test]
    fn slow_answers_are_never_perfect() {
        assert_eq!(meter_after(500, 0.7e-3).quality(), Quality::Ok);
    }

    #[test]
    fn every_transition_of_the_rating_is_visited_and_no_other() {
        use Quality::{Bad, Ok, Perfect, Unacceptable};
        // Delay of the answers in periods, and how many of 20 come.
        let connections = [(0.1, 0), (0.1, 17), (0.7, 20), (0.1, 20)];
        let mut visited = BTreeSet::new();
        for (before, after) in connections
            .iter()
            .flat_map(|before| connections.iter().map(move |after| (before, after)))
        {
            let mut meter = QualityMeter::<Quality>::new(QualityThresholds::default(), 1.0);
            let mut last = meter.quality();
            for (delay, of_20) in [before, after] {
                for cycle in 0..400 {
                    meter.record((cycle % 20 < *of_20).then_some(*delay));
                    if meter.quality() != last {
                        visited.insert((last as u16, meter.quality() as u16));
                        last = meter.quality();
                    }
                }
            }
        }
        // Upward any number of steps, after the hold time; downward one, because one cycle is a hundredth of the window.
        let possible = [
            (Unacceptable, Bad),
            (Unacceptable, Ok),
            (Unacceptable, Perfect),
            (Bad, Ok),
            (Bad, Perfect),
            (Ok, Perfect),
            (Perfect, Ok),
            (Ok, Bad),
            (Bad, Unacceptable),
        ];
        let possible = possible.map(|(from, to)| (from as u16, to as u16));
        assert_eq!(visited, possible.into_iter().collect());
    }

    #[test]
    fn misses_lower_the_quality_at_once() {
        let mut meter = meter_after(300, 1e-4);
        meter.record(None);
        assert_eq!(meter.quality(), Quality::Perfect);
        meter.record(None);
        assert_eq!(meter.quality(), Quality::Ok);
        (0..4).for_each(|_| meter.record(None));
        assert_eq!(meter.quality(), Quality::Bad);
        (0..15).for_each(|_| meter.record(None));
        assert_eq!(meter.quality(), Quality::Unacceptable);
    }
}
