//! Offset of an arm from its set-points after an exchange without one, and its decay.
//! Pure; run by the host's thread.
//!
//! Per joint ö = −2ω·ȯ − ω²·o (critically damped), with |ö| bounded by the acceleration that the set-points leave. The
//! offset has a velocity of its own, so that a new offset can be added before the old one has decayed.

use rcc_core::message::{JOINTS_MAX, Joints};

/// ω, 1/s: 2 % of an offset remain after a quarter of a second.
const OMEGA: f64 = 25.0;
/// Thresholds below which the offset is set to 0, rad and rad/s.
const NOTHING: [f64; 2] = [1e-9, 1e-7];

/// Decaying offset that is added to the set-points.
#[derive(Clone, Copy, Debug)]
pub struct TrackingOffset {
    offset: Joints,
    rate: Joints,
}

impl TrackingOffset {
    /// Zero offset.
    pub const NONE: TrackingOffset = TrackingOffset {
        offset: [0.0; JOINTS_MAX],
        rate: [0.0; JOINTS_MAX],
    };

    /// An offset (rad) with a rate of change (rad/s).
    #[must_use]
    pub fn from(offset: Joints, rate: Joints) -> TrackingOffset {
        TrackingOffset { offset, rate }
    }

    /// Returns the present offset, rad.
    #[must_use]
    pub fn at(&self) -> Joints {
        self.offset
    }

    /// Returns the present rate of change, rad/s.
    #[must_use]
    pub fn rate(&self) -> Joints {
        self.rate
    }

    /// Advances the time by `dt_s` (s); the decay may use the accelerations `room`, rad/s², none negative.
    pub fn advance(&mut self, dt_s: f64, room: &Joints) {
        let rows = self.offset.iter_mut().zip(&mut self.rate).zip(room);
        for ((offset, rate), most) in rows {
            let acceleration = -2.0 * OMEGA * *rate - OMEGA * OMEGA * *offset;
            *rate += acceleration.max(-most).min(*most) * dt_s;
            *offset += *rate * dt_s;
            if offset.abs() < NOTHING[0] && rate.abs() < NOTHING[1] {
                // Exactly 0, so that set-points are sent unchanged.
                (*offset, *rate) = (0.0, 0.0);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decays_within_its_acceleration_also_when_it_is_added_to() {
        let mut tracking_offset = TrackingOffset::NONE;
        let mut rate = 0.0;
        for step in 0..2_000 {
            if step < 300 && step % 37 == 0 {
                let mut offset = tracking_offset.at();
                offset[0] += 2e-3;
                tracking_offset = TrackingOffset::from(offset, tracking_offset.rate());
            }
            tracking_offset.advance(1e-3, &[4.0; JOINTS_MAX]);
            let acceleration = (tracking_offset.rate()[0] - rate) / 1e-3;
            assert!(acceleration.abs() <= 4.0 + 1e-9, "{acceleration}");
            rate = tracking_offset.rate()[0];
        }
        assert_eq!(tracking_offset.at(), [0.0; JOINTS_MAX]);
    }
}
