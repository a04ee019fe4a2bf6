//! One step of the pointer along the set-points, and the position that is sent for it.
//! Pure; run by the host's thread while a net is followed.

use rcc_core::guard::{SLOW, Violation};
use rcc_core::message::{ANALOG_MAX, Joints, SetPoint};

use super::super::playback_rate::JointMotion;
use super::super::reason;
use super::super::set_point_buffer::BUFFER_LENGTH;
use super::{DeviceCycle, SetPointPlayer};

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

impl SetPointPlayer {
    /// Advances playback by one exchange.
    pub(super) fn follow(&mut self, tick: &DeviceCycle) {
        let step = if self.lockstep {
            self.step_lockstep(tick)
        } else {
            self.step(tick)
        };
        match step {
            Ok(position) => self.sent = self.sent.then(position, tick.dt_s()),
            Err(end) => self.finish(end, tick),
        }
    }

    /// Returns true if the arm is slow enough to stop where it is, within the acceleration limit and without a visible
    /// jerk.
    pub(super) fn is_slow(&self) -> bool {
        let limits = &self.settings.limits.joints;
        let bounds = limits.velocity_max.iter().zip(&limits.acceleration_max);
        self.sent
            .motion
            .velocity
            .iter()
            .zip(bounds)
            .take(limits.joints)
            .all(|(v, (v_max, a_max))| v.abs() <= (SLOW * v_max).min(a_max * self.sent.dt_s))
    }

    fn step(&mut self, tick: &DeviceCycle) -> Result<Joints, PlayEnd> {
        let old = self.pointer;
        if !self.dwells() {
            self.advance(tick);
        }
        // A released cycle in between ends playback; the buffer bounds this loop.
        for entry in (old + 1..=self.pointer).take(BUFFER_LENGTH) {
            if self.buffer.at(entry).is_some() && self.buffer.commanded(entry).is_none() {
                return Err(PlayEnd::Released { entry });
            }
        }
        if self.is_beyond_the_newest() {
            if !self.is_slow() {
                return Err(PlayEnd::Starved);
            }
            (self.pointer, self.pointer_fraction) = (self.buffer.newest(), 0.0);
        }
        if self.is_too_late() {
            return Err(PlayEnd::Lost);
        }
        let entry = self.buffer.commanded(self.pointer).ok_or(PlayEnd::Lost)?;
        let mut position = entry.position;
        if self.pointer_fraction > 0.0 {
            let next = self.pointer + 1;
            let towards = self
                .buffer
                .commanded(next)
                .ok_or(PlayEnd::Released { entry: next })?;
            for (from, to) in position.iter_mut().zip(towards.position) {
                *from += self.pointer_fraction * (to - *from);
            }
        }
        let outputs = *entry;
        let mut blend = self.start_blend;
        blend.advance(tick.dt_s());
        for (position, offset) in position.iter_mut().zip(blend.at()) {
            *position += offset;
        }
        self.guard
            .check(&position, tick.dt_s())
            .map_err(PlayEnd::Violated)?;
        self.check_impedance(old, &outputs)
            .map_err(PlayEnd::Violated)?;
        self.start_blend = blend;
        self.outputs = outputs;
        Ok(position)
    }

    /// Returns true if the set-point is older than the delay by more than the time-out: its command is outdated.
    fn is_too_late(&self) -> bool {
        let behind = self.buffer.newest().saturating_sub(self.pointer);
        let most_ns = self
            .settings
            .delay_ns
            .saturating_add(self.settings.command_timeout_ns);
        behind.saturating_mul(self.buffer.period_ns()) > most_ns
    }

    /// Checks the impedance set-point against the one of cycle `old`; in logical time, regardless of the pointer's
    /// speed.
    pub(super) fn check_impedance(&mut self, old: u64, entry: &SetPoint) -> Result<(), Violation> {
        let cycles = self.pointer.saturating_sub(old).max(1);
        let dt_s = (cycles * self.buffer.period_ns()) as f64 * 1e-9;
        self.guard
            .check_impedance(&entry.impedance, self.strategy, dt_s)
    }

    /// Decides whether the pointer stays: at rest, waiting until the full delay is restored has no effect on the
    /// motion.
    fn dwells(&mut self) -> bool {
        // The margin after one step.
        let margin = self.buffer.newest().saturating_sub(self.pointer + 1);
        let delay = self.delay();
        let few = 4 * margin < 3 * delay || (self.dwelling && margin < delay);
        self.dwelling = few && self.pointer_fraction == 0.0 && self.is_stationary();
        self.dwelling
    }

    fn advance(&mut self, tick: &DeviceCycle) {
        let delay = self.delay();
        let newest = self.buffer.newest();
        if self.is_stationary() && self.commands_same(self.pointer, self.pointer + 1) {
            // At rest the pointer may also step onto a whole set-point, or skip equal ones: a backlog is removed.
            if self.pointer_fraction > 0.0 {
                (self.pointer, self.pointer_fraction) = (self.pointer + 1, 0.0);
                return;
            }
            if newest.saturating_sub(self.pointer) > delay + 2 {
                for _ in 0..BUFFER_LENGTH {
                    let many = newest.saturating_sub(self.pointer) > delay + 1;
                    if !many || !self.commands_same(self.pointer + 1, self.pointer + 2) {
                        break;
                    }
                    self.pointer += 1;
                }
            }
        }
        let ratio = tick.period_ns as f64 / self.buffer.period_ns() as f64;
        let ahead = ratio * tick.ticks as f64;
        let margin = newest as f64 - self.pointer as f64 - self.pointer_fraction - ahead;
        let motion = self.motion();
        let rate = self.playback_rate.next(
            (margin, delay as f64),
            &motion,
            &self.settings.limits,
            tick.dt_s(),
        );
        let place = self.pointer_fraction + rate * ahead;
        // Far beyond the newest set-point, the exact distance does not matter.
        let whole = place.floor().min(1e6);
        self.pointer += whole as u64;
        self.pointer_fraction = (place - whole).min(1.0 - f64::EPSILON);
    }

    fn is_beyond_the_newest(&self) -> bool {
        let newest = self.buffer.newest();
        self.pointer > newest || (self.pointer == newest && self.pointer_fraction > 0.0)
    }

    /// Returns true if the last two positions sent were equal.
    pub(super) fn is_stationary(&self) -> bool {
        self.sent.motion.velocity.iter().all(|v| *v == 0.0)
    }

    /// Returns true if two cycles command the same values, including outputs.
    fn commands_same(&self, one: u64, other: u64) -> bool {
        match (self.buffer.commanded(one), self.buffer.commanded(other)) {
            (Some(one), Some(other)) => {
                let bits = |values: &[f64; ANALOG_MAX]| values.map(f64::to_bits);
                one.position == other.position
                    && one.digital == other.digital
                    && one.digital_commanded == other.digital_commanded
                    && one.impedance == other.impedance
                    && bits(&one.analog) == bits(&other.analog)
            }
            _ => false,
        }
    }

    /// Ends playback: holds the position if the arm is slow after a release, otherwise starts a stop.
    fn finish(&mut self, end: PlayEnd, tick: &DeviceCycle) {
        match end {
            PlayEnd::Released { entry } if self.is_slow() => {
                let last = self.buffer.commanded(entry - 1).map(|last| last.position);
                if let Some(last) = last.filter(|_| self.start_blend.is_over())
                    && self.guard.check(&last, tick.dt_s()).is_ok()
                {
                    // A pointer between two set-points has not quite reached the last one.
                    self.sent.position = last;
                }
                self.hold();
                self.cursor = entry;
                self.outputs = self.buffer.at(entry).copied().unwrap_or(SetPoint::NONE);
            }
            PlayEnd::Released { .. } => self.stop(reason::RELEASED_MOVING),
            PlayEnd::Starved => {
                self.counts.starved += 1;
                self.stop(reason::STARVED);
            }
            PlayEnd::Lost => self.stop(reason::SET_POINTS_LOST),
            PlayEnd::Violated(violation) => {
                self.counts.violations += 1;
                self.violation = Some(violation);
                self.stop(reason::LIMIT);
            }
        }
        // This exchange needs a set-point too.
        self.step_to_rest(tick);
    }

    /// Returns the motion of the set-points at the pointer; a missing set-point counts as rest.
    fn motion(&self) -> JointMotion {
        let dt_s = self.buffer.period_ns() as f64 * 1e-9;
        let position = |entry: u64| self.buffer.commanded(entry).map(|found| found.position);
        let mut motion = JointMotion::default();
        let Some(here) = position(self.pointer) else {
            return motion;
        };
        let next = position(self.pointer + 1).unwrap_or(here);
        let before = position(self.pointer.wrapping_sub(1)).unwrap_or(here);
        for joint in 0..here.len() {
            let (in_, out) = (here[joint] - before[joint], next[joint] - here[joint]);
            motion.velocity[joint] = out / dt_s;
            motion.acceleration[joint] = (out - in_) / (dt_s * dt_s);
        }
        motion
    }
}
