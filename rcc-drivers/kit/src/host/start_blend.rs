//! Blends the small step, allowed by the tolerance, between the hold position and a net's first set-point. The arm follows
//! the blend as far as the set-points leave it room (`tracking_offset`).
//! Pure; run by the host's thread.

use rcc_core::message::{JOINTS_MAX, Joints};

use super::limits::ArmLimits;

/// Share of each limit that the blend uses at most: a smooth start, with room for set-points that move.
const SHARE: f64 = 0.1;
/// Largest |ẇ|, |ẅ|, |w⃛| of the quintic w(x) = 1 − 10x³ + 15x⁴ − 6x⁵ on 0..1.
const PEAKS: [f64; 3] = [1.875, 5.773_502_7, 60.0];

/// Offset added to the set-points of a net; it decreases from `offset` to 0 with rest at both ends.
#[derive(Clone, Copy, Debug)]
pub struct StartBlend {
    offset: Joints,
    duration_s: f64,
    t_s: f64,
}

impl StartBlend {
    /// Zero offset.
    pub const NONE: StartBlend = StartBlend {
        offset: [0.0; JOINTS_MAX],
        duration_s: 0.0,
        t_s: 0.0,
    };

    /// A blend from the hold position to the net's first set-point, both rad.
    #[must_use]
    pub fn new(hold: &Joints, first: &Joints, limits: &ArmLimits) -> Self {
        let ArmLimits {
            joints, jerk_max, ..
        } = limits;
        let (mut offset, mut duration_s) = ([0.0; JOINTS_MAX], 0.0_f64);
        for (joint, place) in offset.iter_mut().enumerate().take(joints.joints) {
            let way = hold[joint] - first[joint];
            let bounds = [
                joints.velocity_max[joint],
                joints.acceleration_max[joint],
                jerk_max[joint],
            ];
            for ((order, peak), bound) in (1..).zip(PEAKS).zip(bounds) {
                let needed = (peak * way.abs() / (SHARE * bound)).powf(1.0 / f64::from(order));
                duration_s = duration_s.max(needed);
            }
            *place = way;
        }
        Self {
            offset,
            duration_s,
            t_s: 0.0,
        }
    }

    /// Returns the present offset, rad.
    #[must_use]
    pub fn at(&self) -> Joints {
        if self.is_over() {
            return StartBlend::NONE.offset;
        }
        let x = self.t_s / self.duration_s;
        let weight = 1.0 - x * x * x * (10.0 - x * (15.0 - 6.0 * x));
        self.offset.map(|offset| offset * weight)
    }

    /// Returns true if the offset is 0.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.t_s >= self.duration_s
    }

    /// Advances the time by `dt_s` (s).
    pub fn advance(&mut self, dt_s: f64) {
        self.t_s += dt_s;
    }
}
