//! Random numbers from a seed, reproducible everywhere (splitmix64).

use rcc_core::path::SpeedOverride;

/// A random number generator.
#[derive(Debug, Clone)]
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// Uniformly distributed over [0, 1).
    pub fn even(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.even()
    }

    pub fn log_even(&mut self, low: f64, high: f64) -> f64 {
        (low.ln() + self.even() * (high / low).ln()).exp()
    }

    pub fn below(&mut self, n: usize) -> usize {
        (self.even() * n as f64) as usize
    }

    /// A random override: a pause, full speed, or any other speed.
    pub fn speed_override(&mut self) -> SpeedOverride {
        let at = |speed| SpeedOverride {
            speed,
            ..SpeedOverride::RUN
        };
        match self.below(12) {
            0..3 => SpeedOverride {
                pause: true,
                ..SpeedOverride::RUN
            },
            3 => at(0.0),
            4..7 => SpeedOverride::RUN,
            7 => at(self.log_even(1e-3, 1.0)),
            _ => at(self.even()),
        }
    }
}
