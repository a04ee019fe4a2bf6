//! The FRI dialogue with the controller, datagram by datagram: sequence numbers, mirroring, the KRL handshake, I/O.
//! Pure, without clock or socket; run by the host's thread.
//!
//! In monitor state, and in the first cycles of command state, every answer repeats (mirrors) the controller's own
//! position: otherwise it refuses to enter command state.

use rcc_config::DeviceConfig;
use rcc_core::impedance::ControlMode;
use rcc_core::message::{JOINTS_MAX, Joints};
use rcc_core::primitive::ChannelKind;

use super::handshake::{KrlConvention, ModeRequest};
use super::plausibility::{Implausibility, PeriodMean, changed, has_power};
use super::strategy::StrategyEncoder;
use super::variables::{KrlChannel, Variable, krl_channels};
use super::{DRIVES_OFF, ENTERING, MONITORING, POSE, QUALITY, STRATEGY};
use crate::fri_lwr::wire::{
    CMD_SIZE, CommandDatagram, HeaderRule, JOINTS, KrlBlock, MeasurementDatagram, Quality,
    SessionState,
};
use rcc_driver_kit::driver::{
    DriverError, Exchange, Inputs, Outputs, channel_error, to_raw, to_si,
};

/// Number of cycles in command state in which the driver still mirrors.
const ENTRY_CYCLES: u32 = 3;
/// After this number of consecutive out-of-order datagrams, the controller's counter is taken as restarted.
const RESTART_DATAGRAMS: u32 = 10;
/// A larger gap in the sequence numbers must be confirmed by the next datagram: stalls of the driver lose no datagrams.
const GAP_MAX: u16 = 10;
/// Largest change of the controller's position while command state begins, rad: the arm rests, so only rounding is
/// visible.
const STILL_RAD: f64 = 1e-5;
/// Largest change of the controller's position from one datagram to the next in any state, rad.
const NEAR_RAD: f64 = 0.01;
/// Settings of a device for the dialogue.
#[derive(Clone, Copy, Debug)]
pub struct SessionSettings {
    /// Convention of the KRL program.
    pub krl: KrlConvention,
    /// Strategy that is asked for; `None`: the KRL program's own.
    pub strategy: Option<ControlMode>,
    /// Lowest connection quality at which command mode is requested.
    pub quality_min: Quality,
    /// Rule for identity and size in a header.
    pub header: HeaderRule,
    /// Greatest deviation of the sample time from its mean in command state, as a fraction.
    pub period_tolerance: f64,
}

impl Default for SessionSettings {
    fn default() -> Self {
        Self {
            krl: KrlConvention::FirstApp,
            strategy: None,
            quality_min: Quality::Ok,
            header: HeaderRule::Exact,
            period_tolerance: 0.2,
        }
    }
}

/// State of the FRI dialogue with one controller.
#[derive(Clone, Debug)]
pub struct FriSession {
    settings: SessionSettings,
    period: PeriodMean,
    strategies: StrategyEncoder,
    /// By kind: digital in, digital out, analog in, analog out.
    channels: [Vec<KrlChannel>; 4],
    measured: MeasurementDatagram,
    last_sequence: Option<u16>,
    out_of_order: u32,
    ticks: u64,
    own_sequence: u16,
    /// Number of consecutive cycles in command state.
    commanding: u32,
    releasing: bool,
    refused: u64,
    /// A datagram that contradicts the present command state; accepted once the next one confirms it.
    unconfirmed: Option<(MeasurementDatagram, Implausibility)>,
    /// Missed answers counted by earlier controllers, minus the count with which the present one started.
    missed_before: i64,
}

impl FriSession {
    /// A session without any datagram yet.
    ///
    /// # Errors
    /// Returns an error if the device's robot does not have 7 joints, or if a channel's address is not a KRL variable.
    pub fn new(device: &DeviceConfig, settings: SessionSettings) -> Result<Self, DriverError> {
        if device.robot.as_ref().map(|robot| robot.joints.len()) != Some(JOINTS) {
            return Err(DriverError::Robot {
                device: device.name.clone(),
                cause: "the LWR has 7 joints: name a robot file with 7, such as robots/lwr4plus.yaml",
            });
        }
        let of = |kind| krl_channels(device, kind);
        let analog_outputs = of(ChannelKind::AnalogOutput)?;
        refuse_handshake_variables(device, &settings, &analog_outputs)?;
        Ok(Self {
            settings,
            period: PeriodMean::new(settings.period_tolerance),
            strategies: StrategyEncoder::of(device),
            channels: [
                of(ChannelKind::DigitalInput)?,
                of(ChannelKind::DigitalOutput)?,
                of(ChannelKind::AnalogInput)?,
                analog_outputs,
            ],
            measured: MeasurementDatagram::default(),
            last_sequence: None,
            out_of_order: 0,
            ticks: 0,
            own_sequence: 0,
            commanding: 0,
            releasing: false,
            refused: 0,
            unconfirmed: None,
            missed_before: 0,
        })
    }

    /// Processes a datagram from the controller; returns false if it is refused (size, identity, order, values).
    pub fn accept(&mut self, bytes: &[u8]) -> bool {
        let Ok(measured) = MeasurementDatagram::decode_as(bytes, self.settings.header) else {
            self.refuse();
            return false;
        };
        // A controller whose interface is off sends nothing.
        if !is_finite(&measured) || measured.state == SessionState::Off {
            self.refuse();
            return false;
        }
        let ticks = match self.last_sequence {
            None => 1,
            Some(last) => measured.send_sequence.wrapping_sub(last),
        };
        if ticks == 0 || ticks > u16::MAX / 2 {
            self.refuse();
            self.out_of_order += 1;
            if self.out_of_order < RESTART_DATAGRAMS {
                return false;
            }
            self.reset();
        }
        if let Some(implausibility) = self.implausibility_of(&measured, ticks)
            && !(implausibility.can_be_confirmed() && self.is_confirmed_by(&measured))
        {
            self.refuse();
            self.unconfirmed = Some((measured, implausibility));
            return false;
        }
        self.unconfirmed = None;
        self.period.take(measured.measurement_period);
        let misses = i64::from(measured.miss_count);
        if self.last_sequence.is_none() {
            self.missed_before += i64::from(self.measured.miss_count) - misses;
            self.ticks = 1;
        } else {
            self.ticks += u64::from(ticks);
        }
        self.out_of_order = 0;
        self.last_sequence = Some(measured.send_sequence);
        // A change of the strategy restarts the count of cycles in command state.
        let goes_on = measured.control == self.measured.control;
        self.commanding = match measured.state {
            SessionState::Command if goes_on => self.commanding.saturating_add(1),
            SessionState::Command => 1,
            _ => 0,
        };
        self.measured = measured;
        if self.commanding <= ENTRY_CYCLES {
            self.strategies.mirror(&measured, &held(&measured));
        }
        true
    }

    /// Returns why a datagram is doubted. FRI has no checksum: in command state, a single datagram must neither end that
    /// state, nor move the mirrored position, nor skip many sequence numbers; none changes the period.
    fn implausibility_of(
        &self,
        measured: &MeasurementDatagram,
        ticks: u16,
    ) -> Option<Implausibility> {
        if self.measured.state != SessionState::Command || self.last_sequence.is_none() {
            return None;
        }
        let mirrored = self.commanding <= ENTRY_CYCLES;
        let agrees = self.period.agrees(measured.measurement_period);
        match () {
            () if !agrees && measured.state == SessionState::Command => {
                Some(Implausibility::Period)
            }
            () if ticks > GAP_MAX => Some(Implausibility::Gap),
            () if mirrored && !is_near(measured, &self.measured, STILL_RAD) => {
                Some(Implausibility::Position)
            }
            () => changed(&self.measured, measured, agrees),
        }
    }

    /// Returns true if the previous datagram is unconfirmed and this one agrees with it.
    fn is_confirmed_by(&self, measured: &MeasurementDatagram) -> bool {
        self.unconfirmed.as_ref().is_some_and(|(unconfirmed, _)| {
            let ticks = measured
                .send_sequence
                .wrapping_sub(unconfirmed.send_sequence);
            let periods = [unconfirmed, measured].map(|datagram| datagram.measurement_period);
            let alike = self.period.are_alike(periods[0], periods[1]);
            changed(unconfirmed, measured, alike).is_none()
                && (1..=GAP_MAX).contains(&ticks)
                && is_near(unconfirmed, measured, NEAR_RAD)
        })
    }

    /// Returns why the last datagram was implausible, if it was refused for that reason.
    #[must_use]
    pub fn implausibility(&self) -> Option<Implausibility> {
        self.unconfirmed
            .as_ref()
            .map(|(_, implausibility)| *implausibility)
    }

    /// Returns the last accepted datagram.
    #[must_use]
    pub fn measured(&self) -> &MeasurementDatagram {
        &self.measured
    }

    /// Counts a datagram that does not come from the controller.
    pub fn refuse(&mut self) {
        self.refused += 1;
    }

    /// Resets the session after a silence: the next datagram may have any sequence number.
    pub fn reset(&mut self) {
        self.last_sequence = None;
        self.out_of_order = 0;
        self.commanding = 0;
        self.unconfirmed = None;
    }

    /// Stops requesting command mode.
    pub fn release(&mut self) {
        self.releasing = true;
    }

    /// Copies the newest measurement to `inputs` and returns the status of the exchange.
    pub fn exchange(&mut self, inputs: &mut Inputs) -> Exchange {
        let MeasurementDatagram {
            quality,
            miss_count,
            ..
        } = self.measured;
        self.fill(inputs);
        let reason = self.reason();
        let commandable = self.is_commandable();
        // Rounded to whole microseconds, since the wire has binary32.
        let period_us = (self.period.mean_s() * 1e6).round();
        let known = (100.0..=1e6).contains(&period_us);
        Exchange {
            commandable,
            startable: commandable && reason == 0,
            strategy: self.strategy().unwrap_or(ControlMode::Position),
            mirror: self.mirror(),
            ticks: std::mem::take(&mut self.ticks).max(1),
            period_ns: if known {
                period_us as u64 * 1000
            } else {
                1_000_000
            },
            quality_permille: [0, 333, 667, 1000][quality as usize % 4],
            reason,
            late: u64::try_from(i64::from(miss_count) + self.missed_before).unwrap_or(0),
            refused: self.refused,
        }
    }

    /// Returns the answer to the last datagram.
    pub fn answer(&mut self, outputs: &Outputs) -> [u8; CMD_SIZE] {
        self.own_sequence = self.own_sequence.wrapping_add(1);
        let finite = outputs.position.iter().all(|q| q.is_finite());
        let follows = self.is_commandable() && finite;
        let position = if follows {
            outputs.position
        } else {
            self.mirror()
        };
        let mut joint_position = [0.0; JOINTS];
        for (place, value) in joint_position.iter_mut().zip(position) {
            *place = value as f32;
        }
        let mut answer = CommandDatagram {
            send_sequence: self.own_sequence,
            reflected_sequence: self.last_sequence.unwrap_or(0),
            krl: self.krl(outputs),
            joint_position,
            ..CommandDatagram::default()
        };
        let strategy = self.strategy().unwrap_or(ControlMode::Position);
        let set_point = (&outputs.impedance, follows.then_some(&position));
        self.strategies.fill(&mut answer, strategy, set_point);
        answer.encode()
    }

    fn krl(&self, outputs: &Outputs) -> KrlBlock {
        let mut krl = KrlBlock::default();
        let [_, digital, _, analog] = &self.channels;
        for (channel, index) in digital.iter().zip(0..) {
            let on = (outputs.digital & outputs.digital_set) >> index & 1 == 1;
            if let Variable::Boolean(number) = channel.variable {
                krl.set_boolean(number, on);
            }
        }
        for (channel, value) in analog.iter().zip(outputs.analog) {
            if value.is_finite() {
                write_number(&mut krl, channel.variable, to_raw(&channel.config, value));
            }
        }
        if let Some(handshake) = self.settings.krl.handshake() {
            let default = handshake.needs_strategy.then_some(ControlMode::Position);
            let is_poor = self.measured.quality < self.settings.quality_min;
            // In command state a poor connection only keeps nets from starting: `Present` would end it while the arm may
            // move, since it is the same integer as `Stop` for some programs. The controller itself leaves it if need be.
            let is_commanding = self.measured.state == SessionState::Command;
            let request = match () {
                () if self.releasing => ModeRequest::Stop,
                () if is_poor && !is_commanding => ModeRequest::Present,
                () => ModeRequest::Start,
            };
            handshake.write(&mut krl, request, self.settings.strategy.or(default));
        }
        krl
    }

    /// Returns the position at which the controller holds the joints, rad.
    fn mirror(&self) -> Joints {
        held(&self.measured)
    }

    fn is_commandable(&self) -> bool {
        self.commanding > ENTRY_CYCLES && self.has_power() && self.strategy_reason() == 0
    }

    /// Returns the control mode that the controller runs, or `None` if the arm cannot be commanded in it.
    fn strategy(&self) -> Option<ControlMode> {
        self.strategies.runs(&self.measured)
    }

    /// Returns 0, or the reason why the arm cannot be commanded in the controller's strategy.
    fn strategy_reason(&self) -> u32 {
        match self.strategy() {
            None => STRATEGY,
            Some(ControlMode::CartesianImpedance) if !self.strategies.knows_the_tool() => POSE,
            Some(_) => 0,
        }
    }

    fn has_power(&self) -> bool {
        has_power(&self.measured)
    }

    fn reason(&self) -> u32 {
        let measured = &self.measured;
        match () {
            () if !self.has_power() => DRIVES_OFF,
            () if self.strategy_reason() != 0 => self.strategy_reason(),
            () if measured.quality < self.settings.quality_min => QUALITY,
            () if measured.state != SessionState::Command => MONITORING,
            () if self.commanding <= ENTRY_CYCLES => ENTERING,
            () => 0,
        }
    }

    fn fill(&self, inputs: &mut Inputs) {
        let measured = &self.measured;
        widen(&mut inputs.position, &measured.measured_position);
        widen(&mut inputs.torque, &measured.measured_torque);
        widen(&mut inputs.external_torque, &measured.external_torque);
        // KUKA's order is A, B, C: the rotations about z, y, x.
        let [fx, fy, fz, tz, ty, tx] = measured.external_tcp_wrench.map(f64::from);
        inputs.wrench = [fx, fy, fz, tx, ty, tz];
        let [digital, _, analog, _] = &self.channels;
        inputs.digital = 0;
        inputs.digital_known = 0;
        for (channel, index) in digital.iter().zip(0..) {
            if let Variable::Boolean(number) = channel.variable
                && let Some(on) = measured.krl.boolean(number)
            {
                inputs.digital |= u64::from(on) << index;
                inputs.digital_known |= 1 << index;
            }
        }
        for (channel, place) in analog.iter().zip(&mut inputs.analog) {
            let raw = channel.variable.raw(measured);
            *place = raw.map_or(f64::NAN, |raw| to_si(&channel.config, raw));
        }
    }
}

/// Returns the position at which the controller holds the joints, rad: its own position plus FRI's offset.
fn held(measured: &MeasurementDatagram) -> Joints {
    let mut held = [0.0; JOINTS_MAX];
    let own = measured.commanded_position;
    let added = measured.commanded_position_offset;
    for ((place, own), added) in held.iter_mut().zip(own).zip(added) {
        *place = f64::from(own) + f64::from(added);
    }
    held
}

fn is_near(one: &MeasurementDatagram, other: &MeasurementDatagram, bound_rad: f64) -> bool {
    let pairs = held(one).into_iter().zip(held(other));
    pairs
        .into_iter()
        .all(|(one, other)| (one - other).abs() <= bound_rad)
}

fn widen(to: &mut Joints, from: &[f32; JOINTS]) {
    for (to, from) in to.iter_mut().zip(from) {
        *to = f64::from(*from);
    }
}

/// Checks the fields that enter computations; the others may have any value.
fn is_finite(measured: &MeasurementDatagram) -> bool {
    measured
        .measured_position
        .iter()
        .chain(&measured.commanded_position)
        .chain(&measured.commanded_position_offset)
        .chain(&measured.external_tcp_wrench)
        .chain(&measured.external_torque)
        .chain(&measured.measured_torque)
        .all(|value| value.is_finite())
}

/// Writes the raw value of an analog output; a KRL integer is rounded, and its range was checked at start.
fn write_number(krl: &mut KrlBlock, variable: Variable, raw: f64) {
    match variable {
        Variable::Real(number) => {
            if let Some(place) = krl.reals.get_mut(number - 1) {
                *place = raw as f32;
            }
        }
        Variable::Integer(number) => {
            if let Some(place) = krl.integers.get_mut(number - 1) {
                *place = raw.round() as i32;
            }
        }
        Variable::Boolean(_) | Variable::Model(..) => {}
    }
}

/// Refuses outputs whose integers the handshake writes.
fn refuse_handshake_variables(
    device: &DeviceConfig,
    settings: &SessionSettings,
    outputs: &[KrlChannel],
) -> Result<(), DriverError> {
    let Some(handshake) = settings.krl.handshake() else {
        return Ok(());
    };
    let own = [handshake.request, handshake.strategy].map(Variable::Integer);
    let Some(taken) = outputs.iter().find(|output| own.contains(&output.variable)) else {
        return Ok(());
    };
    let cause = format!(
        "{} belongs to the handshake of settings.krl",
        taken.config.address
    );
    let expected = "an integer that the handshake does not write, or `krl: auto`";
    Err(channel_error(device, &taken.config, cause, expected))
}
