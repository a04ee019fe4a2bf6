//! The small step between where the arm is held and where a net begins, which the tolerance allows, made smooth.
//! Pure; run by the host's thread.

use rcc_core::message::{JOINTS_MAX, Joints};

use super::limits::ArmLimits;

/// The part of each limit that the way may use; the rest is the net's.
const SHARE: f64 = 0.1;
/// Largest |ẇ|, |ẅ|, |w⃛| of the quintic w(x) = 1 − 10x³ + 15x⁴ − 6x⁵ on 0..1.
const PEAKS: [f64; 3] = [1.875, 5.773_502_7, 60.0];

/// What is added to the set-points of a net, going from `offset` to 0 with rest at both ends.
#[derive(Clone, Copy, Debug)]
pub struct StartBlend {
    offset: Joints,
    duration_s: f64,
    t_s: f64,
}

impl StartBlend {
    /// Adds nothing.
    pub const NONE: StartBlend = StartBlend {
        offset: [0.0; JOINTS_MAX],
        duration_s: 0.0,
        t_s: 0.0,
    };

    /// From where the arm is to where the net wants it; both rad.
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

    /// What is to be added now, rad.
    #[must_use]
    pub fn at(&self) -> Joints {
        if self.is_over() {
            return StartBlend::NONE.offset;
        }
        let x = self.t_s / self.duration_s;
        let weight = 1.0 - x * x * x * (10.0 - x * (15.0 - 6.0 * x));
        self.offset.map(|offset| offset * weight)
    }

    /// Nothing is added any more.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.t_s >= self.duration_s
    }

    /// Time goes on by `dt_s` (s).
    pub fn advance(&mut self, dt_s: f64) {
        self.t_s += dt_s;
    }
}
