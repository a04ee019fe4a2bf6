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
use crate::host::playback_rate::JointMotion;
use crate::host::set_point_buffer::BUFFER_LENGTH;
use crate::host::tracking_offset::TrackingOffset;

/// Longest bridge, as a time and in device periods: beyond both, the arm comes to rest. The time equals the default
/// delay with two clocks.
const BRIDGE_MAX_S: f64 = 10e-3;
const BRIDGE_MAX_PERIODS: u64 = 2;
/// Share of the acceleration limit that the first step of a resynchronisation may use.
const RESYNC_SHARE: f64 = 0.9;
/// Share of the acceleration left by the set-points that the decay of the offset may use.
const SHARE: f64 = 0.5;
/// Factor by which the extrapolated acceleration decreases with each further period of a bridge.
const FADE: f64 = 0.5;

/// State of a playback in lockstep.
#[derive(Clone, Copy, Debug)]
pub(super) struct LockstepPlayback {
    tracking_offset: TrackingOffset,
    /// Number of consecutive device periods without a new set-point.
    bridged: u64,
}

impl LockstepPlayback {
    /// The beginning of a net.
    pub(super) const NEW: LockstepPlayback = LockstepPlayback {
        tracking_offset: TrackingOffset::NONE,
        bridged: 0,
    };

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
        net.start_blend.advance(exchange.dt_s());
        self.tracking_offset
            .advance(exchange.dt_s(), &acceleration_reserve(newest, context));
        let position = if newest > old {
            let entry = buffer.commanded(newest).ok_or(PlayEnd::Lost)?;
            let regular = self.is_regular(newest - old, context);
            net.pointer = PlaybackPointer {
                cycle: newest,
                fraction: 0.0,
            };
            self.bridged = 0;
            *context.outputs = *entry;
            let stream = sum(&entry.position, &net.start_blend.at());
            if !regular {
                let rate = self.tracking_offset.rate();
                let velocity = motion_until(newest, context).velocity;
                self.tracking_offset = offset_from(&net.sent, (&stream, &velocity), &rate, context);
            }
            sum(&stream, &self.tracking_offset.at())
        } else if net.sent.is_stationary() {
            net.sent.position
        } else {
            self.bridged += exchange.ticks.max(1);
            context.counts.bridged += 1;
            let too_long = self.bridged as f64 * exchange.period_s() > BRIDGE_MAX_S * (1.0 + 1e-9);
            if too_long && self.bridged > BRIDGE_MAX_PERIODS {
                return Err(PlayEnd::Starved);
            }
            self.bridge(&net.sent, exchange)
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

    /// Extrapolates the arm's position to the end of this exchange, rad.
    fn bridge(&self, sent: &SentSetPoint, exchange: &Exchange) -> Joints {
        let dt_s = exchange.dt_s();
        let weight = FADE.powi(self.bridged.saturating_sub(2).min(64) as i32);
        let motion = &sent.motion;
        let mut position = sent.position;
        for (joint, place) in position.iter_mut().enumerate() {
            let velocity = motion.velocity[joint] + weight * motion.acceleration[joint] * dt_s;
            *place += velocity * dt_s;
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

/// Returns the offset of the arm from the set-points (position, velocity) at the end of this exchange: the arm takes
/// over their velocity, and the `rate` of the present offset, as far as its acceleration allows in one exchange.
fn offset_from(
    sent: &SentSetPoint,
    (stream, velocity): (&Joints, &Joints),
    rate: &Joints,
    context: &PlaybackContext<'_>,
) -> TrackingOffset {
    let dt_s = context.exchange.dt_s();
    let (mut offset, mut beside) = ([0.0; JOINTS_MAX], *rate);
    let bounds = &context.settings.limits.joints.acceleration_max;
    for (joint, most) in bounds.iter().enumerate() {
        let (was, most) = (sent.motion.velocity[joint], RESYNC_SHARE * most * dt_s);
        let now = was + (velocity[joint] + rate[joint] - was).max(-most).min(most);
        beside[joint] = now - velocity[joint];
        offset[joint] = sent.position[joint] + now * dt_s - stream[joint];
    }
    TrackingOffset::from(offset, beside)
}

/// Returns the acceleration that the set-points leave for the decay of a tracking offset, rad/s².
fn acceleration_reserve(entry: u64, context: &PlaybackContext<'_>) -> Joints {
    let mut room = context.settings.limits.joints.acceleration_max;
    let used = motion_until(entry, context).acceleration;
    for (place, used) in room.iter_mut().zip(used) {
        *place = SHARE * (*place - used.abs()).max(0.0);
    }
    room
}

/// Returns the motion of the set-points up to cycle `entry`; a missing set-point counts as rest.
fn motion_until(entry: u64, context: &PlaybackContext<'_>) -> JointMotion {
    let dt_s = context.executor_period_s();
    let mut motion = JointMotion::default();
    let Some(here) = context.position(entry) else {
        return motion;
    };
    let before = context.position(entry.wrapping_sub(1)).unwrap_or(here);
    let earlier = context.position(entry.wrapping_sub(2)).unwrap_or(before);
    motion.velocity = difference(&here, &before).map(|distance| distance / dt_s);
    let was = difference(&before, &earlier).map(|distance| distance / dt_s);
    motion.acceleration = difference(&motion.velocity, &was).map(|change| change / dt_s);
    motion
}

fn sum(one: &Joints, other: &Joints) -> Joints {
    let mut sum = *one;
    for (place, value) in sum.iter_mut().zip(other) {
        *place += value;
    }
    sum
}

fn difference(one: &Joints, other: &Joints) -> Joints {
    let mut difference = *one;
    for (place, value) in difference.iter_mut().zip(other) {
        *place -= value;
    }
    difference
}
