//! The host in a cell of its own, with an executor played by the test and a device that is a few variables.

use std::sync::atomic::AtomicU64;
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::Instant;

use bytemuck::Zeroable;
use rcc_config::{ExecutorConfig, OnRelease};
use rcc_core::message::{JOINTS_MAX, MAGIC, SET_POINTS, SetPoint};
use rcc_core::message::DeviceState;
use rcc_core::primitive::ChannelKind;
use rcc_ipc::control::command_board;

use super::*;
use crate::conformance;
use crate::driver::{DriverError, Exchange, Outputs};

const LIMIT: Duration = Duration::from_secs(20);

/// A device with one output, whose period is 1 ms; absent while `absent` is set.
struct Device {
    told: Arc<Mutex<Outputs>>,
    absent: Arc<AtomicBool>,
}

impl Driver for Device {
    fn open(_: &DeviceConfig) -> Result<Self, DriverError> {
        unreachable!("made by the test")
    }

    fn receive(&mut self, _: Duration, _: &mut Inputs) -> Result<Exchange, LinkError> {
        thread::sleep(Duration::from_millis(1));
        if self.absent.load(Ordering::Relaxed) {
            return Err(LinkError::Lost { reason: 100 });
        }
        Ok(Exchange {
            commandable: true,
            startable: true,
            mirror: [0.0; JOINTS_MAX],
            ticks: 1,
            period_ns: 1_000_000,
            quality_permille: 1000,
            reason: 0,
            late: 0,
            refused: 0,
        })
    }

    fn send(&mut self, outputs: &Outputs) -> Result<(), LinkError> {
        *self.told.lock().expect("no panic") = *outputs;
        Ok(())
    }

    fn release(&mut self) {}
}

/// A cell in a folder of its own, removed at the end.
struct Bench {
    cell: Cell,
    config: CellConfig,
    device: DeviceConfig,
    told: Arc<Mutex<Outputs>>,
    absent: Arc<AtomicBool>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    executor: Option<(Session, BoardWriter<CommandImage>, Announced)>,
    image: CommandImage,
}

impl Bench {
    fn new() -> Self {
        static SERIAL: AtomicU64 = AtomicU64::new(0);
        let serial = SERIAL.fetch_add(1, Ordering::Relaxed);
        let folder = std::env::temp_dir().join(format!("rcc-host-{}-{serial}", std::process::id()));
        let safe = Some(OnRelease::Safe(0.0));
        let output = ("lamp", ChannelKind::DigitalOutput, 1.into(), safe, None);
        let device = conformance::device("none", serde_json::json!({}), &[output]);
        let config = CellConfig {
            name: "host".to_owned(),
            period_ns: 1_000_000,
            stale_after_ns: 50_000_000,
            executor: ExecutorConfig {
                priority: 80,
                core: None,
                late_in_a_row_max: 0,
            },
            devices: vec![device.clone()],
            simulators: Vec::new(),
            ports: Default::default(),
            source: Default::default(),
        };
        let mut bench = Self {
            cell: Cell::at("host", &folder).expect("a folder"),
            config,
            device,
            told: Arc::new(Mutex::new(Outputs::NONE)),
            absent: Arc::default(),
            stop: Arc::default(),
            thread: None,
            executor: None,
            image: CommandImage::zeroed(),
        };
        let mut host = bench.join().expect("the only driver");
        let stop = Arc::clone(&bench.stop);
        bench.thread = Some(thread::spawn(move || host.run(&stop)));
        bench
    }

    fn join(&self) -> Result<Host, HostError> {
        let driver = Device {
            told: Arc::clone(&self.told),
            absent: Arc::clone(&self.absent),
        };
        let of = (&self.config, &self.device);
        Host::join(&self.cell, of, (Box::new(driver), &[]))
    }

    fn start_executor(&mut self) {
        let session = Session::join(&self.cell, Role::Executor, "main").expect("a session");
        let name = command_board(&self.device.name);
        let board = session
            .create_board::<CommandImage>(&name)
            .expect("a board");
        let announcement = Announcement::of(&session).service(&name, board.service());
        let announced = self
            .cell
            .announce(&announcement)
            .expect("the only executor");
        self.image = CommandImage {
            magic: MAGIC,
            executor: session.incarnation(),
            period_ns: 1_000_000,
            set_points: [SetPoint::NONE; SET_POINTS],
            ..CommandImage::zeroed()
        };
        self.executor = Some((session, board, announced));
    }

    /// One cycle of the executor with the lamp so.
    fn command(&mut self, lamp: Option<bool>) {
        self.image.sequence += 1;
        self.image.stamp_ns = monotonic_ns();
        let place = (self.image.sequence % SET_POINTS as u64) as usize;
        self.image.set_points[place] = SetPoint {
            logical_ns: self.image.sequence * 1_000_000,
            digital: u64::from(lamp == Some(true)),
            digital_commanded: u64::from(lamp.is_some()),
            ..SetPoint::NONE
        };
        if let Some((_, board, _)) = &mut self.executor {
            board.write(&self.image);
        }
    }

    /// Does `each` until `done`.
    fn until(&mut self, each: impl Fn(&mut Self), done: impl Fn(&Outputs, &Measurement) -> bool) {
        let session = Session::join(&self.cell, Role::Monitor, "test").expect("a session");
        let announced = self.cell.announced(Role::Driver, &self.device.name);
        let announced = announced.expect("a file").expect("the driver is announced");
        let service = &announced.services[MEASUREMENT];
        let board = session
            .open_board::<Measurement>(service)
            .expect("its board");
        let begin = Instant::now();
        loop {
            each(self);
            let told = *self.told.lock().expect("no panic");
            let measured = board.read();
            if done(&told, &measured) {
                return;
            }
            let state = DeviceState::from_number(measured.state).name();
            assert!(
                begin.elapsed() < LIMIT,
                "{state}, reason {}",
                measured.reason
            );
            thread::sleep(Duration::from_millis(1));
        }
    }

    fn end(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.join().expect("no panic");
        }
    }
}

impl Drop for Bench {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            drop(thread.join());
        }
        self.executor = None;
        if let Err(error) = rcc_ipc::clean::remove_cell(&self.cell) {
            eprintln!("{error}");
        }
    }
}

fn is(measured: &Measurement, state: DeviceState) -> bool {
    measured.state == state as u32
}

#[test]
fn a_device_is_online_without_and_ready_with_an_executor() {
    let mut bench = Bench::new();
    bench.until(|_| {}, |_, measured| is(measured, DeviceState::Online));
    bench.start_executor();
    let incarnation = bench.image.executor;
    bench.until(
        |bench| bench.command(None),
        |_, measured| is(measured, DeviceState::Ready) && measured.executor == incarnation,
    );
}

#[test]
fn outputs_are_passed_on_and_released_when_the_executor_stops_writing() {
    let mut bench = Bench::new();
    bench.start_executor();
    bench.until(
        |bench| bench.command(Some(true)),
        |told, _| (told.digital, told.digital_set) == (1, 1),
    );
    bench.until(
        |_| {},
        |told, measured| (told.digital, told.digital_set) == (0, 1) && measured.executor == 0,
    );
}

#[test]
fn a_lost_device_is_offline_with_its_reason_and_comes_back() {
    let mut bench = Bench::new();
    bench.until(|_| {}, |_, measured| is(measured, DeviceState::Online));
    bench.absent.store(true, Ordering::Relaxed);
    bench.until(
        |_| {},
        |_, measured| is(measured, DeviceState::Offline) && measured.reason == 100,
    );
    bench.absent.store(false, Ordering::Relaxed);
    bench.until(|_| {}, |_, measured| is(measured, DeviceState::Online));
}

#[test]
fn a_second_driver_for_the_device_is_refused() {
    let bench = Bench::new();
    assert!(matches!(
        bench.join().err(),
        Some(HostError::Announce(AnnounceError::AlreadyRunning { .. }))
    ));
}

#[test]
fn at_its_end_it_releases_outputs_and_takes_its_announcement_back() {
    let mut bench = Bench::new();
    bench.start_executor();
    bench.until(
        |bench| bench.command(Some(true)),
        |told, _| told.digital == 1,
    );
    bench.end();
    assert_eq!(bench.told.lock().expect("no panic").digital, 0);
    let announced = bench.cell.announced(Role::Driver, &bench.device.name);
    assert_eq!(announced.expect("a folder"), None);
}
