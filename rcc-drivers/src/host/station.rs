//! One device as the executor sees it: from exchanges and command images to outputs and the measurement board.
//! Pure, in virtual time; run by the host's thread.

use bytemuck::Zeroable;
use rcc_config::DeviceConfig;
use rcc_core::message::{CommandImage, DeviceState, MAGIC, Measurement};

use super::compliance::Compliance;
use super::limits::ArmLimits;
use super::player::{Player, PlayerSettings, Tick};
use super::reason;
use super::release::Release;
use crate::driver::{Exchange, Inputs, Outputs};

/// A device that answers no more is offline after so many of its periods, if that is longer than its time-out.
const SILENT_PERIODS: u64 = 5;

/// The device, its player and its outputs.
#[derive(Clone, Debug)]
pub struct Station {
    player: Player,
    release: Release,
    compliance: Compliance,
    measurement: Measurement,
    /// CLOCK_MONOTONIC of the last exchange, or of the beginning.
    heard_ns: u64,
    offline_after_ns: u64,
    command_timeout_ns: u64,
    commandable: bool,
    /// The last exchange found the outputs released after a stop was asked for.
    released: bool,
    terminating: bool,
    /// There is an executor, but it is of another build or has another configuration of this device.
    stranger: bool,
}

impl Station {
    /// A device that has not been reached yet.
    #[must_use]
    pub fn new(device: &DeviceConfig, now_ns: u64) -> Self {
        let settings = PlayerSettings {
            limits: ArmLimits::of(device),
            first_tolerance_rad: device.first_tolerance_rad,
            delay_ns: device.delay_ns,
            command_timeout_ns: device.command_timeout_ns,
        };
        let release = Release::new(device);
        let limits = settings.limits;
        Self {
            player: Player::new(settings),
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
            compliance: Compliance::new(limits.impedance, limits.joints.joints),
            heard_ns: now_ns,
            offline_after_ns: device.command_timeout_ns,
            command_timeout_ns: device.command_timeout_ns,
            commandable: false,
            released: false,
            terminating: false,
            stranger: false,
        }
    }

    /// The executor's clock follows this device.
    #[must_use]
    pub fn leading(self) -> Self {
        Self {
            player: self.player.leading(),
            ..self
        }
    }

    /// Takes over what is new of the commands, `None` without executor; at least every [`LOOK_PERIODS`] cycles.
    pub fn observe(&mut self, now_ns: u64, image: Option<&CommandImage>) {
        self.player.observe(now_ns, image);
    }

    /// An executor is there, or is there no more, that is not followed because of its configuration.
    pub fn meet_stranger(&mut self, stranger: bool) {
        self.stranger = stranger;
    }

    /// An exchange with the device: what is it told?
    pub fn exchange(&mut self, now_ns: u64, inputs: &Inputs, exchange: &Exchange) -> Outputs {
        self.arrive(now_ns, inputs, exchange);
        self.answer(exchange)
    }

    /// The first half of an exchange: what the device said. The measurement can be read, with what is new in it; what the
    /// player does in it is that of the exchange before, unless the device follows no more.
    pub fn arrive(&mut self, now_ns: u64, inputs: &Inputs, exchange: &Exchange) {
        self.heard_ns = now_ns;
        self.offline_after_ns = self
            .command_timeout_ns
            .max(SILENT_PERIODS.saturating_mul(exchange.period_ns));
        self.commandable = exchange.commandable;
        self.player.arrive(&tick(exchange));
        self.measure(now_ns, inputs, exchange);
        if !exchange.commandable {
            self.tell(exchange);
        }
    }

    /// The second half: what it is told.
    pub fn answer(&mut self, exchange: &Exchange) -> Outputs {
        self.player.play(&tick(exchange));
        let dt_s = exchange.ticks.max(1) as f64 * exchange.period_ns as f64 * 1e-9;
        if !exchange.commandable {
            self.compliance.reset(exchange.strategy);
        }
        let commanded = self.player.impedance();
        let impedance = self.compliance.next(exchange.strategy, commanded, dt_s);
        let outputs = Outputs {
            position: *self.player.position(),
            impedance,
            ..*self.release.apply(self.player.outputs())
        };
        self.released = self.terminating;
        self.tell(exchange);
        outputs
    }

    /// No exchange: the device is offline at once if `lost` says why, and after a while if it is only silent. True if
    /// the measurement has changed.
    pub fn silence(&mut self, now_ns: u64, lost: Option<u32>) -> bool {
        let silent = now_ns.saturating_sub(self.heard_ns) > self.offline_after_ns;
        if lost.is_none() && !silent {
            return false;
        }
        self.commandable = false;
        self.player.lose();
        self.measurement.state = DeviceState::Offline as u32;
        self.measurement.reason = lost.unwrap_or(reason::SILENT);
        self.measurement.quality_permille = 0;
        self.measurement.settled_ns = 0;
        self.measurement.stamp_ns = now_ns;
        self.measurement.executor = self.player.executor();
        true
    }

    /// Brings the device to rest, releases its outputs and follows nobody any more.
    pub fn terminate(&mut self) {
        self.terminating = true;
        self.player.terminate();
    }

    /// After [`Station::terminate`]: it rests and its outputs have been released, or it is not reached anyway.
    #[must_use]
    pub fn is_at_rest(&self) -> bool {
        let offline = self.measurement.state == DeviceState::Offline as u32;
        offline || (self.released && self.player.is_holding())
    }

    /// The device follows us; an arm should be let go before the driver ends.
    #[must_use]
    pub fn is_held_by_us(&self) -> bool {
        self.commandable && self.measurement.joints > 0
    }

    /// What the executor is to read.
    #[must_use]
    pub fn measurement(&self) -> &Measurement {
        &self.measurement
    }

    /// The player.
    #[must_use]
    pub fn player(&self) -> &Player {
        &self.player
    }

    /// Bit i: analog output i is commanded out of its range.
    #[must_use]
    pub fn out_of_range(&self) -> u64 {
        self.release.out_of_range()
    }

    /// What the device says.
    fn measure(&mut self, now_ns: u64, inputs: &Inputs, exchange: &Exchange) {
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

    /// What the player does.
    fn tell(&mut self, exchange: &Exchange) {
        let player = &self.player;
        let range = match self.release.out_of_range() {
            0 => 0,
            _ => reason::ANALOG_RANGE,
        };
        let state = player.state();
        // What has stopped it once is history when it is ready again.
        let history = match state {
            DeviceState::Ready | DeviceState::Commanded => 0,
            _ => player.reason(),
        };
        // First: nothing at the device helps against it.
        let stranger = match self.stranger {
            true => reason::OTHER_CONFIGURATION,
            false => 0,
        };
        let reasons = [stranger, exchange.reason, history, range];
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

fn tick(exchange: &Exchange) -> Tick {
    Tick {
        ticks: exchange.ticks,
        period_ns: exchange.period_ns,
        commandable: exchange.commandable,
        startable: exchange.startable,
        strategy: exchange.strategy as u64,
        mirror: exchange.mirror,
    }
}

/// Longest pause between two looks at the commands, in periods of the executor.
pub const LOOK_PERIODS: u64 = 4;
