//! Following a net when the executor's clock follows the device: each exchange plays the newest set-point, which the
//! executor has computed from the measurement of this very exchange. Pure; run by the host's thread.
//!
//! An executor that is late for an exchange is bridged: the arm goes on as it moved. With the next set-point it is back at
//! the newest one, whatever came in between, so that no delay is left over; where the arm then is beside it goes away
//! smoothly (`detour`).

use rcc_core::message::{JOINTS_MAX, Joints};

use super::super::detour::Detour;
use super::super::pace::Motion;
use super::super::track::TRACK_LENGTH;
use super::follow::End;
use super::{Player, Tick};

/// So long, or so many periods of the device, an executor is bridged; the arm then comes to rest. As long as with two clocks
/// and their usual delay.
const BRIDGE_MAX_S: f64 = 10e-3;
const BRIDGE_MAX_PERIODS: u64 = 2;
/// The part of the acceleration limit that one step back to the set-points may use.
const ALLOWED: f64 = 0.9;
/// The part of what the set-points leave of it that the rest of the way may use.
const SHARE: f64 = 0.5;
/// How much less of the acceleration each further period of a bridge believes in.
const FADE: f64 = 0.5;

impl Player {
    pub(super) fn step_directly(&mut self, tick: &Tick) -> Result<Joints, End> {
        let newest = self.track.newest();
        // Whatever lies between is played, too; the track bounds this loop.
        for entry in (self.entry + 1..=newest).take(TRACK_LENGTH) {
            if self.track.at(entry).is_some() && self.track.commanded(entry).is_none() {
                return Err(End::Released { entry });
            }
        }
        let mut blend = self.blend;
        blend.advance(tick.dt_s());
        let mut detour = self.detour;
        detour.advance(tick.dt_s(), &self.room(newest));
        let old = self.entry;
        let position = if newest > self.entry {
            let regular = self.is_regular(newest, tick);
            let entry = *self.track.commanded(newest).ok_or(End::Lost)?;
            (self.entry, self.fraction, self.bridged) = (newest, 0.0, 0);
            self.outputs = entry;
            let stream = sum(&entry.position, &blend.at());
            if !regular {
                detour = self.detour_from(&stream, &detour.rate(), tick);
            }
            sum(&stream, &detour.at())
        } else if self.rests() {
            self.sent.position
        } else {
            self.bridged += tick.ticks.max(1);
            self.counts.bridged += 1;
            let too_long = self.bridged as f64 * tick.period_s() > BRIDGE_MAX_S * (1.0 + 1e-9);
            if too_long && self.bridged > BRIDGE_MAX_PERIODS {
                return Err(End::Starved);
            }
            self.bridge(tick)
        };
        let checked = self.guard.check(&position, tick.dt_s());
        checked.map_err(End::Violated)?;
        let outputs = self.outputs;
        self.check_impedance(old, &outputs).map_err(End::Violated)?;
        (self.blend, self.detour) = (blend, detour);
        Ok(position)
    }

    /// As many set-points as the exchange has periods, and the last one had its own.
    fn is_regular(&self, newest: u64, tick: &Tick) -> bool {
        let ahead = tick.dt_s() / (self.track.period_ns() as f64 * 1e-9);
        let steps = (newest - self.entry) as f64;
        self.bridged == 0 && (steps - ahead).abs() < 0.5
    }

    /// From where the arm would be at the end of this exchange to `stream`, where the set-points are: it takes their
    /// velocity over (and what it had beside it), as far as its acceleration allows in one exchange.
    fn detour_from(&self, stream: &Joints, rate: &Joints, tick: &Tick) -> Detour {
        let dt_s = tick.dt_s();
        let velocity = self.stream(self.entry).velocity;
        let (mut offset, mut beside) = ([0.0; JOINTS_MAX], *rate);
        let bounds = &self.settings.limits.joints.acceleration_max;
        for (joint, most) in bounds.iter().enumerate() {
            let (was, most) = (self.sent.motion.velocity[joint], ALLOWED * most * dt_s);
            let now = was + (velocity[joint] + rate[joint] - was).max(-most).min(most);
            beside[joint] = now - velocity[joint];
            offset[joint] = self.sent.position[joint] + now * dt_s - stream[joint];
        }
        Detour::from(offset, beside)
    }

    /// What the set-points leave of the acceleration limits, as far as a detour may use it, rad/s².
    fn room(&self, entry: u64) -> Joints {
        let mut room = self.settings.limits.joints.acceleration_max;
        let used = self.stream(entry).acceleration;
        for (place, used) in room.iter_mut().zip(used) {
            *place = SHARE * (*place - used.abs()).max(0.0);
        }
        room
    }

    /// How the set-points move up to this one; what is missing counts as at rest.
    fn stream(&self, entry: u64) -> Motion {
        let dt_s = self.track.period_ns() as f64 * 1e-9;
        let position = |entry: u64| self.track.commanded(entry).map(|found| found.position);
        let mut motion = Motion::default();
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
    fn bridge(&self, tick: &Tick) -> Joints {
        let dt_s = tick.dt_s();
        let believed = FADE.powi(self.bridged.saturating_sub(2).min(64) as i32);
        let motion = &self.sent.motion;
        let mut position = self.sent.position;
        for (joint, place) in position.iter_mut().enumerate() {
            let velocity = motion.velocity[joint] + believed * motion.acceleration[joint] * dt_s;
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
