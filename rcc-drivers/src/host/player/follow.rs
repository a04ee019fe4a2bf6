//! One step of the pointer along the set-points, and the position that is sent for it.
//! Pure; run by the host's thread while a net is followed.

use rcc_core::guard::{SLOW, Violation};
use rcc_core::message::{ANALOG_MAX, Joints, SetPoint};

use super::super::pace::Motion;
use super::super::reason;
use super::super::track::TRACK_LENGTH;
use super::{Player, Tick};

/// Why the set-points end.
#[derive(Clone, Copy, Debug)]
pub(super) enum End {
    /// The net commands no longer, from this cycle on.
    Released { entry: u64 },
    /// There is nothing to play yet.
    Starved,
    /// It is not there any more.
    Lost,
    /// It must not be played.
    Violated(Violation),
}

impl Player {
    /// Moves on by one exchange.
    pub(super) fn follow(&mut self, tick: &Tick) {
        let step = if self.direct {
            self.step_directly(tick)
        } else {
            self.step(tick)
        };
        match step {
            Ok(position) => self.sent = self.sent.then(position, tick.dt_s()),
            Err(end) => self.finish(end, tick),
        }
    }

    /// Slow enough to be left where it is: within the acceleration limit, and nothing that anybody would see.
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

    fn step(&mut self, tick: &Tick) -> Result<Joints, End> {
        let old = self.entry;
        if !self.stays() {
            self.advance(tick);
        }
        // Whatever lies between is played, too; the track bounds this loop.
        for entry in (old + 1..=self.entry).take(TRACK_LENGTH) {
            if self.track.at(entry).is_some() && self.track.commanded(entry).is_none() {
                return Err(End::Released { entry });
            }
        }
        if self.is_beyond_the_newest() {
            if !self.is_slow() {
                return Err(End::Starved);
            }
            (self.entry, self.fraction) = (self.track.newest(), 0.0);
        }
        if self.is_too_late() {
            return Err(End::Lost);
        }
        let entry = self.track.commanded(self.entry).ok_or(End::Lost)?;
        let mut position = entry.position;
        if self.fraction > 0.0 {
            let next = self.entry + 1;
            let towards = self
                .track
                .commanded(next)
                .ok_or(End::Released { entry: next })?;
            for (from, to) in position.iter_mut().zip(towards.position) {
                *from += self.fraction * (to - *from);
            }
        }
        let outputs = *entry;
        let mut blend = self.blend;
        blend.advance(tick.dt_s());
        for (position, offset) in position.iter_mut().zip(blend.at()) {
            *position += offset;
        }
        self.guard
            .check(&position, tick.dt_s())
            .map_err(End::Violated)?;
        self.check_impedance(old, &outputs).map_err(End::Violated)?;
        self.blend = blend;
        self.outputs = outputs;
        Ok(position)
    }

    /// A set-point that is older than the delay by more than the time-out is as good as none: the arm would do what was
    /// right then.
    fn is_too_late(&self) -> bool {
        let behind = self.track.newest().saturating_sub(self.entry);
        let most_ns = self
            .settings
            .delay_ns
            .saturating_add(self.settings.command_timeout_ns);
        behind.saturating_mul(self.track.period_ns()) > most_ns
    }

    /// What is commanded besides the position, since the set-point `old`; by logical time, however the pointer moves.
    pub(super) fn check_impedance(&mut self, old: u64, entry: &SetPoint) -> Result<(), Violation> {
        let cycles = self.entry.saturating_sub(old).max(1);
        let dt_s = (cycles * self.track.period_ns()) as f64 * 1e-9;
        self.guard
            .check_impedance(&entry.impedance, self.strategy, dt_s)
    }

    /// At rest, waiting costs nothing: until all of the delay lies ahead again.
    fn stays(&mut self) -> bool {
        // What a step would leave.
        let margin = self.track.newest().saturating_sub(self.entry + 1);
        let delay = self.delay();
        let few = 4 * margin < 3 * delay || (self.dwelling && margin < delay);
        self.dwelling = few && self.fraction == 0.0 && self.rests();
        self.dwelling
    }

    fn advance(&mut self, tick: &Tick) {
        let delay = self.delay();
        let newest = self.track.newest();
        if self.rests() && self.same(self.entry, self.entry + 1) {
            // At rest the pointer may also step onto a whole set-point, or over equal ones: what has piled up is left out.
            if self.fraction > 0.0 {
                (self.entry, self.fraction) = (self.entry + 1, 0.0);
                return;
            }
            if newest.saturating_sub(self.entry) > delay + 2 {
                for _ in 0..TRACK_LENGTH {
                    let many = newest.saturating_sub(self.entry) > delay + 1;
                    if !many || !self.same(self.entry + 1, self.entry + 2) {
                        break;
                    }
                    self.entry += 1;
                }
            }
        }
        let ratio = tick.period_ns as f64 / self.track.period_ns() as f64;
        let ahead = ratio * tick.ticks as f64;
        let margin = newest as f64 - self.entry as f64 - self.fraction - ahead;
        let motion = self.motion();
        let rate = self.pace.next(
            (margin, delay as f64),
            &motion,
            &self.settings.limits,
            tick.dt_s(),
        );
        let place = self.fraction + rate * ahead;
        // Far beyond the newest set-point it only matters that it is.
        let whole = place.floor().min(1e6);
        self.entry += whole as u64;
        self.fraction = (place - whole).min(1.0 - f64::EPSILON);
    }

    fn is_beyond_the_newest(&self) -> bool {
        let newest = self.track.newest();
        self.entry > newest || (self.entry == newest && self.fraction > 0.0)
    }

    /// The last two positions sent were the same.
    pub(super) fn rests(&self) -> bool {
        self.sent.motion.velocity.iter().all(|v| *v == 0.0)
    }

    /// Two cycles command the same, outputs included.
    fn same(&self, one: u64, other: u64) -> bool {
        match (self.track.commanded(one), self.track.commanded(other)) {
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

    /// The set-points end: rest where it is, or go to rest.
    fn finish(&mut self, end: End, tick: &Tick) {
        match end {
            End::Released { entry } if self.is_slow() => {
                let last = self.track.commanded(entry - 1).map(|last| last.position);
                if let Some(last) = last.filter(|_| self.blend.is_over())
                    && self.guard.check(&last, tick.dt_s()).is_ok()
                {
                    // A pointer between two set-points has not quite reached the last one.
                    self.sent.position = last;
                }
                self.hold();
                self.cursor = entry;
                self.outputs = self.track.at(entry).copied().unwrap_or(SetPoint::NONE);
            }
            End::Released { .. } => self.stop(reason::RELEASED_MOVING),
            End::Starved => {
                self.counts.starved += 1;
                self.stop(reason::STARVED);
            }
            End::Lost => self.stop(reason::SET_POINTS_LOST),
            End::Violated(violation) => {
                self.counts.violations += 1;
                self.violation = Some(violation);
                self.stop(reason::LIMIT);
            }
        }
        // This exchange needs its set-point, too.
        self.go_to_rest(tick);
    }

    /// How the set-points around the pointer move; what is missing counts as at rest.
    fn motion(&self) -> Motion {
        let dt_s = self.track.period_ns() as f64 * 1e-9;
        let position = |entry: u64| self.track.commanded(entry).map(|found| found.position);
        let mut motion = Motion::default();
        let Some(here) = position(self.entry) else {
            return motion;
        };
        let next = position(self.entry + 1).unwrap_or(here);
        let before = position(self.entry.wrapping_sub(1)).unwrap_or(here);
        for joint in 0..here.len() {
            let (in_, out) = (here[joint] - before[joint], next[joint] - here[joint]);
            motion.velocity[joint] = out / dt_s;
            motion.acceleration[joint] = (out - in_) / (dt_s * dt_s);
        }
        motion
    }
}
