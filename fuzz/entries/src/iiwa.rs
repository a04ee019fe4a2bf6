//! Target `iiwa`: arbitrary and changed messages between the driver of the iiwa and its simulator, in every version, and lines to
//! the control port. Neither may panic; the simulated state remains finite, and what the driver answers can be read, with numbers
//! in it. Run by the thread of the target.

use std::sync::LazyLock;

use arbitrary::{Arbitrary, Result, Unstructured};
use rcc_config::{CellConfig, DeviceConfig};
use rcc_driver_kit::driver::{Exchange, Inputs, Outputs};
use rcc_drivers::drivers::fri_iiwa::session::{IiwaSession, SessionSettings};
use rcc_drivers::fri_iiwa::wire::schema::{Command, Monitoring};
use rcc_drivers::fri_iiwa::wire::{FriMessage, Quality, Version, decode, encode};
use rcc_drivers::sim::arm::impedance::{ControlLaw, ImpedanceSettings};
use rcc_drivers::sim::iiwa::cabinet::Cabinet;
use rcc_drivers::sim::iiwa::control::{CabinetRequest, ControlError};
use rcc_drivers::sim::iiwa::settings::{OverlayMode, Settings};
use rcc_drivers::sim::requests::{ControlAnswer, RequestError, to_line};

use crate::plan::real;
use crate::shipped::repository;

/// Maximum number of steps per input.
const STEPS_MAX: usize = 300;
/// Cycles after which a motion executes commands.
const ENTRY: usize = 200;

/// An iiwa whose springs are known, so that it takes every overlay.
static DEVICE: LazyLock<DeviceConfig> = LazyLock::new(|| {
    let cell = CellConfig::load_offline(&repository().join("configs/cells/iiwa-impedance.yaml"));
    let cell = cell.unwrap_or_else(|faults| panic!("{faults}"));
    let mut devices = cell.devices.into_iter();
    let mut device = devices
        .next()
        .unwrap_or_else(|| panic!("the cell has an arm"));
    // Version 1.11 has no inputs and outputs.
    device.channels.clear();
    device
});

/// The driver, and the simulated cabinet that it speaks with.
struct IiwaHarness {
    version: Version,
    cabinet: Cabinet,
    session: IiwaSession,
    /// Added to the position of the motion, rad.
    offset: f64,
}

/// The first bytes choose version and overlay; each step is one byte that selects an event, followed by the event's bytes.
pub fn run(data: &[u8]) {
    let mut bytes = Unstructured::new(data);
    let Ok(mut harness) = IiwaHarness::new(&mut bytes) else {
        return;
    };
    survives::<Monitoring>(harness.version, data);
    survives::<Command>(harness.version, data);
    for _ in 0..STEPS_MAX {
        if bytes.is_empty() || harness.apply_step(&mut bytes).is_err() {
            break;
        }
    }
    harness.check();
}

/// A message that can be read is the same after it was written and read again.
fn survives<M: FriMessage>(version: Version, data: &[u8]) {
    let message = decode::<M>(version, data);
    let Ok(written) = message.and_then(|message| encode(version, &message)) else {
        return;
    };
    let again = decode::<M>(version, &written).and_then(|again| encode(version, &again));
    assert!(again.is_ok_and(|again| again == written), "{version:?}");
}

impl IiwaHarness {
    fn new(bytes: &mut Unstructured<'_>) -> Result<Self> {
        use OverlayMode::{CartesianPose, Position, Torque, Wrench};
        let version =
            *bytes.choose(&[Version::V1_11, Version::V1_14, Version::V2_5, Version::V2_7])?;
        let overlay = *bytes.choose(&[Position, Wrench, Torque, CartesianPose])?;
        let overlay = if overlay == CartesianPose && !version.is_second() {
            Position
        } else {
            overlay
        };
        let law = overlay.needed_law().unwrap_or(ControlLaw::Position);
        let cabinet = Cabinet::new(Settings {
            version,
            overlay,
            law,
            impedance: ImpedanceSettings::default_for(law),
            multiplier: bytes.int_in_range(1..=3)?,
            ..Settings::default()
        });
        let settings = SessionSettings {
            version,
            quality_min: Quality::Good,
        };
        let session = IiwaSession::new(&DEVICE, settings);
        let mut harness = Self {
            version,
            cabinet,
            session: session.unwrap_or_else(|error| panic!("{error}")),
            offset: 0.0,
        };
        for _ in 0..ENTRY {
            harness.exchange(|_| {}, |_| {});
        }
        Ok(harness)
    }

    fn apply_step(&mut self, bytes: &mut Unstructured<'_>) -> Result<()> {
        match bytes.int_in_range(0..=11)? {
            0 => {
                let change = Change::of(bytes)?;
                self.exchange(|message| change.apply(message), |_| {});
            }
            1 => {
                let change = Change::of(bytes)?;
                self.exchange(|_| {}, |answer| change.apply(answer));
            }
            2 => {
                let length = bytes.int_in_range(0..=96)?;
                // Refused messages are tried too.
                let _ = self
                    .cabinet
                    .receive(bytes.bytes(length.min(bytes.len()))?, 1e-4);
            }
            3 => {
                let length = bytes.int_in_range(0..=96)?;
                // As above.
                let _ = self.session.accept(bytes.bytes(length.min(bytes.len()))?);
            }
            4 => {
                let length = bytes.int_in_range(0..=96)?;
                let line =
                    String::from_utf8_lossy(bytes.bytes(length.min(bytes.len()))?).into_owned();
                self.send_line(&line);
            }
            5 => self.send_line(bytes.choose(&[
                "\"estop\"",
                "\"ack\"",
                "{\"session\":{\"open\":false}}",
                "{\"session\":{\"open\":true}}",
                "\"stop_motion\"",
                "\"start_motion\"",
                "{\"safety\":\"stop0\"}",
                "{\"mode\":\"t1\"}",
                "\"clear\"",
            ])?),
            6 => drop(self.cabinet.tick(bytes.int_in_range(1..=2000)?)),
            7 => self.offset = f64::from(i16::arbitrary(bytes)?) * 1e-6,
            8 => self.offset = real(bytes)?,
            9 => self.session.reset(),
            10 => self.cabinet.receive_foreign(),
            _ => {}
        }
        for _ in 0..bytes.int_in_range(0..=15)? {
            self.exchange(|_| {}, |_| {});
        }
        Ok(())
    }

    /// Runs one cycle, with the message and its answer changed on their ways.
    fn exchange(&mut self, there: impl Fn(&mut Vec<u8>), back: impl Fn(&mut Vec<u8>)) {
        let Some(mut message) = self.cabinet.tick(1) else {
            return;
        };
        there(&mut message);
        if self.session.accept(&message).is_err() {
            return;
        }
        let exchange = self.session.exchange(&mut Inputs::NONE.clone());
        let outputs = self.outputs(&exchange);
        let Some(answer) = self.session.answer(&outputs) else {
            return;
        };
        let mut answer = answer.to_vec();
        let command: Command =
            decode(self.version, &answer).unwrap_or_else(|error| panic!("{error}"));
        let data = command.data.unwrap_or_default();
        let positions = data.position.iter().flat_map(|joints| &joints.value);
        let poses = data.pose.iter().flat_map(|pose| &pose.element);
        assert!(
            positions.chain(poses).all(|value| value.is_finite()),
            "{outputs:?}"
        );
        back(&mut answer);
        // Refused messages are tried too.
        let _ = self.cabinet.receive(&answer, 1e-4);
    }

    fn outputs(&self, exchange: &Exchange) -> Outputs {
        let mut position = exchange.mirror;
        // The driver's host sends numbers only.
        if exchange.commandable && self.offset.is_finite() {
            position[0] += self.offset;
        }
        Outputs {
            position,
            ..Outputs::NONE
        }
    }

    fn send_line(&mut self, line: &str) {
        let answer = serde_json::from_str::<CabinetRequest>(line)
            .map_err(|error| ControlError::from(RequestError::from(error)))
            .and_then(|request| self.cabinet.execute(request));
        assert!(!to_line(answer).contains('\n'), "an answer is one line");
    }

    fn check(&self) {
        let snapshot = self.cabinet.snapshot();
        let robot = &snapshot.robot;
        let mut values = robot.q.iter().chain(&robot.velocity);
        assert!(values.all(|value| value.is_finite()), "{snapshot:?}");
        let answer = Ok::<_, ControlError>(ControlAnswer::State(Box::new(snapshot)));
        assert!(!to_line(answer).contains('\n'));
    }
}

/// A change of a datagram on its way.
#[derive(Debug)]
enum Change {
    Byte { at: u16, value: u8 },
    Cut { length: u16 },
    Longer { by: Vec<u8> },
    Other { bytes: Vec<u8> },
}

impl Change {
    fn of(bytes: &mut Unstructured<'_>) -> Result<Self> {
        let (at, value) = (u16::arbitrary(bytes)?, u8::arbitrary(bytes)?);
        let some = |bytes: &mut Unstructured<'_>| {
            let length = usize::from(value).min(bytes.len());
            bytes.bytes(length).map(<[u8]>::to_vec)
        };
        Ok(match bytes.int_in_range(0..=3)? {
            0 => Self::Byte { at, value },
            1 => Self::Cut { length: at },
            2 => Self::Longer { by: some(bytes)? },
            _ => Self::Other {
                bytes: some(bytes)?,
            },
        })
    }

    fn apply(&self, datagram: &mut Vec<u8>) {
        match self {
            Self::Byte { at, value } => {
                let length = datagram.len().max(1);
                if let Some(byte) = datagram.get_mut(usize::from(*at) % length) {
                    *byte = *value;
                }
            }
            Self::Cut { length } => datagram.truncate(usize::from(*length)),
            Self::Longer { by } => datagram.extend_from_slice(by),
            Self::Other { bytes } => datagram.clone_from(bytes),
        }
    }
}
