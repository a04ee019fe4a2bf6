//! The state of one device as the executor sees it: plays the executor's set-points to the device on the device's own
//! clock, brings an arm to rest when they end, and turns exchanges into outputs and the measurement board.
//! Pure, in virtual time; run by the host's thread, once per exchange with the device.

use bytemuck::Zeroable;
use rcc_config::DeviceConfig;
use rcc_core::guard::Violation;
use rcc_core::message::{
    CommandImage, DeviceState, JOINTS_MAX, Joints, MAGIC, Measurement, SetPoint,
};

use super::impedance_ramp::ImpedanceRamp;
use super::limits::ArmLimits;
use super::output_release::OutputRelease;
use super::reason;
use super::set_point_buffer::SetPointBuffer;
use crate::driver::{Exchange, Inputs, Outputs};

mod command_feed;
mod measurement;
mod net_start;
mod phase;
mod playback;
mod stop;
#[cfg(test)]
mod tests;

use command_feed::CommandFeed;
use phase::SessionPhase;
use playback::PlaybackPointer;

/// Longest interval between two reads of the command board, in executor periods.
pub const OBSERVE_PERIODS_MAX: u64 = 4;
/// A device whose period differs by a larger share from that of its last exchange has another clock.
const PERIOD_TOLERANCE: f64 = 0.25;
/// A silent device is offline after this number of its periods, or after `command_timeout` if that is longer.
const SILENT_PERIODS: u64 = 5;

/// Time for which the reason of a loss is shown while the device is only silent, ns: the driver is between two attempts to
/// reach it.
const LOST_REASON_KEPT_NS: u64 = 2_000_000_000;

/// Fixed parameters of a session.
#[derive(Clone, Copy, Debug)]
struct SessionSettings {
    limits: ArmLimits,
    /// Largest distance of a net's first set-point from the hold position, rad per joint.
    first_tolerance_rad: f64,
    /// Delay between the arrival of a set-point and its playback, ns of executor time.
    delay_ns: u64,
    /// Age beyond which a command image is stale, ns.
    command_timeout_ns: u64,
    /// The executor's clock follows this device: set-points are not delayed, see `playback::lockstep`.
    leads_clock: bool,
}

impl SessionSettings {
    /// Returns true if the device leads the executor's clock and its period is at least the executor's: no delay is
    /// needed.
    fn is_lockstep(&self, buffer: &SetPointBuffer, exchange: &Exchange) -> bool {
        let period_s = buffer.period_ns() as f64 * 1e-9;
        self.leads_clock && 1.001 * exchange.period_s() >= period_s
    }

    /// Returns the playback delay in set-points: 0 in lockstep, otherwise at least 1.
    fn delay(&self, buffer: &SetPointBuffer, exchange: &Exchange) -> u64 {
        if self.is_lockstep(buffer, exchange) {
            return 0;
        }
        self.delay_ns.div_ceil(buffer.period_ns()).max(1)
    }
}

/// Counters since the driver started.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PlaybackCounts {
    /// Number of times that set-points ran out while the arm moved.
    pub starved: u64,
    /// Number of exchanges without a set-point of their own, while the executor's clock follows the device.
    pub bridged: u64,
    /// Number of set-points that violated a limit, and of nets refused at their first set-point.
    pub violations: u64,
}

/// Progress of the driver's shutdown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Shutdown {
    NotRequested,
    /// No set-points are followed any more.
    Requested,
    /// An exchange has taken place since the request, so the outputs were released.
    OutputsReleased,
}

/// One device with its set-points and its outputs.
#[derive(Clone, Debug)]
pub struct DeviceSession {
    settings: SessionSettings,
    feed: CommandFeed,
    phase: SessionPhase,
    shutdown: Shutdown,
    /// Position that is sent, rad: the last set-point, or where the device holds itself; unknown while it is offline.
    position: Joints,
    /// The set-point whose digital and analog outputs are in effect.
    outputs: SetPoint,
    output_release: OutputRelease,
    /// Newest cycle whose commands to outputs that hold have been applied.
    held_until: u64,
    impedance_ramp: ImpedanceRamp,
    /// Period of the device in the last exchange, s.
    period_s: f64,
    /// A net could start in the last exchange.
    startable: bool,
    /// Where playback is, or where it ended last.
    played: PlaybackPointer,
    /// Why the arm stopped or refused a net last; 0 = none.
    reason: u32,
    violation: Option<Violation>,
    counts: PlaybackCounts,
    measurement: Measurement,
    /// CLOCK_MONOTONIC of the last exchange, or of the creation.
    last_exchange_ns: u64,
    /// CLOCK_MONOTONIC and reason of the last loss that the driver reported.
    lost: Option<(u64, u32)>,
    offline_after_ns: u64,
    /// The running executor belongs to another build or was started with another configuration of this device.
    executor_incompatible: bool,
}

// Without optimisation a session is copied from frame to frame until it is at its place, on stacks of 2 MiB.
const _: () = assert!(size_of::<DeviceSession>() < 16 << 10);

impl DeviceSession {
    /// A session for a device that has not been reached yet.
    #[must_use]
    pub fn new(device: &DeviceConfig, now_ns: u64) -> Self {
        let limits = ArmLimits::of(device);
        let output_release = OutputRelease::new(device);
        Self {
            settings: SessionSettings {
                limits,
                first_tolerance_rad: device.first_tolerance_rad,
                delay_ns: device.delay_ns,
                command_timeout_ns: device.command_timeout_ns,
                leads_clock: false,
            },
            feed: CommandFeed::default(),
            phase: SessionPhase::Offline,
            shutdown: Shutdown::NotRequested,
            position: [0.0; JOINTS_MAX],
            outputs: SetPoint::NONE,
            measurement: Measurement {
                magic: MAGIC,
                joints: device.model().joints,
                state: DeviceState::Offline as u32,
                reason: reason::SILENT,
                stamp_ns: now_ns,
                analog_out: output_release.values().analog,
                ..Measurement::zeroed()
            },
            output_release,
            held_until: 0,
            impedance_ramp: ImpedanceRamp::new(limits.impedance, limits.joints.joints),
            period_s: 1e-3,
            startable: false,
            played: PlaybackPointer::default(),
            reason: 0,
            violation: None,
            counts: PlaybackCounts::default(),
            last_exchange_ns: now_ns,
            lost: None,
            offline_after_ns: device.command_timeout_ns,
            executor_incompatible: false,
        }
    }

    /// Declares that the executor's clock follows this device: each exchange plays the newest set-point, without delay.
    #[must_use]
    pub fn with_leading_clock(mut self) -> Self {
        self.settings.leads_clock = true;
        self
    }

    /// Takes over new set-points from the command image; `None` means that there is no executor. Call it at least every
    /// [`OBSERVE_PERIODS_MAX`] cycles. A net that is already commanding when its executor appears, or reappears, is not
    /// followed.
    pub fn observe(&mut self, now_ns: u64, image: Option<&CommandImage>) {
        let timeout_ns = self.settings.command_timeout_ns;
        let change = self.feed.update(now_ns, image, timeout_ns);
        if let Some(why) = change.lost {
            self.end_following(why);
        }
        if change.appeared {
            self.feed.refused_owner = 0;
            self.held_until = self.feed.buffer.newest();
            self.refuse_newest_owner(reason::ALREADY_COMMANDED);
        }
    }

    /// Sets whether an executor is running that is not followed because of its build or configuration.
    pub fn set_executor_incompatible(&mut self, executor_incompatible: bool) {
        self.executor_incompatible = executor_incompatible;
    }

    /// Processes a whole exchange; returns the values to send to the device.
    pub fn exchange(&mut self, now_ns: u64, inputs: &Inputs, exchange: &Exchange) -> Outputs {
        self.begin_exchange(now_ns, inputs, exchange);
        self.finish_exchange(exchange)
    }

    /// First half of an exchange: stores what was received and updates the inputs of the measurement. The other part of
    /// the measurement still belongs to the previous exchange, unless the device is no longer commandable.
    pub fn begin_exchange(&mut self, now_ns: u64, inputs: &Inputs, exchange: &Exchange) {
        self.last_exchange_ns = now_ns;
        self.lost = None;
        if self.measurement.state == DeviceState::Offline as u32 {
            // Commands to a lost device never take effect later.
            self.held_until = self.feed.buffer.newest();
        }
        self.offline_after_ns = self
            .settings
            .command_timeout_ns
            .max(SILENT_PERIODS.saturating_mul(exchange.period_ns));
        self.take_period(exchange.period_s());
        self.startable = exchange.startable;
        if exchange.commandable {
            self.enter_command_mode(&exchange.mirror);
        } else {
            self.mirror(&exchange.mirror);
        }
        self.update_inputs(now_ns, inputs, exchange);
        if !exchange.commandable {
            self.update_state(exchange);
        }
    }

    /// Stores the device's period, and ends playback if it changed by more than [`PERIOD_TOLERANCE`]: a set-point covers
    /// one executor period, so another step length would change the arm's speed.
    fn take_period(&mut self, period_s: f64) {
        let change = (period_s - self.period_s).abs();
        let changed = change > PERIOD_TOLERANCE * self.period_s;
        self.period_s = period_s;
        if changed {
            self.end_following(reason::PERIOD_CHANGED);
        }
    }

    /// Second half of an exchange: returns the values to send to the device.
    pub fn finish_exchange(&mut self, exchange: &Exchange) -> Outputs {
        self.play(exchange);
        let dt_s = exchange.ticks.max(1) as f64 * exchange.period_ns as f64 * 1e-9;
        if !exchange.commandable {
            self.impedance_ramp.reset(exchange.strategy);
        }
        let commanded = match self.phase {
            SessionPhase::Following(_) => Some((self.outputs.owner, &self.outputs.impedance)),
            _ => None,
        };
        let impedance = self.impedance_ramp.next(exchange.strategy, commanded, dt_s);
        self.hold_passed();
        let outputs = Outputs {
            position: self.position,
            impedance,
            ..*self.output_release.apply(&self.outputs)
        };
        if self.shutdown == Shutdown::Requested {
            self.shutdown = Shutdown::OutputsReleased;
        }
        self.update_state(exchange);
        outputs
    }

    /// Processes a failed exchange: the device goes offline at once if `lost` holds a reason, otherwise after
    /// `command_timeout` or five of its periods, whichever is longer. An arm in motion that answers again within that
    /// time is brought to rest from its last set-points. Returns true if the measurement has changed.
    pub fn handle_link_error(&mut self, now_ns: u64, lost: Option<u32>) -> bool {
        let silent = now_ns.saturating_sub(self.last_exchange_ns) > self.offline_after_ns;
        if lost.is_none() && !silent {
            return false;
        }
        match silent {
            true => self.lose_device(),
            false => self.lose_contact(),
        }
        self.measurement.state = DeviceState::Offline as u32;
        self.lost = lost.map(|why| (now_ns, why)).or(self.lost);
        let told = self
            .lost
            .filter(|(at_ns, _)| now_ns.saturating_sub(*at_ns) < LOST_REASON_KEPT_NS);
        self.measurement.reason = told.map_or(reason::SILENT, |(_, why)| why);
        self.measurement.quality_permille = 0;
        self.measurement.settled_ns = 0;
        self.measurement.stamp_ns = now_ns;
        self.measurement.executor = self.feed.executor();
        true
    }

    /// Brings the device to rest, releases its outputs and accepts no further commands.
    pub fn terminate(&mut self) {
        if self.shutdown == Shutdown::NotRequested {
            self.shutdown = Shutdown::Requested;
            self.end_following(reason::TERMINATING);
        }
    }

    /// After [`DeviceSession::terminate`]: returns true if the device is at rest and its outputs have been released, or
    /// if it is offline.
    #[must_use]
    pub fn is_at_rest(&self) -> bool {
        match self.phase {
            SessionPhase::Offline => true,
            _ => self.shutdown == Shutdown::OutputsReleased && !self.phase.is_engaged(),
        }
    }

    /// Returns true for an arm that answers: it must leave command mode before the driver ends.
    #[must_use]
    pub fn is_online_arm(&self) -> bool {
        !matches!(self.phase, SessionPhase::Offline) && self.measurement.joints > 0
    }

    /// Returns the measurement for the executor's board.
    #[must_use]
    pub fn measurement(&self) -> &Measurement {
        &self.measurement
    }

    /// Returns the last limit violation, until the next net is followed.
    #[must_use]
    pub fn violation(&self) -> Option<&Violation> {
        self.violation.as_ref()
    }

    /// Returns the counters.
    #[must_use]
    pub fn counts(&self) -> PlaybackCounts {
        self.counts
    }

    /// Bit i: analog output i is commanded outside its range.
    #[must_use]
    pub fn out_of_range(&self) -> u64 {
        self.output_release.out_of_range()
    }

    /// Returns the analog outputs that are commanded, SI; NaN where none is.
    #[must_use]
    pub fn commanded_analog(&self) -> &[f64] {
        &self.outputs.analog
    }

    /// Computes the position and the outputs of this exchange.
    fn play(&mut self, exchange: &Exchange) {
        match self.phase {
            SessionPhase::Stopping(_) => self.step_to_rest(exchange),
            SessionPhase::Following(_) => self.follow(exchange),
            _ => {}
        }
        self.accept_new_net(exchange);
        if !matches!(
            self.phase,
            SessionPhase::Waiting { .. } | SessionPhase::Following(_)
        ) {
            let newest = self.feed.live_set_point();
            let newest = newest.filter(|_| self.shutdown == Shutdown::NotRequested);
            self.outputs = newest.copied().unwrap_or(SetPoint::NONE);
        }
    }

    /// Applies to the outputs that hold what the cycles since the last exchange command: those that are not played
    /// themselves, since the device is slower than the executor or late, would be lost otherwise.
    fn hold_passed(&mut self) {
        let played = match self.phase {
            SessionPhase::Following(_) => self.played.cycle,
            SessionPhase::Waiting { .. } => return,
            _ if self.shutdown != Shutdown::NotRequested || !self.feed.is_live() => return,
            _ => self.feed.buffer.newest(),
        };
        let first = self.feed.buffer.oldest().max(self.held_until + 1);
        for entry in (first..played).filter_map(|cycle| self.feed.buffer.at(cycle)) {
            self.output_release.hold(entry);
        }
        self.held_until = self.held_until.max(played);
    }

    /// Refuses the owner of the newest set-point and marks all present set-points as checked.
    fn refuse_newest_owner(&mut self, why: u32) {
        if self.feed.refuse_newest_owner() {
            self.reason = why;
        }
    }

    fn refuse(&mut self, owner: u64, why: u32) {
        self.feed.refused_owner = owner;
        self.reason = why;
    }

    fn count_violation(&mut self, violation: Violation) {
        self.counts.violations += 1;
        self.violation = Some(violation);
    }
}
