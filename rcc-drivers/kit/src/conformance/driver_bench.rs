//! Executor, device session, driver, proxy and subject in one virtual time: the executor has one cycle of 1 ms per
//! exchange.
//! Test code only; the clock is the device's, counted in its periods.

use std::time::Duration;

use rcc_config::{DeviceConfig, OnRelease};
use rcc_core::message::{ANALOG_MAX, CommandImage, DeviceState, Joints, Measurement, SetPoint};
use rcc_core::primitive::ChannelKind;

use super::fault_path::FaultPath;
use super::limit_checker::LimitChecker;
use super::{ObservedOutputs, Subject, TIMEOUT, Transport};
use crate::driver::{Driver, Exchange, Inputs, LinkError};
use crate::host::device_session::DeviceSession;
use crate::host::limits::ArmLimits;
use crate::host::reason::HOST_REASONS;
use crate::proxy::FaultRates;

const MS: u64 = 1_000_000;
/// Number of exchanges within which an expected event must happen.
pub const PATIENCE: usize = 8000;

/// Behaviour of the executor in one cycle.
#[expect(
    clippy::large_enum_variant,
    reason = "one at a time, on the stack of a test"
)]
#[derive(Clone, Copy, Debug)]
pub enum ExecutorAction {
    /// Writes this set-point.
    Writes(SetPoint),
    /// Is present but writes nothing, as when it hangs.
    Hangs,
    /// Is absent.
    Absent,
}

/// Test bench around one driver.
pub struct DriverBench<S: Subject> {
    /// The device.
    pub subject: S,
    /// The driver.
    pub driver: S::Driver,
    /// The session that the host would run.
    pub session: DeviceSession,
    /// Configuration of the device.
    pub device: DeviceConfig,
    /// The fault proxy between driver and device.
    pub path: FaultPath,
    /// The newest inputs.
    pub inputs: Inputs,
    /// Checks the set-points that the device follows.
    pub checker: LimitChecker,
    /// Set-points that the device has received, one row per exchange.
    pub followed: Vec<Joints>,
    /// Result of the last exchange.
    pub last: Result<Exchange, LinkError>,
    image: Box<CommandImage>,
    now_ns: u64,
}

impl<S: Subject> DriverBench<S> {
    /// A new driver for a new device.
    pub fn new(seed: u64) -> Self {
        let mut subject = S::start();
        let (path, address) = FaultPath::of(&mut subject, seed);
        let device = S::device(address);
        let driver = S::Driver::open(&device).expect("the subject's configuration is right");
        Self {
            subject,
            driver,
            session: DeviceSession::new(&device, 0),
            checker: LimitChecker::new(ArmLimits::of(&device)),
            device,
            path,
            inputs: Inputs::NONE,
            followed: Vec::new(),
            last: Err(LinkError::Silent),
            image: Box::new(CommandImage::new(1, MS)),
            now_ns: 0,
        }
    }

    /// As [`DriverBench::new`], but with an executor and ready for a net.
    pub fn ready(seed: u64) -> Self {
        let mut bench = Self::new(seed);
        bench.until_ready();
        bench.followed.clear();
        bench
    }

    /// Kills the driver and starts another one.
    pub fn restart_driver(self) -> Self {
        let Self { device, driver, .. } = self;
        // The address is free only after the old driver has been dropped.
        drop(driver);
        let driver = S::Driver::open(&device).expect("the same configuration as before");
        Self {
            session: DeviceSession::new(&device, self.now_ns),
            driver,
            device,
            subject: self.subject,
            path: self.path,
            inputs: Inputs::NONE,
            checker: self.checker,
            followed: Vec::new(),
            last: Err(LinkError::Silent),
            image: self.image,
            now_ns: self.now_ns,
        }
    }

    /// Performs one exchange, or one receive that times out.
    pub fn step(&mut self, executor: ExecutorAction) {
        let pumped = S::TRANSPORT == Transport::UdpFromDevice;
        self.now_ns += MS;
        self.subject.before_receive();
        self.path.step();
        let timeout = if pumped {
            Duration::from_millis(1)
        } else {
            TIMEOUT
        };
        self.last = self.driver.receive(timeout, &mut self.inputs);
        self.write(executor);
        let image = match executor {
            ExecutorAction::Absent => None,
            _ => Some(&*self.image),
        };
        self.session.observe(self.now_ns, image);
        match self.last {
            Ok(exchange) => {
                self.check(&exchange);
                let outputs = self.session.exchange(self.now_ns, &self.inputs, &exchange);
                if let Err(error) = self.driver.send(&outputs) {
                    self.report_link_error(error);
                    self.last = Err(error);
                }
            }
            Err(error) => self.report_link_error(error),
        }
        self.check_answers();
        self.subject.after_exchange();
    }

    /// Steps until `done` returns true, at most [`PATIENCE`] times.
    pub fn until(
        &mut self,
        executor: ExecutorAction,
        what: &str,
        mut done: impl FnMut(&mut Self) -> bool,
    ) {
        for _ in 0..PATIENCE {
            self.step(executor);
            if done(self) {
                return;
            }
        }
        let measured = self.measured();
        panic!(
            "never: {what}; {} with reason {}, the last exchange: {:?}",
            DeviceState::from_number(measured.state).name(),
            measured.reason,
            self.last
        );
    }

    /// Steps with nulls until a net may start.
    pub fn until_ready(&mut self) {
        self.until(ExecutorAction::Writes(SetPoint::NONE), "ready", |bench| {
            bench.state() == DeviceState::Ready
        });
    }

    /// Returns the measurement that the executor reads.
    pub fn measured(&self) -> &Measurement {
        self.session.measurement()
    }

    /// Returns the state of the device.
    pub fn state(&self) -> DeviceState {
        DeviceState::from_number(self.measured().state)
    }

    /// Returns a set-point in which every output differs from its safe value; arms are not commanded.
    pub fn all_on(&self, owner: u64) -> SetPoint {
        all_on(&self.device, owner)
    }

    /// Returns true if the device has received the outputs of [`DriverBench::all_on`] or, if not `on`, those of their
    /// release.
    pub fn outputs_are_as(&mut self, on: bool) -> bool {
        let outputs = self.subject.outputs();
        outputs_are(&self.device, &outputs, on)
    }

    fn report_link_error(&mut self, error: LinkError) {
        let lost = match error {
            LinkError::Silent => None,
            LinkError::Lost { reason } => {
                assert!(self.is_known(reason), "unknown reason {reason}");
                Some(reason)
            }
        };
        self.session.handle_link_error(self.now_ns, lost);
    }

    fn is_known(&self, reason: u32) -> bool {
        let own = self.driver.reasons().unwrap_or(S::REASONS);
        let mut rows = HOST_REASONS.iter().chain(own);
        rows.any(|row| row.0 == reason)
    }

    /// Checks the invariants of every exchange.
    fn check(&self, exchange: &Exchange) {
        assert!(
            exchange.ticks >= 1 && exchange.period_ns > 0,
            "{exchange:?}"
        );
        assert!(exchange.quality_permille <= 1000, "{exchange:?}");
        assert!(exchange.commandable || !exchange.startable, "{exchange:?}");
        assert_eq!(exchange.startable, exchange.reason == 0, "{exchange:?}");
        assert!(
            exchange.reason == 0 || self.is_known(exchange.reason),
            "{exchange:?}"
        );
        let Inputs {
            position, wrench, ..
        } = &self.inputs;
        let mut numbers = exchange.mirror.iter().chain(position);
        assert!(numbers.all(|value| value.is_finite()), "{:?}", self.inputs);
        let unknown = wrench.iter().all(|value| value.is_nan());
        let known = wrench.iter().all(|value| value.is_finite());
        assert!(known || unknown, "{:?}", self.inputs);
        let [digital, _, analog, _] = self.device.model().channels;
        let all = 1_u64.checked_shl(digital).map_or(u64::MAX, |bit| bit - 1);
        assert_eq!(self.inputs.digital_known & !all, 0, "{:?}", self.inputs);
        let mut beyond = self.inputs.analog.iter().skip(analog as usize);
        assert!(beyond.all(|value| value.is_nan()), "{:?}", self.inputs);
    }

    fn write(&mut self, executor: ExecutorAction) {
        if let ExecutorAction::Writes(entry) = executor {
            let next = self.image.head.sequence + 1;
            self.image.push(next, self.now_ns, entry);
        }
    }

    /// Checks the set-points that the driver has sent.
    fn check_answers(&mut self) {
        for packet in self.path.answers() {
            match self.subject.followed(&packet) {
                Some(position) => {
                    self.checker.observe(self.now_ns as f64 * 1e-9, &position);
                    self.followed.push(position);
                }
                None => self.checker.forget(),
            }
        }
    }

    /// Sets the fault rates in both directions, from now on.
    pub fn set_rates(&mut self, to_driver: FaultRates, to_device: FaultRates) {
        self.path.set_rates(to_driver, to_device);
    }
}

/// Returns a set-point in which every output differs from its safe value.
pub fn all_on(device: &DeviceConfig, owner: u64) -> SetPoint {
    let mut entry = SetPoint {
        owner,
        ..SetPoint::NONE
    };
    for (channel, bit) in device.channels_of(ChannelKind::DigitalOutput).zip(0..) {
        entry.digital_commanded |= 1 << bit;
        if channel.on_release != Some(OnRelease::Safe(1.0)) {
            entry.digital |= 1 << bit;
        }
    }
    let outputs = device.channels_of(ChannelKind::AnalogOutput);
    for (channel, place) in outputs.zip(&mut entry.analog) {
        *place = analog_on(channel.range);
    }
    entry
}

fn analog_on(range: Option<[f64; 2]>) -> f64 {
    let [lower, upper] = range.unwrap_or([0.0, 1.0]);
    lower + 0.75 * (upper - lower)
}

/// Returns true if the outputs are those of [`all_on`] or, if not `on`, those of their release afterwards.
pub fn outputs_are(device: &DeviceConfig, outputs: &ObservedOutputs, on: bool) -> bool {
    let entry = all_on(device, 1);
    let digital = device.channels_of(ChannelKind::DigitalOutput).zip(0..);
    let digital = digital.into_iter().all(|(channel, bit)| {
        let wanted = match channel.on_release {
            Some(OnRelease::Safe(value)) if !on => value != 0.0,
            _ => entry.digital >> bit & 1 == 1,
        };
        (outputs.digital >> bit & 1 == 1) == wanted
    });
    let mut analog = device
        .channels_of(ChannelKind::AnalogOutput)
        .zip(0..ANALOG_MAX);
    digital
        && analog.all(|(channel, index)| {
            let wanted = match channel.on_release {
                Some(OnRelease::Safe(value)) if !on => value,
                _ => entry.analog[index],
            };
            (outputs.analog[index] - wanted).abs() <= 0.5 * channel.scale.abs().min(1e-3)
        })
}
