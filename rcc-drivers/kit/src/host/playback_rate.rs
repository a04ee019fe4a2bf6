//! Playback rate in set-points per period: nominally 1, temporarily less or more after the two clocks have drifted
//! apart.
//! Pure; run by the host's thread.
//!
//! Slower playback stays on the path (time scaling): with s(t) the path position, q̈ = q″·ṡ² + q′·s̈. The slope of the
//! rate is bounded so that the second term stays within the acceleration that the first term leaves.

use rcc_core::message::{Joints, SET_POINTS};
use rcc_motion::StopLimits;

use super::limits::ArmLimits;

/// Rate while the margin is being restored; a player at 1 kHz gains 5 set-points in 0.1 s.
const RECOVERING: f64 = 0.95;
/// Largest rate while a device that fell behind catches up.
const CATCHING_UP: f64 = 1.05;
/// The device catches up once the margin exceeds the delay by more than this number of set-points for this time (s). A
/// smaller surplus is normal jitter between the two clocks.
const SURPLUS: f64 = 1.5;
const SURPLUS_TIME_S: f64 = 0.1;
/// Share of the remaining limit that a change of the rate may use.
const SHARE: f64 = 0.5;
/// Largest slope of the rate, 1/s.
const SLOPE_MAX: f64 = 10.0;
/// Largest change of that slope, 1/s².
const CURVE_MAX: f64 = 1000.0;

/// Velocity and acceleration of the set-points at the pointer, at a rate of 1.
#[derive(Clone, Copy, Debug, Default)]
pub struct JointMotion {
    /// rad/s.
    pub velocity: Joints,
    /// rad/s².
    pub acceleration: Joints,
}

impl JointMotion {
    /// Returns the motion at the end of an interval of `dt_s` (s) over which these are mean values. The set-points that
    /// were sent keep the limits, so a value beyond them is an estimation error, large when periods were lost: the
    /// velocity is clamped to its limit, and the acceleration a to the value whose removal (a²/2J) keeps the velocity
    /// within its limit.
    pub(super) fn at_its_end(&self, dt_s: f64, limits: &StopLimits) -> JointMotion {
        let mut end = *self;
        let rows = end.velocity.iter_mut().zip(&mut end.acceleration);
        let bounds = limits.velocity_max.iter().zip(&limits.jerk_max);
        for ((velocity, acceleration), (velocity_max, jerk)) in rows.zip(bounds).take(limits.joints)
        {
            *velocity += 0.5 * dt_s * *acceleration;
            *velocity = velocity.clamp(-velocity_max, *velocity_max);
            let left = velocity_max - velocity.abs();
            if *acceleration * *velocity > 0.0 {
                let most = (2.0 * jerk * left).sqrt();
                *acceleration = acceleration.clamp(-most, most);
            }
        }
        end
    }
}

/// Controller of the playback rate.
#[derive(Clone, Copy, Debug)]
pub struct PlaybackRate {
    rate: f64,
    slope: f64,
    mode: RateMode,
    /// Time for which there has been a surplus of set-points, s.
    surplus_s: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum RateMode {
    Nominal,
    Recovering,
    CatchingUp,
}

impl PlaybackRate {
    /// Rate of exactly 1.
    pub const NOMINAL: PlaybackRate = PlaybackRate {
        rate: 1.0,
        slope: 0.0,
        mode: RateMode::Nominal,
        surplus_s: 0.0,
    };

    /// Returns the rate for the next `dt_s` (s), with `margin` set-points left to play and `delay` set-points wanted.
    pub fn next(
        &mut self,
        (margin, delay): (f64, f64),
        motion: &JointMotion,
        limits: &ArmLimits,
        dt_s: f64,
    ) -> f64 {
        let half = 0.5 * delay;
        let has_surplus = margin > delay + SURPLUS;
        self.surplus_s = if has_surplus {
            self.surplus_s + dt_s
        } else {
            0.0
        };
        self.mode = match self.mode {
            _ if margin < half => RateMode::Recovering,
            _ if margin > (SET_POINTS - 2) as f64 => RateMode::CatchingUp,
            _ if self.surplus_s > SURPLUS_TIME_S => RateMode::CatchingUp,
            RateMode::Recovering if margin < delay => RateMode::Recovering,
            RateMode::CatchingUp if margin > delay => RateMode::CatchingUp,
            _ => RateMode::Nominal,
        };
        let target = match self.mode {
            RateMode::Nominal => 1.0,
            RateMode::Recovering => RECOVERING * (margin / half).clamp(0.0, 1.0),
            RateMode::CatchingUp => fastest(motion, limits),
        };
        let (slope_max, curve_max) = self.bounds(motion, limits);
        let gap = target - self.rate;
        // The steepest slope that can still be flattened before the target is reached.
        let wanted = (2.0 * gap.abs() * curve_max)
            .sqrt()
            .min(slope_max)
            .min(gap.abs() / dt_s)
            .copysign(gap);
        let change = curve_max * dt_s;
        self.slope += (wanted - self.slope).clamp(-change, change);
        self.slope = self.slope.clamp(-slope_max, slope_max);
        self.rate = (self.rate + self.slope * dt_s).clamp(0.0, CATCHING_UP);
        if (target - self.rate).abs() <= 1e-6 {
            // Set exactly, so that a nominal rate stays exactly 1.
            (self.rate, self.slope) = (target, 0.0);
        }
        self.rate
    }

    fn bounds(&self, motion: &JointMotion, limits: &ArmLimits) -> (f64, f64) {
        let (mut slope, mut curve) = (SLOPE_MAX, CURVE_MAX);
        let rows = motion.velocity.iter().zip(&motion.acceleration);
        let bounds = limits.joints.acceleration_max.iter().zip(&limits.jerk_max);
        for ((velocity, acceleration), (acceleration_max, jerk)) in
            rows.zip(bounds).take(limits.joints.joints)
        {
            let speed = velocity.abs();
            if speed > 0.0 {
                let left = acceleration_max - acceleration.abs() * self.rate * self.rate;
                slope = slope.min(SHARE * left.max(0.0) / speed);
                curve = curve.min(SHARE * jerk / speed);
            }
        }
        (slope, curve)
    }
}

/// Returns the rate at which velocity and acceleration stay within their limits, between 1 and [`CATCHING_UP`].
fn fastest(motion: &JointMotion, limits: &ArmLimits) -> f64 {
    let limits = &limits.joints;
    let rows = motion.velocity.iter().zip(&motion.acceleration);
    let bounds = limits.velocity_max.iter().zip(&limits.acceleration_max);
    rows.zip(bounds)
        .take(limits.joints)
        .fold(CATCHING_UP, |rate, ((v, a), (v_max, a_max))| {
            rate.min(0.99 * v_max / v.abs().max(f64::MIN_POSITIVE))
                .min((SHARE * a_max / a.abs().max(f64::MIN_POSITIVE)).sqrt())
        })
        .max(1.0)
}
