//! Plays the executor's set-points to an arm on the arm's own clock, and brings the arm to rest when they end.
//! Pure, in virtual time; run by the host's thread, once for each exchange with the device.
//!
//! The pointer counts the executor's cycles: logical time, one period each, whatever either wall clock did.

use rcc_core::guard::{Guard, Violation};
use rcc_core::impedance::Impedance;
use rcc_core::message::{CommandImage, DeviceState, Joints, SetPoint};
use rcc_motion::Rest;

use super::blend::Blend;
use super::detour::Detour;
use super::limits::ArmLimits;
use super::pace::{Motion, Pace};
use super::reason;
use super::track::{News, Track, commands};

mod begin;
mod direct;
mod follow;
#[cfg(test)]
mod tests;

/// Most device periods that one step on the way to rest may take; a device away for longer is not commandable.
const TICKS_MAX: u64 = 64;

/// The fixed parameters of a player.
#[derive(Clone, Copy, Debug)]
pub struct PlayerSettings {
    /// What the arm may do.
    pub limits: ArmLimits,
    /// How far the first set-point may be from where the arm is held, rad per joint.
    pub first_tolerance_rad: f64,
    /// How long set-points wait before they are played, ns of the executor's time.
    pub delay_ns: u64,
    /// A command image older than this is stale, ns.
    pub command_timeout_ns: u64,
}

/// What the player needs to know about one exchange.
#[derive(Clone, Copy, Debug)]
pub struct Tick {
    /// Device periods since the last one.
    pub ticks: u64,
    /// Period of the device, ns.
    pub period_ns: u64,
    /// The device follows what it is sent.
    pub commandable: bool,
    /// A net may begin.
    pub startable: bool,
    /// [`rcc_core::impedance::Strategy`] that the device runs, as a number.
    pub strategy: u64,
    /// Where the device holds itself while not commandable, rad.
    pub mirror: Joints,
}

impl Tick {
    /// The device's period, s; greater than 0.
    fn period_s(&self) -> f64 {
        self.period_ns.max(1) as f64 * 1e-9
    }

    /// Time since the last exchange, s; greater than 0.
    fn dt_s(&self) -> f64 {
        self.ticks.max(1) as f64 * self.period_s()
    }
}

#[derive(Clone, Copy, Debug)]
enum Phase {
    /// At rest at `hold`.
    Holding,
    /// At rest, until enough set-points from `first` on are there.
    Waiting { first: u64 },
    /// The pointer moves along the set-points.
    Following,
    /// On the way to rest, as `rest` says.
    Stopping,
}

/// What was sent last, and how it moved; mean values over the last periods.
#[derive(Clone, Copy, Debug, Default)]
struct Sent {
    position: Joints,
    motion: Motion,
    dt_s: f64,
}

impl Sent {
    fn at_rest(position: Joints) -> Self {
        Self {
            position,
            ..Self::default()
        }
    }

    fn then(&self, position: Joints, dt_s: f64) -> Self {
        let between_s = if self.dt_s > 0.0 {
            0.5 * (dt_s + self.dt_s)
        } else {
            dt_s
        };
        let mut motion = Motion::default();
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
}

/// Counters since the driver began.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PlayerCounts {
    /// Times that there was no set-point to play while the arm moved.
    pub starved: u64,
    /// Exchanges that had to do without their set-point while the executor's clock follows the device.
    pub bridged: u64,
    /// Set-points that broke a limit, and nets refused at their first one.
    pub violations: u64,
}

/// The player of one arm.
#[derive(Clone, Debug)]
pub struct Player {
    settings: PlayerSettings,
    /// The executor's clock follows this device: no set-point waits, see `direct`.
    leads: bool,
    guard: Guard,
    track: Track,
    phase: Phase,
    rest: Option<Rest>,
    /// The board is there and fresh.
    live: bool,
    /// Newest cycle that has been looked at for somebody who begins to command.
    cursor: u64,
    /// This owner is not followed, 0 = everybody is.
    refused: u64,
    /// A stop was asked for: nobody is followed any more.
    terminating: bool,
    commandable: bool,
    startable: bool,
    /// The device's.
    strategy: u64,
    sent: Sent,
    /// `sent` is where the device is or was sent: not before its first exchange, nor after it was lost.
    placed: bool,
    /// The device's, s.
    period_s: f64,
    /// Whose outputs hold now.
    outputs: SetPoint,
    entry: u64,
    fraction: f64,
    /// Stays at a set-point at rest until the margin is there again.
    dwelling: bool,
    pace: Pace,
    blend: Blend,
    /// Each exchange plays the newest set-point.
    direct: bool,
    detour: Detour,
    /// Device periods in a row without a new set-point.
    bridged: u64,
    reason: u32,
    violation: Option<Violation>,
    counts: PlayerCounts,
}

impl Player {
    /// A player that has seen neither device nor executor.
    #[must_use]
    pub fn new(settings: PlayerSettings) -> Self {
        Self {
            guard: Guard::new(settings.limits.joints, settings.first_tolerance_rad)
                .with_impedance(settings.limits.impedance),
            settings,
            leads: false,
            track: Track::default(),
            phase: Phase::Holding,
            rest: None,
            live: false,
            cursor: 0,
            refused: 0,
            terminating: false,
            commandable: false,
            startable: false,
            strategy: 0,
            sent: Sent::default(),
            placed: false,
            period_s: 1e-3,
            outputs: SetPoint::NONE,
            entry: 0,
            fraction: 0.0,
            dwelling: false,
            pace: Pace::EVEN,
            blend: Blend::NONE,
            direct: false,
            detour: Detour::NONE,
            bridged: 0,
            reason: 0,
            violation: None,
            counts: PlayerCounts::default(),
        }
    }

    /// The executor's clock follows this device: each exchange plays the newest set-point, and none waits.
    #[must_use]
    pub fn leading(self) -> Self {
        Self {
            leads: true,
            ..self
        }
    }

    /// Takes over what is new on the board (`None`: no executor), also between exchanges, often enough that none
    /// is missed. An executor that comes, or comes back, with a net already commanding is not followed.
    pub fn observe(&mut self, now_ns: u64, image: Option<&CommandImage>) {
        let news = image.map_or(News::None, |image| self.track.update(image));
        // A stamp from the future is no better than an old one: nobody could tell when it ages.
        let age_ns = now_ns.abs_diff(self.track.stamp_ns());
        let fresh = image.is_some()
            && self.track.newest() > 0
            && age_ns <= self.settings.command_timeout_ns;
        if self.live && (!fresh || news == News::Other) {
            self.break_off(match (image, news) {
                (_, News::Other) => reason::EXECUTOR_CHANGED,
                (None, _) => reason::NO_EXECUTOR,
                _ => reason::STALE,
            });
        }
        if fresh && (!self.live || news == News::Other) {
            self.refused = 0;
            self.refuse_the_newest(reason::ALREADY_COMMANDED);
        }
        self.live = fresh;
    }

    /// One exchange with the device: afterwards [`Player::position`] and [`Player::outputs`] are what it is told.
    pub fn tick(&mut self, tick: &Tick) {
        self.arrive(tick);
        self.play(tick);
    }

    /// The first half of an exchange: what the device said. Afterwards [`Player::state`] knows of it.
    pub fn arrive(&mut self, tick: &Tick) {
        self.startable = tick.startable;
        self.strategy = tick.strategy;
        self.period_s = tick.period_s();
        if !tick.commandable {
            return self.follow_the_device(tick);
        }
        if !self.placed {
            // A driver may be started while its device still follows a dead one.
            self.sent = Sent::at_rest(tick.mirror);
            self.placed = true;
        }
        self.commandable = true;
    }

    /// The second half: what it is told.
    pub fn play(&mut self, tick: &Tick) {
        if tick.commandable {
            match &self.phase {
                Phase::Stopping => self.go_to_rest(tick),
                Phase::Following => self.follow(tick),
                Phase::Holding | Phase::Waiting { .. } => {}
            }
        }
        self.look_for_a_beginning();
        if matches!(self.phase, Phase::Holding | Phase::Stopping) {
            let newest = self.track.at(self.track.newest());
            let newest = newest.filter(|_| self.live && !self.terminating);
            self.outputs = newest.copied().unwrap_or(SetPoint::NONE);
        }
    }

    /// The device was not reached for so long that nobody knows where it is.
    pub fn lose(&mut self) {
        self.placed = false;
        self.commandable = false;
        self.startable = false;
        self.give_up(reason::DEVICE_STOPPED);
        self.outputs = SetPoint::NONE;
    }

    /// Brings the arm to rest and follows nobody any more.
    pub fn terminate(&mut self) {
        if !self.terminating {
            self.terminating = true;
            self.break_off(reason::TERMINATING);
        }
    }

    /// At rest: neither following nor on the way to rest.
    #[must_use]
    pub fn is_holding(&self) -> bool {
        matches!(self.phase, Phase::Holding)
    }

    /// What the device is to be told, rad.
    #[must_use]
    pub fn position(&self) -> &Joints {
        &self.sent.position
    }

    /// The set-point whose digital and analog outputs hold now.
    #[must_use]
    pub fn outputs(&self) -> &SetPoint {
        &self.outputs
    }

    /// What the followed net commands besides the position, and its owner; `None`: no net is followed.
    #[must_use]
    pub fn impedance(&self) -> Option<(u64, &Impedance)> {
        let follows = matches!(self.phase, Phase::Following);
        follows.then_some((self.outputs.owner, &self.outputs.impedance))
    }

    /// As told to the executor, for a device that is reached.
    #[must_use]
    pub fn state(&self) -> DeviceState {
        match self.phase {
            Phase::Stopping => DeviceState::Stopping,
            Phase::Waiting { .. } | Phase::Following => DeviceState::Commanded,
            Phase::Holding if self.is_ready() => DeviceState::Ready,
            Phase::Holding => DeviceState::Online,
        }
    }

    /// Why it is not ready, or why it stopped or refused last; 0 = fine.
    #[must_use]
    pub fn reason(&self) -> u32 {
        match (self.terminating, self.live) {
            (true, _) => reason::TERMINATING,
            (_, false) if self.reason == 0 => reason::NO_EXECUTOR,
            _ => self.reason,
        }
    }

    /// The limit that was broken last.
    #[must_use]
    pub fn violation(&self) -> Option<&Violation> {
        self.violation.as_ref()
    }

    /// Incarnation of the executor whose set-points count, 0 = none.
    #[must_use]
    pub fn executor(&self) -> u64 {
        if self.live { self.track.executor() } else { 0 }
    }

    /// Logical time of the set-point that was played last, ns; 0 before the first one.
    #[must_use]
    pub fn played_ns(&self) -> u64 {
        let between = self.fraction * self.track.period_ns() as f64;
        self.track
            .at(self.entry)
            .map_or(0, |entry| entry.logical_ns.saturating_add(between as u64))
    }

    /// Logical time up to which everything is played and the arm rests, ns; 0 while that is not so.
    #[must_use]
    pub fn settled_ns(&self) -> u64 {
        let newest = self.track.at(self.track.newest());
        match (&self.phase, newest) {
            (Phase::Holding, Some(newest))
                if self.live && self.cursor == self.track.newest() && !commands(newest) =>
            {
                newest.logical_ns
            }
            _ => 0,
        }
    }

    /// Set-points left to play.
    #[must_use]
    pub fn margin(&self) -> u64 {
        match self.phase {
            Phase::Following => self.track.newest().saturating_sub(self.entry),
            _ => 0,
        }
    }

    /// Counters.
    #[must_use]
    pub fn counts(&self) -> PlayerCounts {
        self.counts
    }

    fn is_ready(&self) -> bool {
        let newest = self.track.at(self.track.newest());
        self.live
            && self.commandable
            && self.startable
            && !self.terminating
            && newest.is_some_and(|newest| !commands(newest))
    }

    /// The device leads the executor's clock, and its period is one of the executor's or more: nothing need wait.
    fn is_direct(&self) -> bool {
        let period_s = self.track.period_ns() as f64 * 1e-9;
        self.leads && 1.001 * self.period_s >= period_s
    }

    /// Set-points of logical time that wait before they are played, at least 1 unless the device leads.
    fn delay(&self) -> u64 {
        if self.is_direct() {
            return 0;
        }
        self.settings
            .delay_ns
            .div_ceil(self.track.period_ns())
            .max(1)
    }

    /// At rest where it is now.
    fn hold(&mut self) {
        self.sent = Sent::at_rest(self.sent.position);
        self.phase = Phase::Holding;
    }

    fn follow_the_device(&mut self, tick: &Tick) {
        self.placed = true;
        self.commandable = false;
        self.give_up(reason::DEVICE_STOPPED);
        self.sent = Sent::at_rest(tick.mirror);
    }

    /// The device no longer follows; whoever commanded it does so no more, also when it can be commanded again.
    fn give_up(&mut self, why: u32) {
        if !self.is_holding() {
            self.refuse_the_newest(why);
            self.reason = why;
            self.hold();
        }
    }

    /// Nobody is to be followed any more: to rest.
    fn break_off(&mut self, why: u32) {
        match self.phase {
            Phase::Following => self.stop(why),
            Phase::Waiting { .. } => {
                self.refuse_the_newest(why);
                self.reason = why;
                self.hold();
            }
            Phase::Holding | Phase::Stopping => {}
        }
    }

    /// From the motion of the last set-points to rest.
    fn stop(&mut self, why: u32) {
        self.reason = why;
        self.refuse_the_newest(why);
        let Sent {
            position,
            motion,
            dt_s,
        } = self.sent;
        let limits = self.settings.limits.rest();
        let motion = motion.at_its_end(dt_s, &limits);
        let rest = Rest::new(limits, self.period_s);
        self.rest = rest.ok().and_then(|mut rest| {
            let begun = rest.begin(&position, &motion.velocity, &motion.acceleration);
            begun.ok().map(|()| rest)
        });
        match self.rest {
            Some(_) => self.phase = Phase::Stopping,
            // Only numbers that are not finite are refused, and those are never sent.
            None => self.hold(),
        }
    }

    /// One exchange on the way to rest.
    fn go_to_rest(&mut self, tick: &Tick) {
        let Some(rest) = self
            .rest
            .as_mut()
            .filter(|_| matches!(self.phase, Phase::Stopping))
        else {
            return;
        };
        let mut step = rest.step();
        for _ in 1..tick.ticks.min(TICKS_MAX) {
            step = rest.step();
        }
        let (position, resting) = step;
        self.sent = self.sent.then(position, tick.dt_s());
        if resting {
            self.hold();
        }
    }

    /// Whoever commands now is not followed, and what is there already is not looked at.
    fn refuse_the_newest(&mut self, why: u32) {
        self.cursor = self.track.newest();
        if let Some(entry) = self.track.commanded(self.cursor) {
            self.refuse(entry.owner, why);
        }
    }

    fn refuse(&mut self, owner: u64, why: u32) {
        self.refused = owner;
        self.reason = why;
    }
}
