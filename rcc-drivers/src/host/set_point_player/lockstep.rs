//! Playback while the executor's clock follows the device: each exchange plays the newest set-point, which the executor
//! has computed from the measurement of the same exchange.
//! Pure; run by the host's thread.
//!
//! An exchange without a set-point is bridged: the arm continues its motion. The next set-point resynchronises it with
//! the newest one, whatever came in between, so that no delay remains; the remaining offset decays smoothly
//! (`tracking_offset`).

use rcc_core::message::{JOINTS_MAX, Joints};

use super::super::playback_rate::JointMotion;
use super::super::set_point_buffer::BUFFER_LENGTH;
use super::super::tracking_offset::TrackingOffset;
use super::follow::PlayEnd;
use super::{DeviceCycle, SetPointPlayer};

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

impl SetPointPlayer {
    pub(super) fn step_lockstep(&mut self, tick: &DeviceCycle) -> Result<Joints, PlayEnd> {
        let newest = self.buffer.newest();
        // A released cycle in between ends playback; the buffer bounds this loop.
        for entry in (self.pointer + 1..=newest).take(BUFFER_LENGTH) {
            if self.buffer.at(entry).is_some() && self.buffer.commanded(entry).is_none() {
                return Err(PlayEnd::Released { entry });
            }
        }
        let mut blend = self.start_blend;
        blend.advance(tick.dt_s());
        let mut tracking_offset = self.tracking_offset;
        tracking_offset.advance(tick.dt_s(), &self.acceleration_reserve(newest));
        let old = self.pointer;
        let position = if newest > self.pointer {
            let regular = self.is_regular(newest, tick);
            let entry = *self.buffer.commanded(newest).ok_or(PlayEnd::Lost)?;
            (self.pointer, self.pointer_fraction, self.bridged) = (newest, 0.0, 0);
            self.outputs = entry;
            let stream = sum(&entry.position, &blend.at());
            if !regular {
                tracking_offset = self.offset_from(&stream, &tracking_offset.rate(), tick);
            }
            sum(&stream, &tracking_offset.at())
        } else if self.is_stationary() {
            self.sent.position
        } else {
            self.bridged += tick.ticks.max(1);
            self.counts.bridged += 1;
            let too_long = self.bridged as f64 * tick.period_s() > BRIDGE_MAX_S * (1.0 + 1e-9);
            if too_long && self.bridged > BRIDGE_MAX_PERIODS {
                return Err(PlayEnd::Starved);
            }
            self.bridge(tick)
        };
        let checked = self.guard.check(&position, tick.dt_s());
        checked.map_err(PlayEnd::Violated)?;
        let outputs = self.outputs;
        self.check_impedance(old, &outputs)
            .map_err(PlayEnd::Violated)?;
        (self.start_blend, self.tracking_offset) = (blend, tracking_offset);
        Ok(position)
    }

    /// Returns true if the number of new set-points equals the number of periods of the exchange, and the last exchange
    /// was not bridged.
    fn is_regular(&self, newest: u64, tick: &DeviceCycle) -> bool {
        let ahead = tick.dt_s() / (self.buffer.period_ns() as f64 * 1e-9);
        let steps = (newest - self.pointer) as f64;
        self.bridged == 0 && (steps - ahead).abs() < 0.5
    }

    /// Returns the offset of the arm from the set-points `stream` at the end of this exchange: the arm takes over their
    /// velocity (and that of the present offset) as far as its acceleration allows in one exchange.
    fn offset_from(&self, stream: &Joints, rate: &Joints, tick: &DeviceCycle) -> TrackingOffset {
        let dt_s = tick.dt_s();
        let velocity = self.set_point_motion(self.pointer).velocity;
        let (mut offset, mut beside) = ([0.0; JOINTS_MAX], *rate);
        let bounds = &self.settings.limits.joints.acceleration_max;
        for (joint, most) in bounds.iter().enumerate() {
            let (was, most) = (self.sent.motion.velocity[joint], RESYNC_SHARE * most * dt_s);
            let now = was + (velocity[joint] + rate[joint] - was).max(-most).min(most);
            beside[joint] = now - velocity[joint];
            offset[joint] = self.sent.position[joint] + now * dt_s - stream[joint];
        }
        TrackingOffset::from(offset, beside)
    }

    /// Returns the acceleration that the set-points leave for the decay of a tracking offset, rad/s².
    fn acceleration_reserve(&self, entry: u64) -> Joints {
        let mut room = self.settings.limits.joints.acceleration_max;
        let used = self.set_point_motion(entry).acceleration;
        for (place, used) in room.iter_mut().zip(used) {
            *place = SHARE * (*place - used.abs()).max(0.0);
        }
        room
    }

    /// Returns the motion of the set-points up to cycle `entry`; a missing set-point counts as rest.
    fn set_point_motion(&self, entry: u64) -> JointMotion {
        let dt_s = self.buffer.period_ns() as f64 * 1e-9;
        let position = |entry: u64| self.buffer.commanded(entry).map(|found| found.position);
        let mut motion = JointMotion::default();
        let Some(here) = position(entry) else {
            return motion;
        };
        let before = position(entry.wrapping_sub(1)).unwrap_or(here);
        let earlier = position(entry.wrapping_sub(2)).unwrap_or(before);
        motion.velocity = difference(&here, &before).map(|distance| distance / dt_s);
        let was = difference(&before, &earlier).map(|distance| distance / dt_s);
        motion.acceleration = difference(&motion.velocity, &was).map(|change| change / dt_s);
        motion
    }

    /// Extrapolates the arm's position to the end of this exchange, rad.
    fn bridge(&self, tick: &DeviceCycle) -> Joints {
        let dt_s = tick.dt_s();
        let weight = FADE.powi(self.bridged.saturating_sub(2).min(64) as i32);
        let motion = &self.sent.motion;
        let mut position = self.sent.position;
        for (joint, place) in position.iter_mut().enumerate() {
            let velocity = motion.velocity[joint] + weight * motion.acceleration[joint] * dt_s;
            *place += velocity * dt_s;
        }
        position
    }
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
