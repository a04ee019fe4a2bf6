//! Following a net when the executor's clock follows the device: each exchange plays the newest set-point, which the
//! executor has computed from the measurement of this very exchange. Pure; run by the host's thread.
//!
//! An executor that is late for an exchange is bridged: the arm goes on as it moved. With the next set-point it is back at
//! the newest one, whatever came in between, so that no delay is left over; where the arm then is beside it goes away
//! smoothly (`tracking_offset`).

use rcc_core::message::{JOINTS_MAX, Joints};

use super::super::playback_rate::JointMotion;
use super::super::set_point_buffer::BUFFER_LENGTH;
use super::super::tracking_offset::TrackingOffset;
use super::follow::PlayEnd;
use super::{DeviceCycle, SetPointPlayer};

/// So long, or so many periods of the device, an executor is bridged; the arm then comes to rest. As long as with two clocks
/// and their usual delay.
const BRIDGE_MAX_S: f64 = 10e-3;
const BRIDGE_MAX_PERIODS: u64 = 2;
/// The part of the acceleration limit that one step back to the set-points may use.
const RESYNC_SHARE: f64 = 0.9;
/// The part of what the set-points leave of it that the rest of the way may use.
const SHARE: f64 = 0.5;
/// How much less of the acceleration each further period of a bridge believes in.
const FADE: f64 = 0.5;

impl SetPointPlayer {
    pub(super) fn step_lockstep(&mut self, tick: &DeviceCycle) -> Result<Joints, PlayEnd> {
        let newest = self.buffer.newest();
        // Whatever lies between is played, too; the buffer bounds this loop.
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

    /// As many set-points as the exchange has periods, and the last one had its own.
    fn is_regular(&self, newest: u64, tick: &DeviceCycle) -> bool {
        let ahead = tick.dt_s() / (self.buffer.period_ns() as f64 * 1e-9);
        let steps = (newest - self.pointer) as f64;
        self.bridged == 0 && (steps - ahead).abs() < 0.5
    }

    /// From where the arm would be at the end of this exchange to `stream`, where the set-points are: it takes their
    /// velocity over (and what it had beside it), as far as its acceleration allows in one exchange.
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

    /// What the set-points leave of the acceleration limits, as far as a tracking_offset may use it, rad/s².
    fn acceleration_reserve(&self, entry: u64) -> Joints {
        let mut room = self.settings.limits.joints.acceleration_max;
        let used = self.set_point_motion(entry).acceleration;
        for (place, used) in room.iter_mut().zip(used) {
            *place = SHARE * (*place - used.abs()).max(0.0);
        }
        room
    }

    /// How the set-points move up to this one; what is missing counts as at rest.
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

    /// Where the arm is at the end of this exchange if it goes on as it moved.
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
