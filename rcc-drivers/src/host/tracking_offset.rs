//! How far an arm is beside its set-points after an exchange had to do without one, and how that goes away.
//! Pure; run by the host's thread.
//!
//! Per joint ö = −2ω·ȯ − ω²·o (critically damped), with |ö| bounded by what the set-points leave of the acceleration limit:
//! it has a velocity of its own, so that it can begin again while it has not ended yet.

use rcc_core::message::{JOINTS_MAX, Joints};

/// ω, 1/s: what is left after a quarter of a second is 2 %.
const OMEGA: f64 = 25.0;
/// Less than this is nothing, rad and rad/s.
const NOTHING: [f64; 2] = [1e-9, 1e-7];

/// What is added to the set-points.
#[derive(Clone, Copy, Debug)]
pub struct TrackingOffset {
    offset: Joints,
    rate: Joints,
}

impl TrackingOffset {
    /// Adds nothing.
    pub const NONE: TrackingOffset = TrackingOffset {
        offset: [0.0; JOINTS_MAX],
        rate: [0.0; JOINTS_MAX],
    };

    /// From now on this is added, rad, and it changes so fast, rad/s.
    #[must_use]
    pub fn from(offset: Joints, rate: Joints) -> TrackingOffset {
        TrackingOffset { offset, rate }
    }

    /// What is to be added now, rad.
    #[must_use]
    pub fn at(&self) -> Joints {
        self.offset
    }

    /// How fast that changes, rad/s.
    #[must_use]
    pub fn rate(&self) -> Joints {
        self.rate
    }

    /// Time goes on by `dt_s` (s); the way back may use `room`, rad/s², none negative.
    pub fn advance(&mut self, dt_s: f64, room: &Joints) {
        let rows = self.offset.iter_mut().zip(&mut self.rate).zip(room);
        for ((offset, rate), most) in rows {
            let acceleration = -2.0 * OMEGA * *rate - OMEGA * OMEGA * *offset;
            *rate += acceleration.max(-most).min(*most) * dt_s;
            *offset += *rate * dt_s;
            if offset.abs() < NOTHING[0] && rate.abs() < NOTHING[1] {
                // Exactly, so that set-points are sent as they are.
                (*offset, *rate) = (0.0, 0.0);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn goes_away_within_its_room_also_when_it_begins_again() {
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
