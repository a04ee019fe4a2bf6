//! Playback while the executor's clock follows the device: each exchange plays the newest set-point, which the executor
//! has computed from the measurement of the same exchange.
//! Pure; run by the host's thread.
//!
//! An exchange without a set-point is bridged: the arm continues its motion. The next set-point resynchronises it with
//! the newest one, whatever came in between, so that no delay remains; the remaining offset decays smoothly
//! (`tracking_offset`).

use rcc_core::message::{JOINTS_MAX, Joints};

use super::{FollowedNet, PlayEnd, PlaybackContext, PlaybackPointer, SentSetPoint};
use crate::driver::Exchange;
use crate::host::limits::ArmLimits;
use crate::host::set_point_buffer::BUFFER_LENGTH;

/// Longest bridge, as a time and in device periods: beyond both, the arm comes to rest. The time equals the default
/// delay with two clocks.
const BRIDGE_MAX_S: f64 = 10e-3;
const BRIDGE_MAX_PERIODS: u64 = 2;
/// Share of the acceleration limit that the first step of a resynchronisation may use.
const RESYNC_SHARE: f64 = 0.9;
/// Factor by which the extrapolated acceleration decreases with each further period of a bridge.
const FADE: f64 = 0.5;

/// State of a playback in lockstep.
#[derive(Clone, Copy, Debug)]
pub(super) struct LockstepPlayback {
    /// Number of consecutive device periods without a new set-point.
    bridged: u64,
}

impl LockstepPlayback {
    /// The beginning of a net.
    pub(super) const NEW: LockstepPlayback = LockstepPlayback { bridged: 0 };

    /// Advances by one exchange; returns the position to send, rad.
    pub(super) fn step(
        &mut self,
        net: &mut FollowedNet,
        context: &mut PlaybackContext<'_>,
    ) -> Result<Joints, PlayEnd> {
        let (buffer, exchange) = (context.buffer, context.exchange);
        let old = net.pointer.cycle;
        let newest = buffer.newest();
        context.check_commanded(old + 1..=newest)?;
        let limits = &context.settings.limits;
        let position = if newest > old {
            let entry = buffer.commanded(newest).ok_or(PlayEnd::Lost)?;
            let regular = self.is_regular(newest - old, context);
            net.pointer = PlaybackPointer {
                cycle: newest,
                fraction: 0.0,
            };
            self.bridged = 0;
            *context.outputs = *entry;
            if regular {
                net.with_offset(&entry.position, exchange.dt_s(), limits)
            } else {
                resynchronise(net, &entry.position, context)
            }
        } else if net.sent.is_stationary() {
            net.sent.position
        } else {
            self.bridged += exchange.ticks.max(1);
            context.counts.bridged += 1;
            let too_long = self.bridged as f64 * exchange.period_s() > BRIDGE_MAX_S * (1.0 + 1e-9);
            if too_long && self.bridged > BRIDGE_MAX_PERIODS {
                return Err(PlayEnd::Starved);
            }
            self.bridge(&net.sent, exchange, limits)
        };
        net.check(&position, &context.outputs.impedance, old, context)?;
        Ok(position)
    }

    /// Returns true if the number of new set-points, `steps`, equals the number of periods of the exchange, and the last
    /// exchange was not bridged.
    fn is_regular(&self, steps: u64, context: &PlaybackContext<'_>) -> bool {
        let ahead = context.exchange.dt_s() / context.executor_period_s();
        self.bridged == 0 && (steps as f64 - ahead).abs() < 0.5
    }

    /// Extrapolates the arm's position to the end of this exchange, rad, at most as fast as its limit.
    fn bridge(&self, sent: &SentSetPoint, exchange: &Exchange, limits: &ArmLimits) -> Joints {
        let dt_s = exchange.dt_s();
        let weight = FADE.powi(self.bridged.saturating_sub(2).min(64) as i32);
        let between_s = weight * sent.between_s(dt_s);
        let motion = &sent.motion;
        let mut position = sent.position;
        for (joint, place) in position.iter_mut().enumerate() {
            let velocity = motion.velocity[joint] + between_s * motion.acceleration[joint];
            *place += limited(velocity, limits.joints.velocity_max[joint]) * dt_s;
        }
        position
    }
}

/// A faster executor has already written several set-points: the first exchange plays the newest one of the net.
pub(super) fn skip_to_newest(pointer: &mut PlaybackPointer, context: &mut PlaybackContext<'_>) {
    for _ in 0..BUFFER_LENGTH {
        let Some(entry) = context.buffer.commanded(pointer.cycle + 1) else {
            return;
        };
        *context.outputs = *entry;
        pointer.cycle += 1;
    }
}

/// Returns the position at the end of this exchange, rad, after exchanges without `set_point`s (rad) of their own: the arm
/// takes over their velocity, and the rate of the present offset, as far as its limits allow in one exchange. The rest of
/// the way becomes the offset.
fn resynchronise(
    net: &mut FollowedNet,
    set_point: &Joints,
    context: &PlaybackContext<'_>,
) -> Joints {
    let dt_s = context.exchange.dt_s();
    let between_s = net.sent.between_s(dt_s);
    let velocity = velocity_until(net.pointer.cycle, context);
    let limits = &context.settings.limits.joints;
    let mut rate = net.offset.rate();
    let (mut position, mut offset) = (net.sent.position, net.sent.position);
    for (joint, place) in position.iter_mut().enumerate() {
        let was = net.sent.motion.velocity[joint];
        let most = RESYNC_SHARE * limits.acceleration_max[joint] * between_s;
        let now = was + limited(velocity[joint] + rate[joint] - was, most);
        let now = limited(now, limits.velocity_max[joint]);
        *place += now * dt_s;
        rate[joint] = now - velocity[joint];
        offset[joint] = *place - set_point[joint];
    }
    net.offset.replace(offset, rate, dt_s);
    position
}

/// Returns the velocity of the set-points up to cycle `entry`, rad/s; 0 if one is missing.
fn velocity_until(entry: u64, context: &PlaybackContext<'_>) -> Joints {
    let dt_s = context.executor_period_s();
    let mut velocity = [0.0; JOINTS_MAX];
    let here = context.position(entry);
    let before = context.position(entry.wrapping_sub(1));
    if let Some((here, before)) = here.zip(before) {
        for (joint, place) in velocity.iter_mut().enumerate() {
            *place = (here[joint] - before[joint]) / dt_s;
        }
    }
    velocity
}

/// Returns the value nearest to `value` in −`most`..`most`; NaN gives a bound.
fn limited(value: f64, most: f64) -> f64 {
    value.max(-most).min(most)
}
