//! Plays the executor's set-points to an arm on the arm's own clock, and brings the arm to rest when they end.
//! Pure, in virtual time; run by the host's thread, once per exchange with the device.
//!
//! The pointer counts executor cycles, which is logical time: one period per cycle, regardless of both wall clocks.

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

/// Most device periods per step of a stop; a device that is away for longer is not commandable.
const TICKS_MAX: u64 = 64;

/// Fixed parameters of a player.
#[derive(Clone, Copy, Debug)]
pub struct PlayerSettings {
    /// Limits of the arm.
    pub limits: ArmLimits,
    /// Largest distance of a net's first set-point from the hold position, rad per joint.
    pub first_tolerance_rad: f64,
    /// Delay between the arrival of a set-point and its playback, ns of executor time.
    pub delay_ns: u64,
    /// Age beyond which a command image is stale, ns.
    pub command_timeout_ns: u64,
}

/// Input of the player for one exchange with the device.
#[derive(Clone, Copy, Debug)]
pub struct DeviceCycle {
    /// Number of device periods since the last exchange.
    pub ticks: u64,
    /// Period of the device, ns.
    pub period_ns: u64,
    /// The device follows set-points.
    pub commandable: bool,
    /// A net may start.
    pub startable: bool,
    /// Control mode that the device runs, as the number of a [`rcc_core::impedance::ControlMode`].
    pub strategy: u64,
    /// Position at which the device holds itself while it is not commandable, rad.
    pub mirror: Joints,
}

impl DeviceCycle {
    /// Returns the device's period, s; greater than 0.
    fn period_s(&self) -> f64 {
        self.period_ns.max(1) as f64 * 1e-9
    }

    /// Returns the time since the last exchange, s; greater than 0.
    fn dt_s(&self) -> f64 {
        self.ticks.max(1) as f64 * self.period_s()
    }
}

#[derive(Clone, Copy, Debug)]
enum PlayerPhase {
    /// At rest at the position sent last.
    Holding,
    /// At rest, until the delay after the set-point of cycle `first` has passed.
    Waiting { first: u64 },
    /// The pointer moves along the set-points.
    Following,
    /// Coming to rest along the profile in `rest`.
    Stopping,
}

/// The last position sent, with its velocity and acceleration as mean values over the last periods.
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
    /// Number of times that set-points ran out while the arm moved.
    pub starved: u64,
    /// Number of exchanges without a set-point of their own, while the executor's clock follows the device.
    pub bridged: u64,
    /// Number of set-points that violated a limit, and of nets refused at their first set-point.
    pub violations: u64,
}

/// Set-point player of one arm.
#[derive(Clone, Debug)]
pub struct SetPointPlayer {
    settings: PlayerSettings,
    /// The executor's clock follows this device: set-points are not delayed, see `lockstep`.
    leads_clock: bool,
    guard: Guard,
    buffer: SetPointBuffer,
    phase: PlayerPhase,
    rest: Option<StopTrajectory>,
    /// The command board is present and fresh.
    executor_live: bool,
    /// Newest cycle that has been checked for the start of a net.
    cursor: u64,
    /// The owner whose set-points are ignored; 0 = none.
    refused_owner: u64,
    /// A stop was requested: no set-points are followed any more.
    terminating: bool,
    commandable: bool,
    startable: bool,
    /// Control mode of the device.
    strategy: u64,
    sent: SentSetPoint,
    /// `sent` is a real position of the device: false before its first exchange and after it was lost.
    position_known: bool,
    /// Period of the device, s.
    period_s: f64,
    /// The set-point whose outputs are in effect.
    outputs: SetPoint,
    pointer: u64,
    pointer_fraction: f64,
    /// Waits on a set-point at rest until the margin is restored.
    dwelling: bool,
    playback_rate: PlaybackRate,
    start_blend: StartBlend,
    /// Each exchange plays the newest set-point.
    lockstep: bool,
    tracking_offset: TrackingOffset,
    /// Number of consecutive device periods without a new set-point.
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

    /// Declares that the executor's clock follows this device: each exchange plays the newest set-point, without delay.
    #[must_use]
    pub fn with_leading_clock(self) -> Self {
        Self {
            leads_clock: true,
            ..self
        }
    }

    /// Takes over new set-points from the board (`None`: no executor); also called between exchanges, often enough to
    /// miss none. A net that is already commanding when its executor appears, or reappears, is not followed.
    pub fn observe(&mut self, now_ns: u64, image: Option<&CommandImage>) {
        let news = image.map_or(BufferUpdate::None, |image| self.buffer.update(image));
        // A stamp in the future counts as stale: its age could not be determined.
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

    /// Processes a whole exchange; afterwards [`SetPointPlayer::position`] and [`SetPointPlayer::outputs`] are the
    /// values to send.
    pub fn tick(&mut self, tick: &DeviceCycle) {
        self.begin_exchange(tick);
        self.play(tick);
    }

    /// First half of an exchange: stores the state of the device. [`SetPointPlayer::state`] then takes it into account.
    pub fn begin_exchange(&mut self, tick: &DeviceCycle) {
        self.startable = tick.startable;
        self.strategy = tick.strategy;
        self.period_s = tick.period_s();
        if !tick.commandable {
            return self.mirror_device(tick);
        }
        if !self.position_known {
            // A driver may start while its device is still in command mode from an earlier driver.
            self.sent = SentSetPoint::at_rest(tick.mirror);
            self.position_known = true;
        }
        self.commandable = true;
    }

    /// Second half of an exchange: computes the values to send.
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

    /// Handles the loss of the device: its position is no longer known.
    pub fn handle_loss(&mut self) {
        self.position_known = false;
        self.commandable = false;
        self.startable = false;
        self.abandon_net(reason::DEVICE_STOPPED);
        self.outputs = SetPoint::NONE;
    }

    /// Brings the arm to rest and accepts no further commands.
    pub fn terminate(&mut self) {
        if !self.terminating {
            self.terminating = true;
            self.end_following(reason::TERMINATING);
        }
    }

    /// Returns true if the arm is at rest: it neither follows nor waits nor stops.
    #[must_use]
    pub fn is_holding(&self) -> bool {
        matches!(self.phase, PlayerPhase::Holding)
    }

    /// Returns the position to send to the device, rad.
    #[must_use]
    pub fn position(&self) -> &Joints {
        &self.sent.position
    }

    /// Returns the set-point whose digital and analog outputs are in effect.
    #[must_use]
    pub fn outputs(&self) -> &SetPoint {
        &self.outputs
    }

    /// Returns the owner and the impedance of the followed net; `None`: no net is followed.
    #[must_use]
    pub fn impedance(&self) -> Option<(u64, &Impedance)> {
        let follows = matches!(self.phase, PlayerPhase::Following);
        follows.then_some((self.outputs.owner, &self.outputs.impedance))
    }

    /// Returns the state for the executor, for a device that is online.
    #[must_use]
    pub fn state(&self) -> DeviceState {
        match self.phase {
            PlayerPhase::Stopping => DeviceState::Stopping,
            PlayerPhase::Waiting { .. } | PlayerPhase::Following => DeviceState::Commanded,
            PlayerPhase::Holding if self.is_ready() => DeviceState::Ready,
            PlayerPhase::Holding => DeviceState::Online,
        }
    }

    /// Returns why the arm is not ready, or why it stopped or refused a net last; 0 = none.
    #[must_use]
    pub fn reason(&self) -> u32 {
        match (self.terminating, self.executor_live) {
            (true, _) => reason::TERMINATING,
            (_, false) if self.reason == 0 => reason::NO_EXECUTOR,
            _ => self.reason,
        }
    }

    /// Returns the last limit violation.
    #[must_use]
    pub fn violation(&self) -> Option<&Violation> {
        self.violation.as_ref()
    }

    /// Returns the incarnation of the executor whose board is fresh; 0 = none.
    #[must_use]
    pub fn executor(&self) -> u64 {
        if self.executor_live {
            self.buffer.executor()
        } else {
            0
        }
    }

    /// Returns the logical time of the last set-point played, ns; 0 before the first.
    #[must_use]
    pub fn played_ns(&self) -> u64 {
        let between = self.pointer_fraction * self.buffer.period_ns() as f64;
        self.buffer
            .at(self.pointer)
            .map_or(0, |entry| entry.logical_ns.saturating_add(between as u64))
    }

    /// Returns the logical time up to which everything has been played and the arm is at rest, ns; otherwise 0.
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

    /// Returns the number of set-points left to play.
    #[must_use]
    pub fn margin(&self) -> u64 {
        match self.phase {
            PlayerPhase::Following => self.buffer.newest().saturating_sub(self.pointer),
            _ => 0,
        }
    }

    /// Returns the counters.
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

    /// Returns true if the device leads the executor's clock and its period is at least the executor's: no delay is
    /// needed.
    fn is_lockstep(&self) -> bool {
        let period_s = self.buffer.period_ns() as f64 * 1e-9;
        self.leads_clock && 1.001 * self.period_s >= period_s
    }

    /// Returns the playback delay in set-points: 0 in lockstep, otherwise at least 1.
    fn delay(&self) -> u64 {
        if self.is_lockstep() {
            return 0;
        }
        self.settings
            .delay_ns
            .div_ceil(self.buffer.period_ns())
            .max(1)
    }

    /// Holds the present position.
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

    /// The device no longer follows: abandons the net, which is not followed again even if the device becomes
    /// commandable.
    fn abandon_net(&mut self, why: u32) {
        if !self.is_holding() {
            self.refuse_newest_owner(why);
            self.reason = why;
            self.hold();
        }
    }

    /// Ends the playback and brings the arm to rest.
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

    /// Starts a stop from the motion of the last set-points.
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
            // Only values that are not finite are refused, and those are never sent.
            None => self.hold(),
        }
    }

    /// Advances the stop by one exchange.
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

    /// Refuses the owner of the newest set-point and marks all present set-points as checked.
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
