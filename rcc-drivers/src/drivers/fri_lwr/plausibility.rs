//! Detects implausible datagrams while commands are executed, and averages the controller's sample time.
//! Pure; run by the host's thread.

use crate::fri_lwr::wire::MeasurementDatagram;

/// Number of datagrams over which the sample time is averaged.
const PERIODS_AVERAGED: f64 = 1000.0;

/// Why a datagram is implausible: it is refused, and all but [`Implausibility::Period`] are accepted once the next one
/// confirms it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Implausibility {
    /// The session state changes.
    State,
    /// The control strategy changes.
    Strategy,
    /// The drives lose or gain power, or report an error.
    Power,
    /// The sample time differs from its mean by more than `settings.period_tolerance`. A controller has another one only
    /// after it was closed and opened again: set-points in other steps of time would break the limits of a motion.
    Period,
    /// Many sequence numbers are skipped.
    Gap,
    /// The controller's own position jumps while it is mirrored.
    Position,
}

impl Implausibility {
    /// All implausibilities with their words.
    pub const ALL: [(Implausibility, &'static str); 6] = [
        (Implausibility::State, "the session state changed"),
        (Implausibility::Strategy, "the control strategy changed"),
        (Implausibility::Power, "the drives' power or errors changed"),
        (
            Implausibility::Period,
            "the sample time differed from its mean by more than settings.period_tolerance",
        ),
        (Implausibility::Gap, "many sequence numbers were skipped"),
        (
            Implausibility::Position,
            "the controller's own position jumped while it was mirrored",
        ),
    ];

    /// Returns true if the next datagram may confirm it.
    #[must_use]
    pub fn can_be_confirmed(self) -> bool {
        self != Self::Period
    }
}

/// Mean of a controller's sample time; some controllers send a time that varies around it.
#[derive(Clone, Copy, Debug)]
pub struct PeriodMean {
    mean_s: f64,
    taken: f64,
    /// Greatest deviation, as a fraction of the mean.
    tolerance: f64,
}

impl PeriodMean {
    /// A mean without a sample time yet, with a tolerance as a fraction.
    #[must_use]
    pub fn new(tolerance: f64) -> Self {
        Self {
            mean_s: 0.0,
            taken: 0.0,
            tolerance,
        }
    }

    /// Returns the mean, s; 0 before the first sample time.
    #[must_use]
    pub fn mean_s(&self) -> f64 {
        self.mean_s
    }

    /// Returns true if a sample time (s) is the mean within the tolerance; false for NaN.
    #[must_use]
    pub fn agrees(&self, period: f32) -> bool {
        is_close(f64::from(period), self.mean_s, self.tolerance)
    }

    /// Returns true if two sample times (s) are equal within the tolerance.
    #[must_use]
    pub fn are_alike(&self, one: f32, other: f32) -> bool {
        is_close(f64::from(one), f64::from(other), self.tolerance)
    }

    /// Takes a sample time (s); one beyond the tolerance begins a new mean.
    pub fn take(&mut self, period: f32) {
        if !self.agrees(period) {
            (self.mean_s, self.taken) = (f64::from(period), 1.0);
            return;
        }
        self.taken = (self.taken + 1.0).min(PERIODS_AVERAGED);
        self.mean_s += (f64::from(period) - self.mean_s) / self.taken;
    }
}

fn is_close(one: f64, other: f64, tolerance: f64) -> bool {
    (one - other).abs() <= tolerance * other.abs()
}

/// Returns which of the fields that stay constant in command state differs from the last datagram.
#[must_use]
pub fn changed(
    last: &MeasurementDatagram,
    now: &MeasurementDatagram,
    period_agrees: bool,
) -> Option<Implausibility> {
    let rows = [
        (Implausibility::State, last.state != now.state),
        (Implausibility::Strategy, last.control != now.control),
        (Implausibility::Power, has_power(last) != has_power(now)),
        (Implausibility::Period, !period_agrees),
    ];
    rows.into_iter().find(|row| row.1).map(|row| row.0)
}

/// Returns true if the drives have power and report no error.
#[must_use]
pub fn has_power(measured: &MeasurementDatagram) -> bool {
    measured.power != 0 && measured.error == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_of_equal_sample_times_is_that_time_to_the_last_bit() {
        let mut mean = PeriodMean::new(0.2);
        for _ in 0..5000 {
            mean.take(0.001);
        }
        assert_eq!(mean.mean_s(), f64::from(0.001_f32));
    }

    #[test]
    fn a_sample_time_that_varies_within_the_tolerance_is_averaged_and_another_one_is_taken_anew() {
        let mut mean = PeriodMean::new(0.2);
        for i in 0..5000_u16 {
            mean.take(0.001 + 0.000_1 * (f32::from(i % 3) - 1.0));
        }
        assert!((mean.mean_s() - 0.001).abs() < 1e-6, "{mean:?}");
        assert!(mean.agrees(0.001_19) && !mean.agrees(0.001_21) && !mean.agrees(f32::NAN));
        mean.take(0.005);
        assert_eq!(mean.mean_s(), f64::from(0.005_f32));
    }
}
