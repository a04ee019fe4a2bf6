//! The state of one device as the executor sees it: turns exchanges and command images into outputs and the measurement
//! board.
//! Pure, in virtual time; run by the host's thread.

use bytemuck::Zeroable;
use rcc_config::DeviceConfig;
use rcc_core::message::{CommandImage, DeviceState, MAGIC, Measurement};

use super::impedance_ramp::ImpedanceRamp;
use super::limits::ArmLimits;
use super::output_release::OutputRelease;
use super::reason;
use super::set_point_player::{DeviceCycle, PlayerSettings, SetPointPlayer};
use crate::driver::{Exchange, Inputs, Outputs};

/// A silent device is offline after this number of its periods, or after `command_timeout` if that is longer.
const SILENT_PERIODS: u64 = 5;

/// One device with its set-point player and its outputs.
#[derive(Clone, Debug)]
pub struct DeviceSession {
    player: SetPointPlayer,
    release: OutputRelease,
    impedance_ramp: ImpedanceRamp,
    measurement: Measurement,
    /// CLOCK_MONOTONIC of the last exchange, or of the creation.
    last_exchange_ns: u64,
    offline_after_ns: u64,
    command_timeout_ns: u64,
    commandable: bool,
    /// The last exchange took place after the stop request, so its outputs were released.
    released: bool,
    terminating: bool,
    /// The running executor belongs to another build or was started with another configuration of this device.
    executor_incompatible: bool,
}

impl DeviceSession {
    /// A session for a device that has not been reached yet.
    #[must_use]
    pub fn new(device: &DeviceConfig, now_ns: u64) -> Self {
        let settings = PlayerSettings {
            limits: ArmLimits::of(device),
            first_tolerance_rad: device.first_tolerance_rad,
            delay_ns: device.delay_ns,
            command_timeout_ns: device.command_timeout_ns,
        };
        let release = OutputRelease::new(device);
        let limits = settings.limits;
        Self {
            player: SetPointPlayer::new(settings),
            measurement: Measurement {
                magic: MAGIC,
                joints: device.model().joints,
                state: DeviceState::Offline as u32,
                reason: reason::SILENT,
                stamp_ns: now_ns,
                analog_out: release.values().analog,
                ..Measurement::zeroed()
            },
            release,
            impedance_ramp: ImpedanceRamp::new(limits.impedance, limits.joints.joints),
            last_exchange_ns: now_ns,
            offline_after_ns: device.command_timeout_ns,
            command_timeout_ns: device.command_timeout_ns,
            commandable: false,
            released: false,
            terminating: false,
            executor_incompatible: false,
        }
    }

    /// Declares that the executor's clock follows this device.
    #[must_use]
    pub fn with_leading_clock(self) -> Self {
        Self {
            player: self.player.with_leading_clock(),
            ..self
        }
    }

    /// Takes over new set-points from the command image; `None` means that there is no executor. Call it at least every
    /// [`OBSERVE_PERIODS_MAX`] cycles.
    pub fn observe(&mut self, now_ns: u64, image: Option<&CommandImage>) {
        self.player.observe(now_ns, image);
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

    /// First half of an exchange: stores what was received and updates the inputs of the measurement. The player's part
    /// of the measurement still belongs to the previous exchange, unless the device is no longer commandable.
    pub fn begin_exchange(&mut self, now_ns: u64, inputs: &Inputs, exchange: &Exchange) {
        self.last_exchange_ns = now_ns;
        self.offline_after_ns = self
            .command_timeout_ns
            .max(SILENT_PERIODS.saturating_mul(exchange.period_ns));
        self.commandable = exchange.commandable;
        self.player.begin_exchange(&tick(exchange));
        self.update_inputs(now_ns, inputs, exchange);
        if !exchange.commandable {
            self.update_state(exchange);
        }
    }

    /// Second half of an exchange: returns the values to send to the device.
    pub fn finish_exchange(&mut self, exchange: &Exchange) -> Outputs {
        self.player.play(&tick(exchange));
        let dt_s = exchange.ticks.max(1) as f64 * exchange.period_ns as f64 * 1e-9;
        if !exchange.commandable {
            self.impedance_ramp.reset(exchange.strategy);
        }
        let commanded = self.player.impedance();
        let impedance = self.impedance_ramp.next(exchange.strategy, commanded, dt_s);
        let outputs = Outputs {
            position: *self.player.position(),
            impedance,
            ..*self.release.apply(self.player.outputs())
        };
        self.released = self.terminating;
        self.update_state(exchange);
        outputs
    }

    /// Processes a failed exchange: the device goes offline at once if `lost` holds a reason, otherwise after a while.
    /// Returns true if the measurement has changed.
    pub fn handle_link_error(&mut self, now_ns: u64, lost: Option<u32>) -> bool {
        let silent = now_ns.saturating_sub(self.last_exchange_ns) > self.offline_after_ns;
        if lost.is_none() && !silent {
            return false;
        }
        self.commandable = false;
        self.player.handle_loss();
        self.measurement.state = DeviceState::Offline as u32;
        self.measurement.reason = lost.unwrap_or(reason::SILENT);
        self.measurement.quality_permille = 0;
        self.measurement.settled_ns = 0;
        self.measurement.stamp_ns = now_ns;
        self.measurement.executor = self.player.executor();
        true
    }

    /// Brings the device to rest, releases its outputs and accepts no further commands.
    pub fn terminate(&mut self) {
        self.terminating = true;
        self.player.terminate();
    }

    /// After [`DeviceSession::terminate`]: returns true if the device is at rest and its outputs have been released, or
    /// if it is offline.
    #[must_use]
    pub fn is_at_rest(&self) -> bool {
        let offline = self.measurement.state == DeviceState::Offline as u32;
        offline || (self.released && self.player.is_holding())
    }

    /// Returns true for an arm in command mode, which must be released before the driver ends.
    #[must_use]
    pub fn needs_release(&self) -> bool {
        self.commandable && self.measurement.joints > 0
    }

    /// Returns the measurement for the executor's board.
    #[must_use]
    pub fn measurement(&self) -> &Measurement {
        &self.measurement
    }

    /// Returns the set-point player.
    #[must_use]
    pub fn player(&self) -> &SetPointPlayer {
        &self.player
    }

    /// Bit i: analog output i is commanded outside its range.
    #[must_use]
    pub fn out_of_range(&self) -> u64 {
        self.release.out_of_range()
    }

    /// Updates the part of the measurement that comes from the device.
    fn update_inputs(&mut self, now_ns: u64, inputs: &Inputs, exchange: &Exchange) {
        let periods = self.measurement.periods + exchange.ticks.max(1);
        self.measurement = Measurement {
            magic: MAGIC,
            sequence: self.measurement.sequence + 1,
            stamp_ns: now_ns,
            periods,
            period_ns: exchange.period_ns,
            quality_permille: exchange.quality_permille,
            strategy: exchange.strategy as u64,
            position: inputs.position,
            torque: inputs.torque,
            external_torque: inputs.external_torque,
            wrench: inputs.wrench,
            digital: inputs.digital,
            digital_known: inputs.digital_known,
            analog: inputs.analog,
            late: exchange.late,
            refused: exchange.refused,
            ..self.measurement
        };
    }

    /// Updates the part of the measurement that comes from the player.
    fn update_state(&mut self, exchange: &Exchange) {
        let player = &self.player;
        let range = match self.release.out_of_range() {
            0 => 0,
            _ => reason::ANALOG_RANGE,
        };
        let state = player.state();
        // Once the device is ready again, the reason of an earlier stop no longer applies.
        let history = match state {
            DeviceState::Ready | DeviceState::Commanded => 0,
            _ => player.reason(),
        };
        // Has priority: nothing done at the device can remedy it.
        let executor_incompatible = match self.executor_incompatible {
            true => reason::OTHER_CONFIGURATION,
            false => 0,
        };
        let reasons = [executor_incompatible, exchange.reason, history, range];
        let outputs = self.release.values();
        self.measurement = Measurement {
            state: state as u32,
            reason: reasons.into_iter().find(|reason| *reason != 0).unwrap_or(0),
            hold: *player.position(),
            digital_out: outputs.digital,
            digital_out_known: outputs.digital_set,
            analog_out: outputs.analog,
            executor: player.executor(),
            played_ns: player.played_ns(),
            settled_ns: player.settled_ns(),
            margin: player.margin(),
            starved: player.counts().starved,
            ..self.measurement
        };
    }
}

fn tick(exchange: &Exchange) -> DeviceCycle {
    DeviceCycle {
        ticks: exchange.ticks,
        period_ns: exchange.period_ns,
        commandable: exchange.commandable,
        startable: exchange.startable,
        strategy: exchange.strategy as u64,
        mirror: exchange.mirror,
    }
}

/// Longest interval between two looks at the command board, in executor periods.
pub const OBSERVE_PERIODS_MAX: u64 = 4;
