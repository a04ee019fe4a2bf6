//! Connection quality, from the answers in a window of 100 cycles.
//! Pure; run by the clock thread. KUKA publishes no thresholds; all of them are our own.

use super::settings::QualityThresholds;
use crate::fri_lwr::wire::Quality;

/// Length of the window, cycles.
pub const WINDOW: usize = 100;

/// The last [`WINDOW`] cycles and the present quality.
#[derive(Clone, Debug)]
pub struct QualityMeter {
    rules: QualityThresholds,
    period_s: f64,
    /// Delay of each answer, s; `None` is a miss. Cycles before the start count as misses.
    window: [Option<f64>; WINDOW],
    next: usize,
    quality: Quality,
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

impl QualityMeter {
    /// A connection without any answer yet.
    pub fn new(rules: QualityThresholds, period_s: f64) -> Self {
        Self {
            rules,
            period_s,
            window: [None; WINDOW],
            next: 0,
            quality: Quality::Unacceptable,
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
    pub fn quality(&self) -> Quality {
        self.quality
    }

    /// Returns the present statistics.
    pub fn figures(&self) -> QualityFigures {
        self.figures
    }

    fn judge(&self) -> Quality {
        let rate = self.figures.answered as f64 / WINDOW as f64;
        let delay = self.figures.latency_s + 2.0 * self.figures.jitter_s;
        if rate >= self.rules.perfect && delay < 0.5 * self.period_s {
            Quality::Perfect
        } else if rate >= self.rules.ok {
            Quality::Ok
        } else if rate >= self.rules.bad {
            Quality::Bad
        } else {
            Quality::Unacceptable
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

    fn meter_after(answers: usize, delay_s: f64) -> QualityMeter {
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
