//! Target `fri`: arbitrary datagrams to the FRI driver, and arbitrary command images. It must not panic, and while the
//! robot follows, no set-point may leave its limits. Run by the thread of the target.

use std::sync::LazyLock;

use arbitrary::{Arbitrary, Result, Unstructured};
use rcc_core::message::{CommandImage, JOINTS_MAX, Joints, SET_POINTS, SetPoint};
use rcc_driver_kit::driver::Inputs;
use rcc_driver_kit::host::device_session::DeviceSession;
use rcc_drivers::drivers::fri_lwr::fri_session::{FriSession, SessionSettings};
use rcc_drivers::fri_lwr::wire::{
    CommandDatagram, FriControlStrategy, MeasurementDatagram, Quality, SessionState,
};

use crate::plan::real;
use crate::set_point_checker::SetPointChecker;
use crate::shipped::{HOLD, shipped};

const MS: u64 = 1_000_000;
/// Maximum number of steps per input.
const STEPS_MAX: usize = 400;
/// Rounding error of a joint position in binary32, rad.
const BINARY32: f64 = 2.0e-7;

/// A simulated controller, the driver under test, and a simulated executor.
#[derive(Clone)]
struct FriHarness {
    fri: FriSession,
    session: DeviceSession,
    datagram: MeasurementDatagram,
    image: CommandImage,
    executor: bool,
    now_ns: u64,
    checker: SetPointChecker,
    /// Motion of joint 1 per cycle, rad; `None` if nothing is commanded.
    step_rad: Option<f64>,
    set_point: Joints,
    /// True if the executor writes one set-point per cycle, in order.
    regular: bool,
}

/// A driver that has just entered command mode, with an executor that commands nothing.
static READY: LazyLock<FriHarness> = LazyLock::new(|| {
    let (_, device) = shipped()
        .cell
        .device("lwr")
        .unwrap_or_else(|| panic!("the demo has an lwr"));
    let fri = FriSession::new(device, SessionSettings::default());
    let mut datagram = MeasurementDatagram {
        state: SessionState::Command,
        quality: Quality::Perfect,
        control: FriControlStrategy::Position,
        power: 0x7f,
        measurement_period: 1e-3,
        command_period: 1e-3,
        ..MeasurementDatagram::default()
    };
    for (joint, hold) in HOLD.iter().take(7).enumerate() {
        datagram.measured_position[joint] = *hold as f32;
        datagram.commanded_position[joint] = *hold as f32;
    }
    let mut harness = FriHarness {
        fri: fri.unwrap_or_else(|error| panic!("{error}")),
        session: DeviceSession::new(device, 0),
        datagram,
        image: CommandImage::new(1, MS),
        executor: true,
        now_ns: 1_000 * MS,
        checker: SetPointChecker::new(shipped().models[0].limits, BINARY32),
        step_rad: None,
        set_point: [0.0; JOINTS_MAX],
        regular: true,
    };
    for _ in 0..20 {
        harness.step();
    }
    harness
});

/// Each step is one byte that selects an event, followed by the event's bytes.
pub fn run(data: &[u8]) {
    if let Ok(datagram) = MeasurementDatagram::decode(data) {
        let again = MeasurementDatagram::decode(&datagram.encode());
        assert!(again.is_ok_and(|again| again.encode() == datagram.encode()));
    }
    if let Ok(datagram) = CommandDatagram::decode(data) {
        let again = CommandDatagram::decode(&datagram.encode());
        assert!(again.is_ok_and(|again| again.encode() == datagram.encode()));
    }
    let mut bytes = Unstructured::new(data);
    let mut harness = READY.clone();
    for _ in 0..STEPS_MAX {
        if bytes.is_empty() || harness.apply_step(&mut bytes).is_err() {
            return;
        }
    }
}

impl FriHarness {
    fn apply_step(&mut self, bytes: &mut Unstructured<'_>) -> Result<()> {
        match bytes.int_in_range(0..=23)? {
            0 => self.step_rad = None,
            1 => self.step_rad = Some(f64::from(i16::arbitrary(bytes)?) * 1e-7),
            2 => self.step_rad = Some(real(bytes)?),
            3 => self.exchange_corrupted(bytes)?,
            4 => {
                self.datagram.state = *bytes.choose(&[
                    SessionState::Off,
                    SessionState::Monitor,
                    SessionState::Command,
                ])?
            }
            5 => {
                self.datagram.quality =
                    *bytes.choose(&[Quality::Unacceptable, Quality::Bad, Quality::Perfect])?
            }
            6 => {
                self.datagram.control =
                    *bytes.choose(&[FriControlStrategy::Other, FriControlStrategy::Position])?
            }
            7 => (self.datagram.power, self.datagram.error) = <_>::arbitrary(bytes)?,
            8 => self.datagram.send_sequence = u16::arbitrary(bytes)?,
            9 => self.datagram.measurement_period = real(bytes)? as f32,
            10 => {
                self.datagram.commanded_position[bytes.int_in_range(0..=6)?] = real(bytes)? as f32
            }
            11 => self.datagram.measured_position[bytes.int_in_range(0..=6)?] = real(bytes)? as f32,
            12 => self.executor = bool::arbitrary(bytes)?,
            13 => self.corrupt_image(bytes)?,
            14 => self.now_ns += u64::from(u16::arbitrary(bytes)?) * MS / 16,
            15 => self.report_silence(),
            16 => self.fri.reset(),
            17 => self.regular = bool::arbitrary(bytes)?,
            18 if u8::arbitrary(bytes)? == 0 => self.session.terminate(),
            _ => {}
        }
        for _ in 0..=bytes.int_in_range(0..=15)? {
            self.step();
        }
        Ok(())
    }

    /// Sends a datagram with some bytes overwritten.
    fn exchange_corrupted(&mut self, bytes: &mut Unstructured<'_>) -> Result<()> {
        let mut datagram = self.datagram.encode();
        let at = bytes.int_in_range(0..=datagram.len() - 1)?;
        let length = bytes.int_in_range(0..=64)?;
        for place in datagram.iter_mut().skip(at).take(length) {
            *place = u8::arbitrary(bytes)?;
        }
        self.exchange(&datagram);
        Ok(())
    }

    fn report_silence(&mut self) {
        self.session.handle_link_error(self.now_ns, Some(105));
        // An arm in motion that answers again at once goes on from there.
        if !self.session.is_online_arm() {
            self.checker.forget();
        }
    }

    fn corrupt_image(&mut self, bytes: &mut Unstructured<'_>) -> Result<()> {
        let at = bytes.int_in_range(0..=SET_POINTS - 1)?;
        let point = &mut self.image.set_points[at];
        match bytes.int_in_range(0..=9)? {
            0 => self.image.head.magic = u64::arbitrary(bytes)?,
            1 => self.image.head.executor = u64::arbitrary(bytes)?,
            2 => self.image.head.sequence = u64::arbitrary(bytes)?,
            3 => self.image.head.stamp_ns = u64::arbitrary(bytes)?,
            4 => self.image.head.period_ns = u64::arbitrary(bytes)?,
            5 => point.logical_ns = u64::arbitrary(bytes)?,
            6 => (point.owner, point.has_position) = <_>::arbitrary(bytes)?,
            7 => point.position[bytes.int_in_range(0..=7)?] = real(bytes)?,
            8 => point.analog[bytes.int_in_range(0..=15)?] = real(bytes)?,
            _ => (point.digital, point.digital_commanded) = <_>::arbitrary(bytes)?,
        }
        Ok(())
    }

    /// Runs one millisecond: the executor's cycle, and a datagram of the controller.
    fn step(&mut self) {
        self.now_ns = self.now_ns.saturating_add(MS);
        if self.regular {
            self.write();
        }
        self.datagram.send_sequence = self.datagram.send_sequence.wrapping_add(1);
        let bytes = self.datagram.encode();
        self.exchange(&bytes);
    }

    fn write(&mut self) {
        let image = &mut self.image;
        match self.step_rad {
            None => self.set_point = self.session.measurement().hold,
            Some(step) => self.set_point[0] += step,
        }
        let point = SetPoint {
            owner: u64::from(self.step_rad.is_some()),
            has_position: u64::from(self.step_rad.is_some()),
            position: self.set_point,
            ..SetPoint::NONE
        };
        image.push(image.head.sequence.wrapping_add(1), self.now_ns, point);
    }

    fn exchange(&mut self, bytes: &[u8]) {
        let image = self.executor.then_some(&self.image);
        self.session.observe(self.now_ns, image);
        if !self.fri.accept(bytes) {
            return;
        }
        let mut inputs = Inputs::NONE;
        let exchange = self.fri.exchange(&mut inputs);
        let outputs = self.session.exchange(self.now_ns, &inputs, &exchange);
        let answer = CommandDatagram::decode(&self.fri.answer(&outputs));
        let answer = answer.unwrap_or_else(|error| panic!("the answer is a datagram: {error}"));
        let mut told = [0.0; JOINTS_MAX];
        for (to, from) in told.iter_mut().zip(answer.joint_position) {
            *to = f64::from(from);
        }
        if exchange.commandable {
            let dt_s = exchange.ticks as f64 * exchange.period_ns as f64 * 1e-9;
            self.checker.follow(&told, dt_s);
        } else {
            // While it is not commandable, the controller holds its own position, and motions start there.
            assert_eq!(told.map(|q| q as f32), exchange.mirror.map(|q| q as f32));
            self.checker.rests(&told);
        }
    }
}
