//! The whole host in a cell of its own, on real boards, with an executor played by the test.
//! Test code only; the host runs in a thread of its own, as it does in `rcc-driver`.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use bytemuck::Zeroable;
use rcc_config::{CellConfig, DeviceConfig};
use rcc_core::message::{CommandImage, DeviceState, Joints, Measurement, SetPoint};
use rcc_ipc::{Announced, BoardReader, Cell, CommandWriter, Session};
use rcc_os::clock::monotonic_ns;
use rcc_protocol::control::{MEASUREMENT, command_board};
use rcc_protocol::{Announcement, Configuration, Role};

use super::fault_path::FaultPath;
use super::limit_checker::LimitChecker;
use super::{Subject, Transport};
use crate::driver::Driver;
use crate::host::limits::ArmLimits;
use crate::host::reason::Reason;
use crate::host::{Host, HostError};

/// Limit of waits for events that must happen eventually.
pub const LIMIT: Duration = Duration::from_secs(30);
/// How long the test waits for a driver's answer: the driver may have missed the packet, or have ended.
const ANSWER_MAX: Duration = Duration::from_millis(100);
/// Writes one cycle of the executor.
const CYCLE: Duration = Duration::from_millis(1);

/// A cell in a folder of its own, removed at the end.
pub struct TestCell {
    /// The cell.
    pub cell: Cell,
    /// The device.
    pub device: DeviceConfig,
    /// The executor's incarnation; 0 = none so far.
    pub executor: u64,
    /// Configuration that executors announce; `None`: none, as older builds do.
    pub executors: Option<CellConfig>,
    config: CellConfig,
    stop: Arc<AtomicBool>,
    host: Option<JoinHandle<()>>,
    reader: Option<(Session, BoardReader<Measurement>)>,
    writer: Option<(Session, CommandWriter, Announced)>,
    image: Box<CommandImage>,
}

impl TestCell {
    /// A cell for one device, without host and executor.
    pub fn new(device: &DeviceConfig) -> Self {
        static SERIAL: AtomicU64 = AtomicU64::new(0);
        let serial = SERIAL.fetch_add(1, Ordering::Relaxed);
        let memory = Path::new("/dev/shm");
        let base = if memory.is_dir() {
            memory.to_owned()
        } else {
            std::env::temp_dir()
        };
        let folder = base.join(format!("rcc-conformance-{}-{serial}", std::process::id()));
        Self {
            cell: Cell::at("conformance", &folder).expect("a folder"),
            device: device.clone(),
            executor: 0,
            executors: Some(super::cell(device)),
            config: super::cell(device),
            stop: Arc::default(),
            host: None,
            reader: None,
            writer: None,
            image: Box::new(CommandImage::zeroed()),
        }
    }

    /// Returns a host for this driver, which does not run yet.
    pub fn join(
        &self,
        driver: Box<dyn Driver>,
        reasons: &'static [Reason],
    ) -> Result<Host, HostError> {
        Host::join(&self.cell, (&self.config, &self.device), (driver, reasons))
    }

    /// Runs a host with this driver in a thread.
    pub fn run(&mut self, driver: Box<dyn Driver>, reasons: &'static [Reason]) {
        let mut host = self.join(driver, reasons).expect("the only driver");
        self.stop = Arc::default();
        let stop = Arc::clone(&self.stop);
        self.host = Some(thread::spawn(move || host.run(&stop)));
        let session = Session::join(&self.cell, Role::Monitor, "test").expect("a session");
        let announced = self.cell.announced(Role::Driver, &self.device.name);
        let announced = announced.expect("a file").expect("the driver is announced");
        let service = &announced.services[MEASUREMENT];
        let board = session
            .open_board::<Measurement>(service)
            .expect("its board");
        self.reader = Some((session, board));
    }

    /// Returns the measurement that the driver publishes.
    pub fn measured(&self) -> Measurement {
        let (_, board) = self.reader.as_ref().expect("a host runs");
        board.read()
    }

    /// Returns true if the device is in this state.
    pub fn is(&self, state: DeviceState) -> bool {
        self.measured().state == state as u32
    }

    /// Starts an executor that has not written anything yet.
    pub fn start_executor(&mut self) {
        let session = Session::join(&self.cell, Role::Executor, "main").expect("a session");
        let name = command_board(&self.device.name);
        let board = session.create_commands(&name).expect("a board");
        let announcement = Announcement {
            configuration: self
                .executors
                .as_ref()
                .map(|config| Configuration::new(config.identity())),
            ..session.announcement().service(&name, board.service())
        };
        let announced = self
            .cell
            .announce(&announcement)
            .expect("the only executor");
        self.executor = session.incarnation();
        *self.image = CommandImage::new(self.executor, CYCLE.as_nanos() as u64);
        self.writer = Some((session, board, announced));
    }

    /// One cycle of the executor.
    pub fn write(&mut self, entry: SetPoint) {
        let next = self.image.head.sequence + 1;
        self.image.push(next, monotonic_ns(), entry);
        if let Some((_, board, _)) = &mut self.writer {
            board.write(&self.image);
        }
    }

    /// Removes the executor; its board stays unchanged for those who still read it.
    pub fn end_executor(&mut self) {
        self.writer = None;
    }

    /// Asks the host to end.
    pub fn ask_to_end(&self) {
        self.stop.store(true, Ordering::Relaxed);
    }

    /// Returns true if the host has ended.
    pub fn has_ended(&self) -> bool {
        self.host.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Ends the host and waits for it.
    pub fn end(&mut self) {
        self.ask_to_end();
        self.reader = None;
        if let Some(host) = self.host.take() {
            host.join().expect("the host does not panic");
        }
    }
}

impl Drop for TestCell {
    fn drop(&mut self) {
        self.ask_to_end();
        if let Some(host) = self.host.take() {
            drop(host.join());
        }
        self.reader = None;
        self.writer = None;
        if let Err(error) = rcc_ipc::clean::remove_cell(&self.cell) {
            eprintln!("{error}");
        }
    }
}

/// A subject with its driver in a hosted cell.
pub struct HostedDriver<S: Subject> {
    /// The cell.
    pub cell: TestCell,
    /// The device.
    pub subject: S,
    /// Set-points that the device has received.
    pub followed: Vec<Joints>,
    /// Checks these set-points.
    pub checker: LimitChecker,
    path: FaultPath,
    steps: u64,
    /// Time at which the device's last packet was sent.
    last_sent: Instant,
}

impl<S: Subject> HostedDriver<S> {
    /// A device, its driver and an executor, ready for a net.
    pub fn ready() -> Self {
        let mut subject = S::start();
        let (path, address) = FaultPath::of(&mut subject, 1);
        let device = S::device(address);
        let mut cell = TestCell::new(&device);
        cell.start_executor();
        cell.run(Self::driver(&device), S::REASONS);
        let mut hosted = Self {
            checker: LimitChecker::new(ArmLimits::of(&device)),
            cell,
            subject,
            followed: Vec::new(),
            path,
            steps: 0,
            last_sent: Instant::now(),
        };
        hosted.until_ready();
        hosted.followed.clear();
        hosted
    }

    fn driver(device: &DeviceConfig) -> Box<dyn Driver> {
        match S::Driver::open(device) {
            Ok(driver) => Box::new(driver),
            Err(error) => panic!("{error}"),
        }
    }

    /// Ends the driver and starts another one; the executor writes `entry` meanwhile.
    pub fn restart_driver(&mut self, mut entry: impl FnMut() -> SetPoint) {
        self.cell.ask_to_end();
        let begin = Instant::now();
        while !self.cell.has_ended() {
            assert!(begin.elapsed() < LIMIT, "the driver does not end");
            self.step(Some(entry()));
        }
        self.cell.end();
        self.checker.forget();
        self.cell.run(Self::driver(&self.cell.device), S::REASONS);
    }

    /// Runs one cycle of executor (`None`: it writes nothing) and device; a device with the test's clock waits for its
    /// answer.
    pub fn step(&mut self, entry: Option<SetPoint>) {
        let begin = Instant::now();
        self.steps += 1;
        if let Some(entry) = entry {
            self.cell.write(entry);
        }
        self.subject.before_receive();
        self.path.step();
        // If the test itself was delayed, the device has been silent meanwhile: the arm is no longer followed and has
        // come to rest by itself.
        let silent = std::mem::replace(&mut self.last_sent, Instant::now()).elapsed();
        if silent > Duration::from_nanos(self.cell.device.command_timeout_ns) / 2 {
            self.checker.forget();
        }
        let mut answers = self.path.answers();
        while S::TRANSPORT == Transport::UdpFromDevice
            && answers.is_empty()
            && begin.elapsed() < ANSWER_MAX
            && !self.cell.has_ended()
        {
            thread::sleep(CYCLE / 20);
            answers = self.path.answers();
        }
        for packet in answers {
            match self.subject.followed(&packet) {
                Some(position) => {
                    self.checker
                        .observe(self.steps as f64 * CYCLE.as_secs_f64(), &position);
                    self.followed.push(position);
                }
                None => self.checker.forget(),
            }
        }
        self.subject.after_exchange();
        thread::sleep(CYCLE.saturating_sub(begin.elapsed()));
    }

    /// Steps until `done` returns true.
    pub fn until(
        &mut self,
        entry: Option<SetPoint>,
        what: &str,
        mut done: impl FnMut(&mut Self) -> bool,
    ) {
        let begin = Instant::now();
        loop {
            self.step(entry);
            if done(self) {
                return;
            }
            let measured = self.cell.measured();
            let state = DeviceState::from_number(measured.state).name();
            let reason = measured.reason;
            assert!(
                begin.elapsed() < LIMIT,
                "never: {what}; {state} with reason {reason}"
            );
        }
    }

    /// Steps with nulls until a net may start.
    pub fn until_ready(&mut self) {
        self.until(Some(SetPoint::NONE), "ready", |hosted| {
            hosted.cell.is(DeviceState::Ready)
        });
    }
}
