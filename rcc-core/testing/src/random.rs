//! Random numbers, reproducible from a seed: distributions over [`Rng`], or over a generator whose sequence must never
//! change. Any thread.

pub use fastrand::Rng;
use rcc_core::path::SpeedOverride;

/// Distributions over random bits.
pub trait Random {
    /// Returns 64 random bits.
    fn bits(&mut self) -> u64;

    /// Returns a number in [0, 1).
    fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Returns a number in [low, high).
    fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Returns a number in [low, high) whose logarithm is uniformly distributed; both must be positive.
    fn log_uniform(&mut self, low: f64, high: f64) -> f64 {
        (low.ln() + self.unit() * (high / low).ln()).exp()
    }

    /// Returns a number less than `bound`; 0 if `bound` is 0.
    fn below(&mut self, bound: usize) -> usize {
        (self.unit() * bound as f64) as usize
    }

    /// Returns true once in `times` calls on average.
    fn once_in(&mut self, times: usize) -> bool {
        self.below(times) == 0
    }

    /// Returns one of several values; `None` if there is none.
    fn pick<'a, T>(&mut self, from: &'a [T]) -> Option<&'a T> {
        from.get(self.below(from.len()))
    }

    /// Returns a pause, full speed, or any other speed.
    fn speed_override(&mut self) -> SpeedOverride {
        let at = |speed| SpeedOverride {
            speed,
            ..SpeedOverride::RUN
        };
        match self.below(12) {
            0..3 => SpeedOverride::PAUSE,
            3 => at(0.0),
            4..7 => SpeedOverride::RUN,
            7 => at(self.log_uniform(1e-3, 1.0)),
            _ => at(self.unit()),
        }
    }
}

impl Random for Rng {
    fn bits(&mut self) -> u64 {
        self.u64(..)
    }
}
