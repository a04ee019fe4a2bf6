//! A stop on the device's own clock, whose period may change while the arm comes to rest.
//! Pure; run by the host's thread, once per exchange.

use rcc_core::message::Joints;
use rcc_motion::{StopLimits, StopTrajectory};

use crate::driver::Exchange;
use crate::host::playback_rate::JointMotion;

/// Most device periods per step of a stop; a device that is away for longer is not commandable.
const TICKS_MAX: u64 = 64;

/// An arm that comes to rest.
#[derive(Clone, Debug)]
pub(super) struct Stop {
    limits: StopLimits,
    /// Position (rad) and motion at the beginning.
    start: (Joints, JointMotion),
    /// In steps of `period_s`.
    trajectory: StopTrajectory,
    period_s: f64,
    /// All exchanges had this period.
    is_regular: bool,
    /// Time since the beginning, s.
    elapsed_s: f64,
}

impl Stop {
    /// A stop from a position (rad) and motion, for exchanges of `period_s` (s); `None` if a value is not finite.
    pub(super) fn new(
        limits: StopLimits,
        start: (Joints, JointMotion),
        period_s: f64,
    ) -> Option<Self> {
        Some(Self {
            trajectory: begun(limits, &start, period_s)?,
            limits,
            start,
            period_s,
            is_regular: true,
            elapsed_s: 0.0,
        })
    }

    /// Advances by one exchange; returns the position (rad) and whether the arm is at rest.
    pub(super) fn advance(&mut self, exchange: &Exchange) -> (Joints, bool) {
        let ticks = exchange.ticks.clamp(1, TICKS_MAX);
        self.elapsed_s += ticks as f64 * exchange.period_s();
        self.is_regular &= exchange.period_s().to_bits() == self.period_s.to_bits();
        if !self.is_regular {
            // The same motion, at a time that is no multiple of its period: the first step of one with that period.
            if let Some(mut trajectory) = begun(self.limits, &self.start, self.elapsed_s) {
                return trajectory.step();
            }
        }
        let mut step = self.trajectory.step();
        for _ in 1..ticks {
            step = self.trajectory.step();
        }
        step
    }
}

fn begun(
    limits: StopLimits,
    (position, motion): &(Joints, JointMotion),
    step_s: f64,
) -> Option<StopTrajectory> {
    let mut trajectory = StopTrajectory::new(limits, step_s).ok()?;
    let begun = trajectory.begin(position, &motion.velocity, &motion.acceleration);
    begun.ok().map(|()| trajectory)
}
