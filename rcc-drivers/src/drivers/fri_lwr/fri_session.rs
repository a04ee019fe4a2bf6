//! What is said to the controller, datagram by datagram: sequence numbers, mirroring, the KRL handshake, I/O.
//! Pure, without clock or socket; run by the host's thread.
//!
//! While the controller does not command, and in the first cycles in which it does, every answer repeats the
//! controller's own position: it refuses to begin otherwise.

use rcc_config::{ChannelConfig, DeviceConfig};
use rcc_core::impedance::ControlMode;
use rcc_core::message::{JOINTS_MAX, Joints};
use rcc_core::primitive::ChannelKind;

use super::strategy::StrategyEncoder;
use super::{DRIVES_OFF, ENTERING, MONITORING, POSE, QUALITY, STRATEGY};
use crate::driver::{
    DriverError, Exchange, Inputs, Outputs, channel_error, channels, to_raw, to_si,
};
use crate::fri_lwr::wire::{
    CMD_SIZE, CommandDatagram, FriControlStrategy, JOINTS, KrlBlock, MeasurementDatagram, Quality,
    SessionState,
};

/// Cycles of command state in which we still mirror.
const ENTRY_CYCLES: u32 = 3;
/// After so many datagrams in a row from the past the controller has begun to count anew.
const RESTART_DATAGRAMS: u32 = 10;
/// More datagrams than this are not lost at once, unless the next one confirms it: our own stalls lose none.
const GAP_MAX: u16 = 10;
/// Largest move of the controller's own position while command state begins, rad: it rests, only rounding is seen.
const STILL_RAD: f64 = 1e-5;
/// Largest move of it from one datagram to the next in any state, rad.
const NEAR_RAD: f64 = 0.01;
/// `$FRI_FRM_INT[1]` as in KUKA's first sample.
const LEAVE: i32 = 0;
/// We are there, but the connection is not good enough yet.
const PRESENT: i32 = 1;
/// Command mode, please.
const ENTER: i32 = 10;

/// The convention between the PC and the KRL program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KrlConvention {
    /// KUKA's first sample: `$FRI_FRM_INT[1]` is 1, then 10 for command mode; 0 leaves it.
    FirstApp,
    /// The KRL program decides alone.
    Auto,
}

/// A channel and its KRL variable, counted from 1.
#[derive(Clone, Debug)]
struct KrlChannel {
    number: usize,
    config: ChannelConfig,
}

/// The session with one controller.
#[derive(Clone, Debug)]
pub struct FriSession {
    script: KrlConvention,
    quality_min: Quality,
    strategies: StrategyEncoder,
    /// By kind: digital in, digital out, analog in, analog out.
    channels: [Vec<KrlChannel>; 4],
    measured: MeasurementDatagram,
    last_sequence: Option<u16>,
    out_of_order: u32,
    ticks: u64,
    own_sequence: u16,
    /// Cycles of command state in a row.
    commanding: u32,
    releasing: bool,
    refused: u64,
    /// Contradicts the command state that we are in; believed once the next one says the same.
    unconfirmed: Option<MeasurementDatagram>,
    /// Missed answers of controllers before this one, minus what this one had at the beginning.
    missed_before: i64,
}

impl FriSession {
    /// A session that has not begun.
    ///
    /// # Errors
    /// The device has no arm of 7 joints, or a channel is no KRL variable.
    pub fn new(
        device: &DeviceConfig,
        script: KrlConvention,
        quality_min: Quality,
    ) -> Result<Self, DriverError> {
        if device.robot.as_ref().map(|robot| robot.joints.len()) != Some(JOINTS) {
            return Err(DriverError::Robot {
                device: device.name.clone(),
                cause: "the LWR has 7 joints: name a robot file with 7, such as robots/lwr4plus.yaml",
            });
        }
        let of = |kind| krl_channels(device, kind);
        Ok(Self {
            script,
            quality_min,
            strategies: StrategyEncoder::of(device),
            channels: [
                of(ChannelKind::DigitalInput)?,
                of(ChannelKind::DigitalOutput)?,
                of(ChannelKind::AnalogInput)?,
                of(ChannelKind::AnalogOutput)?,
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

    /// Takes a datagram from the controller in; false if it is refused (size, identity, order, numbers).
    pub fn accept(&mut self, bytes: &[u8]) -> bool {
        let Ok(measured) = MeasurementDatagram::decode(bytes) else {
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
        if self.is_implausible(&measured, ticks) && !self.is_confirmed_by(&measured) {
            self.refuse();
            self.unconfirmed = Some(measured);
            return false;
        }
        self.unconfirmed = None;
        let misses = i64::from(measured.miss_count);
        if self.last_sequence.is_none() {
            self.missed_before += i64::from(self.measured.miss_count) - misses;
            self.ticks = 1;
        } else {
            self.ticks += u64::from(ticks);
        }
        self.out_of_order = 0;
        self.last_sequence = Some(measured.send_sequence);
        // In another strategy, command state begins anew.
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

    /// The wire has no check of its own: in command state a single datagram neither ends it, nor changes the period, nor
    /// moves the position that is mirrored, nor leaves many others out.
    fn is_implausible(&self, measured: &MeasurementDatagram, ticks: u16) -> bool {
        let commanded =
            self.measured.state == SessionState::Command && self.last_sequence.is_some();
        let mirrored = self.commanding <= ENTRY_CYCLES;
        commanded
            && (mode(measured) != mode(&self.measured)
                || ticks > GAP_MAX
                || (mirrored && !is_near(measured, &self.measured, STILL_RAD)))
    }

    /// The datagram before this one was unconfirmed, and this one says the same.
    fn is_confirmed_by(&self, measured: &MeasurementDatagram) -> bool {
        self.unconfirmed.is_some_and(|unconfirmed| {
            let ticks = measured
                .send_sequence
                .wrapping_sub(unconfirmed.send_sequence);
            mode(&unconfirmed) == mode(measured)
                && (1..=GAP_MAX).contains(&ticks)
                && is_near(&unconfirmed, measured, NEAR_RAD)
        })
    }

    /// The last datagram that was taken in.
    #[must_use]
    pub fn measured(&self) -> &MeasurementDatagram {
        &self.measured
    }

    /// Counts a datagram that is not the controller's.
    pub fn refuse(&mut self) {
        self.refused += 1;
    }

    /// The controller has been silent: the next one may count from anywhere.
    pub fn reset(&mut self) {
        self.last_sequence = None;
        self.out_of_order = 0;
        self.commanding = 0;
        self.unconfirmed = None;
    }

    /// From now on command mode is no longer asked for.
    pub fn release(&mut self) {
        self.releasing = true;
    }

    /// What has been measured since the last time.
    pub fn exchange(&mut self, inputs: &mut Inputs) -> Exchange {
        let MeasurementDatagram {
            quality,
            miss_count,
            measurement_period,
            ..
        } = self.measured;
        self.fill(inputs);
        let reason = self.reason();
        let commandable = self.is_commandable();
        // To whole microseconds: the wire has binary32.
        let period_us = (f64::from(measurement_period) * 1e6).round();
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

    /// The answer to the last datagram.
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
        let told = (&outputs.impedance, follows.then_some(&position));
        self.strategies.fill(&mut answer, strategy, told);
        answer.encode()
    }

    fn krl(&self, outputs: &Outputs) -> KrlBlock {
        let mut krl = KrlBlock::default();
        let [_, digital, _, analog] = &self.channels;
        for (channel, index) in digital.iter().zip(0..) {
            let on = (outputs.digital & outputs.digital_set) >> index & 1 == 1;
            krl.set_boolean(channel.number, on);
        }
        for (channel, value) in analog.iter().zip(outputs.analog) {
            if let (Some(place), true) = (krl.reals.get_mut(channel.number - 1), value.is_finite())
            {
                *place = to_raw(&channel.config, value) as f32;
            }
        }
        krl.integers[0] = match self.script {
            KrlConvention::Auto => 0,
            KrlConvention::FirstApp if self.releasing => LEAVE,
            KrlConvention::FirstApp if self.measured.quality < self.quality_min => PRESENT,
            KrlConvention::FirstApp => ENTER,
        };
        krl
    }

    /// Where the controller holds the joints, rad.
    fn mirror(&self) -> Joints {
        held(&self.measured)
    }

    fn is_commandable(&self) -> bool {
        self.commanding > ENTRY_CYCLES && self.has_power() && self.strategy_reason() == 0
    }

    /// The control strategy that the controller runs, if the arm can be commanded in it.
    fn strategy(&self) -> Option<ControlMode> {
        self.strategies.runs(&self.measured)
    }

    /// 0, or why the arm cannot be commanded in the controller's strategy.
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
            () if measured.quality < self.quality_min => QUALITY,
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
        // On the wire A, B, C turn about z, y, x.
        let [fx, fy, fz, tz, ty, tx] = measured.external_tcp_wrench.map(f64::from);
        inputs.wrench = [fx, fy, fz, tx, ty, tz];
        let [digital, _, analog, _] = &self.channels;
        inputs.digital = 0;
        inputs.digital_known = 0;
        for (channel, index) in digital.iter().zip(0..) {
            if let Some(on) = measured.krl.boolean(channel.number) {
                inputs.digital |= u64::from(on) << index;
                inputs.digital_known |= 1 << index;
            }
        }
        for (channel, place) in analog.iter().zip(&mut inputs.analog) {
            let raw = measured.krl.reals.get(channel.number - 1);
            *place = raw.map_or(f64::NAN, |raw| to_si(&channel.config, f64::from(*raw)));
        }
    }
}

fn has_power(measured: &MeasurementDatagram) -> bool {
    measured.power != 0 && measured.error == 0
}

/// Where the controller holds the joints, rad: its own position and what has been added to it.
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

/// What does not change while the controller commands.
fn mode(measured: &MeasurementDatagram) -> (SessionState, FriControlStrategy, bool, u32) {
    (
        measured.state,
        measured.control,
        has_power(measured),
        measured.measurement_period.to_bits(),
    )
}

fn widen(to: &mut Joints, from: &[f32; JOINTS]) {
    for (to, from) in to.iter_mut().zip(from) {
        *to = f64::from(*from);
    }
}

/// What is computed with must be a number; the rest may be what it likes.
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

fn krl_channels(device: &DeviceConfig, kind: ChannelKind) -> Result<Vec<KrlChannel>, DriverError> {
    let expected = "the number of a KRL variable, 1 to 16, that no other channel of this kind has";
    let mut found: Vec<KrlChannel> = Vec::new();
    for channel in channels(device, kind) {
        let number = channel
            .address
            .as_u64()
            .and_then(|number| usize::try_from(number).ok())
            .filter(|number| (1..=16).contains(number));
        let number = number.ok_or_else(|| {
            let cause = format!("there is no KRL variable {}", channel.address);
            channel_error(device, channel, cause, expected)
        })?;
        if let Some(other) = found.iter().find(|other| other.number == number) {
            let cause = format!("'{}' has number {number}, too", other.config.name);
            return Err(channel_error(device, channel, cause, expected));
        }
        found.push(KrlChannel {
            number,
            config: channel.clone(),
        });
    }
    Ok(found)
}
