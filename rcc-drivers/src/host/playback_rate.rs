//! How fast set-points are played, in set-points a period: 1, but for a while less or more when the two clocks have
//! drifted apart. Pure; run by the host's thread.
//!
//! Playing slower stays on the path (time scaling): with s(t) the place on it, q̈ = q″·ṡ² + q′·s̈. The slope of the pace
//! is bounded so that the second term stays within what the first leaves of the acceleration limit.

use rcc_core::message::{Joints, SET_POINTS};
use rcc_motion::StopLimits;

use super::limits::ArmLimits;

/// PlaybackRate while the margin is being won back; a player of 1 kHz wins 5 set-points in 0.1 s.
const RECOVERING: f64 = 0.95;
/// PlaybackRate while a device that fell behind catches up.
const CATCHING_UP: f64 = 1.05;
/// More set-points than this beyond the delay, for this long (s), are too many: it catches up with them. Less is the play
/// of two clocks.
const SURPLUS: f64 = 1.5;
const SURPLUS_TIME_S: f64 = 0.1;
/// The part of what a limit leaves that a change of pace may use.
const SHARE: f64 = 0.5;
/// Steepest change of pace, 1/s.
const SLOPE_MAX: f64 = 10.0;
/// Largest change of that slope, 1/s².
const CURVE_MAX: f64 = 1000.0;

/// Velocity and acceleration of the set-points around the pointer, at a pace of 1.
#[derive(Clone, Copy, Debug, Default)]
pub struct JointMotion {
    /// rad/s.
    pub velocity: Joints,
    /// rad/s².
    pub acceleration: Joints,
}

impl JointMotion {
    /// The motion at the end of the `dt_s` (s) that these are mean values over. What is sent keeps the limits, so what
    /// they cannot be is an error of the estimate, large when periods were lost: the velocity stays below its limit, and
    /// the acceleration a below what its own end (a²/2J) still adds to it.
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

/// The pace and how it changes.
#[derive(Clone, Copy, Debug)]
pub struct PlaybackRate {
    rate: f64,
    slope: f64,
    mode: RateMode,
    /// How long there have been too many set-points, s.
    surplus_s: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum RateMode {
    Nominal,
    Recovering,
    CatchingUp,
}

impl PlaybackRate {
    /// Exactly 1.
    pub const NOMINAL: PlaybackRate = PlaybackRate {
        rate: 1.0,
        slope: 0.0,
        mode: RateMode::Nominal,
        surplus_s: 0.0,
    };

    /// The pace of the next `dt_s` (s), when `margin` set-points are left to play and `delay` are wanted.
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
        // As steep as can still be flattened before the target.
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
            // Exactly, so that an even pace stays an even one.
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

/// The pace at which velocity and acceleration stay within their limits, between 1 and [`CATCHING_UP`].
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
