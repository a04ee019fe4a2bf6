//! Plays the executor's set-points to an arm on the arm's own clock, and brings the arm to rest when they end.
//! Pure, in virtual time; run by the host's thread, once for each exchange with the device.
//!
//! The pointer counts the executor's cycles: logical time, one period each, whatever either wall clock did.

use rcc_core::guard::{Guard, Violation};
use rcc_core::impedance::Impedance;
use rcc_core::message::{CommandImage, DeviceState, Joints, SetPoint};
use rcc_motion::StopTrajectory;

use super::limits::ArmLimits;
use super::playback_rate::{JointMotion, PlaybackRate};
use super::reason;
use super::set_point_buffer::{BufferUpdate, SetPointBuffer, commands_joints};
use super::start_blend::StartBlend;
use super::tracking_offset::TrackingOffset;

mod follow;
mod lockstep;
mod net_start;
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
pub struct DeviceCycle {
    /// Device periods since the last one.
    pub ticks: u64,
    /// Period of the device, ns.
    pub period_ns: u64,
    /// The device follows what it is sent.
    pub commandable: bool,
    /// A net may begin.
    pub startable: bool,
    /// [`rcc_core::impedance::ControlMode`] that the device runs, as a number.
    pub strategy: u64,
    /// Where the device holds itself while not commandable, rad.
    pub mirror: Joints,
}

impl DeviceCycle {
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
enum PlayerPhase {
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
struct SentSetPoint {
    position: Joints,
    motion: JointMotion,
    dt_s: f64,
}

impl SentSetPoint {
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
}

/// Counters since the driver started.
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
pub struct SetPointPlayer {
    settings: PlayerSettings,
    /// The executor's clock follows this device: no set-point waits, see `direct`.
    leads_clock: bool,
    guard: Guard,
    buffer: SetPointBuffer,
    phase: PlayerPhase,
    rest: Option<StopTrajectory>,
    /// The board is there and fresh.
    executor_live: bool,
    /// Newest cycle that has been looked at for somebody who begins to command.
    cursor: u64,
    /// This owner is not followed, 0 = everybody is.
    refused_owner: u64,
    /// A stop was asked for: nobody is followed any more.
    terminating: bool,
    commandable: bool,
    startable: bool,
    /// The device's.
    strategy: u64,
    sent: SentSetPoint,
    /// `sent` is where the device is or was sent: not before its first exchange, nor after it was lost.
    position_known: bool,
    /// The device's, s.
    period_s: f64,
    /// Whose outputs hold now.
    outputs: SetPoint,
    pointer: u64,
    pointer_fraction: f64,
    /// Stays at a set-point at rest until the margin is there again.
    dwelling: bool,
    playback_rate: PlaybackRate,
    start_blend: StartBlend,
    /// Each exchange plays the newest set-point.
    lockstep: bool,
    tracking_offset: TrackingOffset,
    /// Device periods in a row without a new set-point.
    bridged: u64,
    reason: u32,
    violation: Option<Violation>,
    counts: PlayerCounts,
}

impl SetPointPlayer {
    /// A player that has seen neither device nor executor.
    #[must_use]
    pub fn new(settings: PlayerSettings) -> Self {
        Self {
            guard: Guard::new(settings.limits.joints, settings.first_tolerance_rad)
                .with_impedance(settings.limits.impedance),
            settings,
            leads_clock: false,
            buffer: SetPointBuffer::default(),
            phase: PlayerPhase::Holding,
            rest: None,
            executor_live: false,
            cursor: 0,
            refused_owner: 0,
            terminating: false,
            commandable: false,
            startable: false,
            strategy: 0,
            sent: SentSetPoint::default(),
            position_known: false,
            period_s: 1e-3,
            outputs: SetPoint::NONE,
            pointer: 0,
            pointer_fraction: 0.0,
            dwelling: false,
            playback_rate: PlaybackRate::NOMINAL,
            start_blend: StartBlend::NONE,
            lockstep: false,
            tracking_offset: TrackingOffset::NONE,
            bridged: 0,
            reason: 0,
            violation: None,
            counts: PlayerCounts::default(),
        }
    }

    /// The executor's clock follows this device: each exchange plays the newest set-point, and none waits.
    #[must_use]
    pub fn with_leading_clock(self) -> Self {
        Self {
            leads_clock: true,
            ..self
        }
    }

    /// Takes over what is new on the board (`None`: no executor), also between exchanges, often enough that none
    /// is missed. An executor that comes, or comes back, with a net already commanding is not followed.
    pub fn observe(&mut self, now_ns: u64, image: Option<&CommandImage>) {
        let news = image.map_or(BufferUpdate::None, |image| self.buffer.update(image));
        // A stamp from the future is no better than an old one: nobody could tell when it ages.
        let age_ns = now_ns.abs_diff(self.buffer.stamp_ns());
        let fresh = image.is_some()
            && self.buffer.newest() > 0
            && age_ns <= self.settings.command_timeout_ns;
        if self.executor_live && (!fresh || news == BufferUpdate::NewExecutor) {
            self.end_following(match (image, news) {
                (_, BufferUpdate::NewExecutor) => reason::EXECUTOR_CHANGED,
                (None, _) => reason::NO_EXECUTOR,
                _ => reason::STALE,
            });
        }
        if fresh && (!self.executor_live || news == BufferUpdate::NewExecutor) {
            self.refused_owner = 0;
            self.refuse_newest_owner(reason::ALREADY_COMMANDED);
        }
        self.executor_live = fresh;
    }

    /// One exchange with the device: afterwards [`SetPointPlayer::position`] and [`SetPointPlayer::outputs`] are what it is told.
    pub fn tick(&mut self, tick: &DeviceCycle) {
        self.begin_exchange(tick);
        self.play(tick);
    }

    /// The first half of an exchange: what the device said. Afterwards [`SetPointPlayer::state`] knows of it.
    pub fn begin_exchange(&mut self, tick: &DeviceCycle) {
        self.startable = tick.startable;
        self.strategy = tick.strategy;
        self.period_s = tick.period_s();
        if !tick.commandable {
            return self.mirror_device(tick);
        }
        if !self.position_known {
            // A driver may be started while its device still follows a dead one.
            self.sent = SentSetPoint::at_rest(tick.mirror);
            self.position_known = true;
        }
        self.commandable = true;
    }

    /// The second half: what it is told.
    pub fn play(&mut self, tick: &DeviceCycle) {
        if tick.commandable {
            match &self.phase {
                PlayerPhase::Stopping => self.step_to_rest(tick),
                PlayerPhase::Following => self.follow(tick),
                PlayerPhase::Holding | PlayerPhase::Waiting { .. } => {}
            }
        }
        self.accept_new_net();
        if matches!(self.phase, PlayerPhase::Holding | PlayerPhase::Stopping) {
            let newest = self.buffer.at(self.buffer.newest());
            let newest = newest.filter(|_| self.executor_live && !self.terminating);
            self.outputs = newest.copied().unwrap_or(SetPoint::NONE);
        }
    }

    /// The device was not reached for so long that nobody knows where it is.
    pub fn lose(&mut self) {
        self.position_known = false;
        self.commandable = false;
        self.startable = false;
        self.abandon_net(reason::DEVICE_STOPPED);
        self.outputs = SetPoint::NONE;
    }

    /// Brings the arm to rest and follows nobody any more.
    pub fn terminate(&mut self) {
        if !self.terminating {
            self.terminating = true;
            self.end_following(reason::TERMINATING);
        }
    }

    /// At rest: neither following nor on the way to rest.
    #[must_use]
    pub fn is_holding(&self) -> bool {
        matches!(self.phase, PlayerPhase::Holding)
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
        let follows = matches!(self.phase, PlayerPhase::Following);
        follows.then_some((self.outputs.owner, &self.outputs.impedance))
    }

    /// As told to the executor, for a device that is reached.
    #[must_use]
    pub fn state(&self) -> DeviceState {
        match self.phase {
            PlayerPhase::Stopping => DeviceState::Stopping,
            PlayerPhase::Waiting { .. } | PlayerPhase::Following => DeviceState::Commanded,
            PlayerPhase::Holding if self.is_ready() => DeviceState::Ready,
            PlayerPhase::Holding => DeviceState::Online,
        }
    }

    /// Why it is not ready, or why it stopped or refused last; 0 = fine.
    #[must_use]
    pub fn reason(&self) -> u32 {
        match (self.terminating, self.executor_live) {
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
        if self.executor_live {
            self.buffer.executor()
        } else {
            0
        }
    }

    /// Logical time of the set-point that was played last, ns; 0 before the first one.
    #[must_use]
    pub fn played_ns(&self) -> u64 {
        let between = self.pointer_fraction * self.buffer.period_ns() as f64;
        self.buffer
            .at(self.pointer)
            .map_or(0, |entry| entry.logical_ns.saturating_add(between as u64))
    }

    /// Logical time up to which everything is played and the arm rests, ns; 0 while that is not so.
    #[must_use]
    pub fn settled_ns(&self) -> u64 {
        let newest = self.buffer.at(self.buffer.newest());
        match (&self.phase, newest) {
            (PlayerPhase::Holding, Some(newest))
                if self.executor_live
                    && self.cursor == self.buffer.newest()
                    && !commands_joints(newest) =>
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
            PlayerPhase::Following => self.buffer.newest().saturating_sub(self.pointer),
            _ => 0,
        }
    }

    /// Counters.
    #[must_use]
    pub fn counts(&self) -> PlayerCounts {
        self.counts
    }

    fn is_ready(&self) -> bool {
        let newest = self.buffer.at(self.buffer.newest());
        self.executor_live
            && self.commandable
            && self.startable
            && !self.terminating
            && newest.is_some_and(|newest| !commands_joints(newest))
    }

    /// The device leads the executor's clock, and its period is one of the executor's or more: nothing need wait.
    fn is_lockstep(&self) -> bool {
        let period_s = self.buffer.period_ns() as f64 * 1e-9;
        self.leads_clock && 1.001 * self.period_s >= period_s
    }

    /// Set-points of logical time that wait before they are played, at least 1 unless the device leads.
    fn delay(&self) -> u64 {
        if self.is_lockstep() {
            return 0;
        }
        self.settings
            .delay_ns
            .div_ceil(self.buffer.period_ns())
            .max(1)
    }

    /// At rest where it is now.
    fn hold(&mut self) {
        self.sent = SentSetPoint::at_rest(self.sent.position);
        self.phase = PlayerPhase::Holding;
    }

    fn mirror_device(&mut self, tick: &DeviceCycle) {
        self.position_known = true;
        self.commandable = false;
        self.abandon_net(reason::DEVICE_STOPPED);
        self.sent = SentSetPoint::at_rest(tick.mirror);
    }

    /// The device no longer follows; whoever commanded it does so no more, also when it can be commanded again.
    fn abandon_net(&mut self, why: u32) {
        if !self.is_holding() {
            self.refuse_newest_owner(why);
            self.reason = why;
            self.hold();
        }
    }

    /// Nobody is to be followed any more: to rest.
    fn end_following(&mut self, why: u32) {
        match self.phase {
            PlayerPhase::Following => self.stop(why),
            PlayerPhase::Waiting { .. } => {
                self.refuse_newest_owner(why);
                self.reason = why;
                self.hold();
            }
            PlayerPhase::Holding | PlayerPhase::Stopping => {}
        }
    }

    /// From the motion of the last set-points to rest.
    fn stop(&mut self, why: u32) {
        self.reason = why;
        self.refuse_newest_owner(why);
        let SentSetPoint {
            position,
            motion,
            dt_s,
        } = self.sent;
        let limits = self.settings.limits.rest();
        let motion = motion.at_its_end(dt_s, &limits);
        let rest = StopTrajectory::new(limits, self.period_s);
        self.rest = rest.ok().and_then(|mut rest| {
            let begun = rest.begin(&position, &motion.velocity, &motion.acceleration);
            begun.ok().map(|()| rest)
        });
        match self.rest {
            Some(_) => self.phase = PlayerPhase::Stopping,
            // Only numbers that are not finite are refused, and those are never sent.
            None => self.hold(),
        }
    }

    /// One exchange on the way to rest.
    fn step_to_rest(&mut self, tick: &DeviceCycle) {
        let Some(rest) = self
            .rest
            .as_mut()
            .filter(|_| matches!(self.phase, PlayerPhase::Stopping))
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
    fn refuse_newest_owner(&mut self, why: u32) {
        self.cursor = self.buffer.newest();
        if let Some(entry) = self.buffer.commanded(self.cursor) {
            self.refuse(entry.owner, why);
        }
    }

    fn refuse(&mut self, owner: u64, why: u32) {
        self.refused_owner = owner;
        self.reason = why;
    }
}
