//! Plays the set-points of one net to an arm, on the arm's own clock.
//! Pure; run by the host's thread, once per exchange.
//!
//! The pointer counts executor cycles, which is logical time: one period per cycle, regardless of both wall clocks.

use std::ops::RangeInclusive;

use rcc_core::guard::{Guard, SLOW, Violation};
use rcc_core::impedance::Impedance;
use rcc_core::message::{Joints, SetPoint};

use super::stop::Stop;
use super::{PlaybackCounts, SessionSettings};
use crate::driver::Exchange;
use crate::host::limits::ArmLimits;
use crate::host::playback_rate::JointMotion;
use crate::host::set_point_buffer::{BUFFER_LENGTH, SetPointBuffer};
use crate::host::tracking_offset::{OffsetStep, TrackingOffset};

mod delayed;
mod lockstep;

use delayed::DelayedPlayback;
use lockstep::LockstepPlayback;

/// Why playback ends.
#[derive(Clone, Copy, Debug)]
pub(super) enum PlayEnd {
    /// The net no longer commands, from this cycle on.
    Released { entry: u64 },
    /// The next set-point has not arrived yet.
    Starved,
    /// The set-point is no longer in the buffer, or too old.
    Lost,
    /// The set-point violates a limit.
    Violated(Violation),
}

/// A place in the set-points: a cycle, and the part of the way to the next one, 0 to 1.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct PlaybackPointer {
    pub(super) cycle: u64,
    pub(super) fraction: f64,
}

/// Source of the set-points of one exchange, and the values that it changes beside the position.
pub(super) struct PlaybackContext<'a> {
    pub(super) settings: &'a SessionSettings,
    pub(super) buffer: &'a SetPointBuffer,
    pub(super) exchange: &'a Exchange,
    /// The set-point whose digital and analog outputs and impedance are in effect.
    pub(super) outputs: &'a mut SetPoint,
    pub(super) counts: &'a mut PlaybackCounts,
}

impl PlaybackContext<'_> {
    /// Returns the executor's period, s.
    fn executor_period_s(&self) -> f64 {
        self.buffer.period_ns() as f64 * 1e-9
    }

    /// Returns the position of cycle `entry`, rad, if the net commands one.
    fn position(&self, entry: u64) -> Option<Joints> {
        self.buffer.commanded(entry).map(|found| found.position)
    }

    /// Returns [`PlayEnd::Released`] at the first of these cycles that commands nothing; the buffer bounds this loop.
    fn check_commanded(&self, cycles: RangeInclusive<u64>) -> Result<(), PlayEnd> {
        for entry in cycles.take(BUFFER_LENGTH) {
            if self.buffer.at(entry).is_some() && self.buffer.commanded(entry).is_none() {
                return Err(PlayEnd::Released { entry });
            }
        }
        Ok(())
    }
}

/// Playback of the net that the arm follows.
#[derive(Clone, Debug)]
pub(super) struct Playback {
    net: FollowedNet,
    mode: PlaybackMode,
}

/// How the pointer moves.
#[derive(Clone, Copy, Debug)]
enum PlaybackMode {
    /// Both clocks run freely: set-points are played after a delay, so that a late one is bridged.
    Delayed(DelayedPlayback),
    /// The executor's clock follows the device: each exchange plays the newest set-point.
    Lockstep(LockstepPlayback),
}

/// State of the playback in both modes.
#[derive(Clone, Debug)]
struct FollowedNet {
    guard: Guard,
    sent: SentSetPoint,
    pointer: PlaybackPointer,
    /// Of the arm from its set-points.
    offset: TrackingOffset,
}

/// The last position sent, with its velocity and acceleration as mean values over the last periods.
#[derive(Clone, Copy, Debug, Default)]
struct SentSetPoint {
    position: Joints,
    motion: JointMotion,
    dt_s: f64,
}

impl SentSetPoint {
    /// Returns the time between the middles of the last period and of the next one of `dt_s`, s: that of a change from one
    /// mean velocity to the other, as the guard computes it.
    fn between_s(&self, dt_s: f64) -> f64 {
        match self.dt_s > 0.0 {
            true => 0.5 * (dt_s + self.dt_s),
            false => dt_s,
        }
    }

    fn then(&self, position: Joints, dt_s: f64) -> Self {
        let between_s = self.between_s(dt_s);
        let mut motion = JointMotion::default();
        for (joint, now) in position.iter().enumerate() {
            motion.velocity[joint] = (now - self.position[joint]) / dt_s;
            motion.acceleration[joint] =
                (motion.velocity[joint] - self.motion.velocity[joint]) / between_s;
        }
        Self {
            position,
            motion,
            dt_s,
        }
    }

    /// Returns true if the arm is slow enough to stop where it is, within the acceleration limit and without a visible
    /// jerk.
    fn is_slow(&self, limits: &ArmLimits) -> bool {
        let limits = &limits.joints;
        let bounds = limits.velocity_max.iter().zip(&limits.acceleration_max);
        let rows = self.motion.velocity.iter().zip(bounds);
        rows.take(limits.joints)
            .all(|(v, (v_max, a_max))| v.abs() <= (SLOW * v_max).min(a_max * self.dt_s))
    }

    /// Returns true if the last two positions sent were equal.
    fn is_stationary(&self) -> bool {
        self.motion.velocity.iter().all(|v| *v == 0.0)
    }
}

/// Returns true if the set-points before cycle `entry` end slowly: the arm may rest at the last one.
pub(super) fn comes_to_rest(buffer: &SetPointBuffer, entry: u64, limits: &ArmLimits) -> bool {
    let before = entry
        .checked_sub(2)
        .and_then(|before| buffer.commanded(before));
    let last = entry.checked_sub(1).and_then(|last| buffer.commanded(last));
    before.zip(last).is_some_and(|(before, last)| {
        let from = SentSetPoint {
            position: before.position,
            ..SentSetPoint::default()
        };
        let period_s = buffer.period_ns() as f64 * 1e-9;
        from.then(last.position, period_s).is_slow(limits)
    })
}

impl FollowedNet {
    /// Returns the position to send for a set-point `dt_s` (s) after the last position, both rad: with the offset, which
    /// advances.
    fn with_offset(&mut self, set_point: &Joints, dt_s: f64, limits: &ArmLimits) -> Joints {
        let step = OffsetStep {
            set_point,
            sent_position: &self.sent.position,
            sent_velocity: &self.sent.motion.velocity,
            dt_s,
            between_s: self.sent.between_s(dt_s),
        };
        self.offset.advance(&step, &limits.joints)
    }

    /// Checks a position (rad) and the impedance of a set-point against the limits, and against those sent before; `old`
    /// is the cycle of the pointer before this exchange. The impedance is checked in logical time, regardless of the
    /// pointer's speed.
    fn check(
        &mut self,
        position: &Joints,
        impedance: &Impedance,
        old: u64,
        context: &PlaybackContext<'_>,
    ) -> Result<(), PlayEnd> {
        let exchange = context.exchange;
        self.guard
            .check(position, exchange.dt_s())
            .map_err(PlayEnd::Violated)?;
        let cycles = self.pointer.cycle.saturating_sub(old).max(1);
        let dt_s = (cycles * context.buffer.period_ns()) as f64 * 1e-9;
        self.guard
            .check_impedance(impedance, exchange.strategy as u64, dt_s)
            .map_err(PlayEnd::Violated)
    }
}

impl Playback {
    /// Starts the playback of a net with its first set-point, which must be at the `hold` position (rad), within the
    /// tolerance.
    ///
    /// # Errors
    /// Returns the limit that the set-point violates.
    pub(super) fn start(
        (first, entry): (u64, &SetPoint),
        hold: &Joints,
        context: &mut PlaybackContext<'_>,
    ) -> Result<Self, Violation> {
        let settings = context.settings;
        let mut guard = Guard::new(settings.limits.joints, settings.first_tolerance_rad)
            .with_impedance(settings.limits.impedance);
        guard.first(&entry.position, hold)?;
        // Sets the guard's history: the blend starts at the hold position.
        guard.first(hold, hold)?;
        let strategy = context.exchange.strategy as u64;
        guard.check_impedance(&entry.impedance, strategy, context.executor_period_s())?;
        let mut pointer = PlaybackPointer {
            cycle: first,
            fraction: 0.0,
        };
        *context.outputs = *entry;
        let mode = if settings.is_lockstep(context.buffer, context.exchange) {
            lockstep::skip_to_newest(&mut pointer, context);
            let skipped = pointer.cycle - first;
            if skipped > 0 {
                // The next set-point is compared with the newest one, not with the first.
                let dt_s = skipped as f64 * context.executor_period_s();
                guard.check_impedance(&context.outputs.impedance, strategy, dt_s)?;
            }
            PlaybackMode::Lockstep(LockstepPlayback::NEW)
        } else {
            PlaybackMode::Delayed(DelayedPlayback::NEW)
        };
        Ok(Self {
            net: FollowedNet {
                guard,
                sent: SentSetPoint {
                    position: *hold,
                    ..SentSetPoint::default()
                },
                pointer,
                offset: TrackingOffset::new(hold, &entry.position, &settings.limits),
            },
            mode,
        })
    }

    /// Advances by one exchange; returns the position to send, rad. The pointer has also moved if playback ends.
    pub(super) fn step(&mut self, context: &mut PlaybackContext<'_>) -> Result<Joints, PlayEnd> {
        let position = match &mut self.mode {
            PlaybackMode::Delayed(mode) => mode.step(&mut self.net, context),
            PlaybackMode::Lockstep(mode) => mode.step(&mut self.net, context),
        }?;
        self.net.sent = self.net.sent.then(position, context.exchange.dt_s());
        Ok(position)
    }

    /// Returns the place of the set-point played last.
    pub(super) fn pointer(&self) -> PlaybackPointer {
        self.net.pointer
    }

    /// Returns true if the arm is slow enough to stop where it is.
    pub(super) fn is_slow(&self, limits: &ArmLimits) -> bool {
        self.net.sent.is_slow(limits)
    }

    /// Returns true if the arm may be sent to `last` (rad), the last set-point of the net, as its last step.
    pub(super) fn may_end_at(&mut self, last: &Joints, dt_s: f64) -> bool {
        self.net.offset.has_blended() && self.net.guard.check(last, dt_s).is_ok()
    }

    /// Returns the stop from the motion of the last set-points, for exchanges of `period_s` (s); `None` if a value is not
    /// finite.
    pub(super) fn stop(&self, limits: &ArmLimits, period_s: f64) -> Option<Stop> {
        let SentSetPoint {
            position,
            motion,
            dt_s,
        } = self.net.sent;
        let limits = limits.rest();
        let motion = motion.at_its_end(dt_s, &limits);
        Stop::new(limits, (position, motion), period_s)
    }
}
