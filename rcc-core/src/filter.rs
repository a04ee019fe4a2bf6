//! Linear filters of at most second order: coefficients computed from physical parameters off the real-time thread, and
//! the step in the cycle, which uses no transcendental function.
//!
//! Analog prototypes become digital ones by the bilinear transform with prewarping, which keeps the gain at one frequency
//! exact (Oppenheim and Schafer, *Discrete-Time Signal Processing*, 3rd ed., section 7.2.2): with K = tan(π f dt) the
//! response at frequency g is that of the prototype at f · tan(π g dt) / K.

use core::f64::consts::PI;

use crate::frame::{Frame, Preparation};
use crate::primitive::{Real, Slot, StateSpec, finite};
use crate::types::NULL_REAL;

/// A filter `H(z) = (b0 + b1/z + b2/z²) / (1 + a1/z + a2/z²)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Biquad {
    /// Coefficients of the inputs: this cycle's, the last one's, the one before.
    pub b: [f64; 3],
    /// Coefficients of the outputs: the last cycle's, the one before.
    pub a: [f64; 2],
}

/// Returns K of the bilinear transform for a frequency, Hz; the parameter's range keeps it below half of the rate.
fn prewarped(frequency_hz: f64, dt_s: f64) -> f64 {
    libm::tan(PI * frequency_hz * dt_s)
}

impl Biquad {
    /// Low-pass ω² / (s² + 2 damping ω s + ω²); a damping of 1/√2 is Butterworth's.
    pub fn low_pass(cutoff_hz: f64, damping: f64, dt_s: f64) -> Biquad {
        let k = prewarped(cutoff_hz, dt_s);
        let norm = 1.0 / (1.0 + 2.0 * damping * k + k * k);
        let b0 = k * k * norm;
        Biquad {
            b: [b0, 2.0 * b0, b0],
            a: [
                2.0 * (k * k - 1.0) * norm,
                (1.0 - 2.0 * damping * k + k * k) * norm,
            ],
        }
    }

    /// First-order high-pass s / (s + ω).
    pub fn high_pass(cutoff_hz: f64, dt_s: f64) -> Biquad {
        let k = prewarped(cutoff_hz, dt_s);
        let norm = 1.0 / (1.0 + k);
        Biquad {
            b: [norm, -norm, 0.0],
            a: [(k - 1.0) * norm, 0.0],
        }
    }

    /// Notch (s² + ω²) / (s² + ω s / quality + ω²); quality = frequency / width of the band between the -3 dB points.
    pub fn notch(frequency_hz: f64, quality: f64, dt_s: f64) -> Biquad {
        let k = prewarped(frequency_hz, dt_s);
        let norm = 1.0 / (1.0 + k / quality + k * k);
        let middle = 2.0 * (k * k - 1.0) * norm;
        let outer = (1.0 + k * k) * norm;
        Biquad {
            b: [outer, middle, outer],
            a: [middle, (1.0 - k / quality + k * k) * norm],
        }
    }

    /// Returns the steady-state output for a constant input of 1; not finite if the filter integrates.
    pub fn steady_gain(&self) -> f64 {
        let ([b0, b1, b2], [a1, a2]) = (self.b, self.a);
        (b0 + b1 + b2) / (1.0 + a1 + a2)
    }
}

/// The state of a filter in the arena: b0 b1 b2 a1 a2, the steady-state gain, and two numbers of memory.
pub const STATE: StateSpec = StateSpec {
    reals: 8,
    ..StateSpec::NONE
};
const MEMORY: u32 = 6;

/// Writes a filter with empty memory into the initial arena; `state` is the slot of its [`STATE`].
pub fn prepare(preparation: &mut Preparation<'_>, state: Slot<[Real; 8]>, filter: Biquad) {
    let ([b0, b1, b2], [a1, a2]) = (filter.b, filter.a);
    let gain = finite(filter.steady_gain());
    preparation.put(state, [b0, b1, b2, a1, a2, gain, NULL_REAL, NULL_REAL]);
}

/// Runs one cycle in the transposed direct form II (Oppenheim and Schafer, section 6.3.4).
///
/// With empty memory, at the start and after an overflow, the filter starts in the steady state of its input; an
/// integrating filter starts at rest. A null input gives null and holds the memory.
#[inline(always)]
pub fn step(
    frame: &mut Frame<'_>,
    input: Slot<Real>,
    out: Slot<Real>,
    state: Slot<[Real; 8]>,
) -> Option<()> {
    let x = frame.get(input)?;
    let [b0, b1, b2, a1, a2, gain, mut s1, mut s2] = frame.get(state)?;
    if s1.is_nan() {
        let steady = gain * x;
        let integrates = gain.is_nan();
        s1 = if integrates { 0.0 } else { steady - b0 * x };
        s2 = if integrates {
            0.0
        } else {
            b2 * x - a2 * steady
        };
    }
    let y = finite(b0 * x + s1);
    frame.put(out, y)?;
    if x.is_nan() {
        return Some(());
    }
    // An overflow makes the memory NaN, which restarts the filter.
    let memory = [finite(b1 * x - a1 * y + s2), b2 * x - a2 * y];
    frame.put(state.cast::<[Real; 2]>() + MEMORY, memory)
}

#[cfg(test)]
mod tests;
