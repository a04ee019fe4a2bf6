//! The host in a cell of its own, with an executor played by the test and a fake device.

use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Instant;

use rcc_config::OnRelease;
use rcc_core::impedance::ControlMode;
use rcc_core::message::DeviceState;
use rcc_core::message::{JOINTS_MAX, SetPoint};
use rcc_core::primitive::ChannelKind;

use super::*;
use crate::conformance;
use crate::conformance::hosted::{LIMIT, TestCell};
use crate::driver::{DriverError, Exchange, Outputs};

/// A device with one output and a period of 1 ms; it is absent while `absent` is set, and its hold position is no number while
/// `impossible` is set.
struct FakeDevice {
    outputs: Arc<Mutex<Outputs>>,
    absent: Arc<AtomicBool>,
    impossible: Arc<AtomicBool>,
}

impl Driver for FakeDevice {
    fn open(_: &DeviceConfig) -> Result<Self, DriverError> {
        unreachable!("made by the test")
    }

    fn receive(&mut self, _: Duration, _: &mut Inputs) -> Result<Exchange, LinkError> {
        thread::sleep(Duration::from_millis(1));
        if self.absent.load(Ordering::Relaxed) {
            return Err(LinkError::Lost { reason: 100 });
        }
        Ok(Exchange {
            strategy: ControlMode::Position,
            commandable: true,
            startable: true,
            mirror: match self.impossible.load(Ordering::Relaxed) {
                true => [f64::NAN; JOINTS_MAX],
                false => [0.0; JOINTS_MAX],
            },
            ticks: 1,
            period_ns: 1_000_000,
            quality_permille: 1000,
            reason: 0,
            late: 0,
            refused: 0,
        })
    }

    fn send(&mut self, outputs: &Outputs) -> Result<(), LinkError> {
        *self.outputs.lock().expect("no panic") = *outputs;
        Ok(())
    }

    fn release(&mut self) {}
}

/// A host with that device in a cell of its own.
struct HostFixture {
    cell: TestCell,
    outputs: Arc<Mutex<Outputs>>,
    absent: Arc<AtomicBool>,
    impossible: Arc<AtomicBool>,
}

impl HostFixture {
    fn new() -> Self {
        let safe = Some(OnRelease::Safe(0.0));
        let output = ("lamp", ChannelKind::DigitalOutput, 1.into(), safe, None);
        let device = conformance::device("none", serde_json::json!({}), &[output]);
        let mut fixture = Self {
            cell: TestCell::new(&device),
            outputs: Arc::new(Mutex::new(Outputs::NONE)),
            absent: Arc::default(),
            impossible: Arc::default(),
        };
        let driver = fixture.driver();
        fixture.cell.run(driver, &[]);
        fixture
    }

    fn driver(&self) -> Box<FakeDevice> {
        Box::new(FakeDevice {
            outputs: Arc::clone(&self.outputs),
            absent: Arc::clone(&self.absent),
            impossible: Arc::clone(&self.impossible),
        })
    }

    /// Writes one cycle of the executor; `lamp` is the output's command.
    fn command(&mut self, lamp: Option<bool>) {
        self.cell.write(SetPoint {
            digital: u64::from(lamp == Some(true)),
            digital_commanded: u64::from(lamp.is_some()),
            ..SetPoint::NONE
        });
    }

    /// Repeats `each` until `done` returns true.
    fn until(&mut self, each: impl Fn(&mut Self), done: impl Fn(&Outputs, &Measurement) -> bool) {
        let begin = Instant::now();
        loop {
            each(self);
            let outputs = *self.outputs.lock().expect("no panic");
            let measured = self.cell.measured();
            if done(&outputs, &measured) {
                return;
            }
            let state = DeviceState::from_number(measured.state).name();
            let reason = measured.reason;
            assert!(begin.elapsed() < LIMIT, "{state}, reason {reason}");
            thread::sleep(Duration::from_millis(1));
        }
    }
}

fn is(measured: &Measurement, state: DeviceState) -> bool {
    measured.state == state as u32
}

#[test]
fn a_device_is_online_without_and_ready_with_an_executor() {
    let mut fixture = HostFixture::new();
    fixture.until(|_| {}, |_, measured| is(measured, DeviceState::Online));
    fixture.cell.start_executor();
    let incarnation = fixture.cell.executor;
    fixture.until(
        |fixture| fixture.command(None),
        |_, measured| is(measured, DeviceState::Ready) && measured.executor == incarnation,
    );
}

#[test]
fn outputs_are_sent_published_and_released_when_the_executor_stops_writing() {
    let mut fixture = HostFixture::new();
    fixture.cell.start_executor();
    fixture.until(
        |fixture| fixture.command(Some(true)),
        |outputs, measured| {
            let tells = (measured.digital_out, measured.digital_out_known);
            (outputs.digital, outputs.digital_set) == (1, 1) && tells == (1, 1)
        },
    );
    fixture.until(
        |_| {},
        |outputs, measured| {
            let tells = (measured.digital_out, measured.digital_out_known);
            (outputs.digital, outputs.digital_set) == (0, 1)
                && tells == (0, 1)
                && measured.executor == 0
        },
    );
}

#[test]
fn a_lost_device_is_offline_with_its_reason_and_comes_back() {
    let mut fixture = HostFixture::new();
    fixture.until(|_| {}, |_, measured| is(measured, DeviceState::Online));
    fixture.absent.store(true, Ordering::Relaxed);
    fixture.until(
        |_| {},
        |_, measured| is(measured, DeviceState::Offline) && measured.reason == 100,
    );
    fixture.absent.store(false, Ordering::Relaxed);
    fixture.until(|_| {}, |_, measured| is(measured, DeviceState::Online));
}

#[test]
fn a_device_whose_driver_returns_an_impossible_value_is_lost_and_comes_back() {
    let mut fixture = HostFixture::new();
    fixture.until(|_| {}, |_, measured| is(measured, DeviceState::Online));
    fixture.impossible.store(true, Ordering::Relaxed);
    fixture.until(
        |_| {},
        |_, measured| is(measured, DeviceState::Offline) && measured.reason == reason::IMPOSSIBLE,
    );
    fixture.impossible.store(false, Ordering::Relaxed);
    fixture.until(|_| {}, |_, measured| is(measured, DeviceState::Online));
    assert!(
        fixture
            .cell
            .measured()
            .hold
            .iter()
            .all(|value| *value == 0.0)
    );
}

/// Checks that an executor that commands the lamp is not followed, and that the driver gives the reason.
fn assert_not_followed(executors: Option<CellConfig>) {
    let mut fixture = HostFixture::new();
    fixture.cell.executors = executors;
    fixture.cell.start_executor();
    fixture.until(
        |fixture| fixture.command(Some(true)),
        |outputs, measured| {
            assert_eq!(outputs.digital, 0, "the lamp is on");
            measured.reason == reason::OTHER_CONFIGURATION
        },
    );
    let known = fixture.cell.measured().sequence;
    fixture.until(
        |fixture| fixture.command(Some(true)),
        |outputs, measured| {
            assert_eq!(outputs.digital, 0, "the lamp is on");
            is(measured, DeviceState::Online) && measured.sequence > known + 200
        },
    );
}

#[test]
fn an_executor_with_another_address_of_a_channel_is_not_followed() {
    let mut other = HostFixture::new()
        .cell
        .executors
        .take()
        .expect("a configuration");
    other.devices[0].channels[0].address = 2.into();
    assert_not_followed(Some(other));
}

#[test]
fn an_executor_that_announces_no_configuration_is_not_followed() {
    assert_not_followed(None);
}

#[test]
fn a_second_driver_for_the_device_is_refused() {
    let fixture = HostFixture::new();
    assert!(matches!(
        fixture.cell.join(fixture.driver(), &[]).err(),
        Some(HostError::Announce(AnnounceError::AlreadyRunning { .. }))
    ));
}

#[test]
fn at_its_end_it_releases_outputs_and_withdraws_its_announcement() {
    let mut fixture = HostFixture::new();
    fixture.cell.start_executor();
    fixture.until(
        |fixture| fixture.command(Some(true)),
        |outputs, _| outputs.digital == 1,
    );
    fixture.cell.end();
    assert_eq!(fixture.outputs.lock().expect("no panic").digital, 0);
    let announced = fixture
        .cell
        .cell
        .announced(Role::Driver, &fixture.cell.device.name);
    assert_eq!(announced.expect("a folder"), None);
}
