//! The host of a driver: boards, process lifetime, playback of set-points, stops and output release. The driver itself
//! only speaks its wire protocol.
//! One thread exchanges with the device; a helper thread watches the announcements and opens boards.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use rcc_config::{CellConfig, DeviceConfig};
use rcc_core::message::Measurement;
use rcc_ipc::events::{self, EventRecorder};
use rcc_ipc::{
    AnnounceError, Announced, BoardError, BoardWriter, Cell, CommandReader, Session, SessionError,
};
use rcc_os::clock::monotonic_ns;
use rcc_process::Helpers;
use rcc_protocol::control::MEASUREMENT;
use rcc_protocol::events::EventKind;
use rcc_protocol::{Configuration, Role};
use thiserror::Error;

use crate::driver::{Driver, Exchange, Inputs, LinkError};

pub mod command_mode_exit;
pub mod device_session;
pub mod diagnosis_file;
pub mod exchange_check;
pub mod executor_watch;
pub mod health;
pub mod impedance_ramp;
pub mod limits;
pub mod output_release;
pub mod playback_rate;
pub mod reason;
pub mod set_point_buffer;
mod set_point_wait;
pub mod start_blend;
pub mod state_log;
pub mod tracking_offset;

#[cfg(test)]
mod tests;

use command_mode_exit::CommandModeExit;
use device_session::{DeviceSession, OBSERVE_PERIODS_MAX};
use diagnosis_file::DiagnosisFile;
use exchange_check::{ExchangeCheck, ImpossibleExchange};
use executor_watch::{ExecutorEvent, ExecutorWatch};
use health::DriverHealth;
use reason::Reason;
use set_point_wait::{SetPointStatus, SetPointWait};
use state_log::StateLog;

/// Longest wait for the device; it bounds the delay until a stop request is noticed.
const WAIT_MAX: Duration = Duration::from_millis(10);
/// Watchdog limit for writing one line of the event log, for slow disks.
const SLOW_TURN_MAX: Duration = Duration::from_secs(10);

/// Why a driver cannot work in its cell.
#[derive(Debug, Error)]
pub enum HostError {
    /// The cell cannot be joined.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// The measurement board cannot be created.
    #[error(transparent)]
    Board(#[from] BoardError),
    /// The device already has a driver, or the runtime folder cannot be used.
    #[error(transparent)]
    Announce(#[from] AnnounceError),
    /// The operating system refuses to create a thread.
    #[error("cannot create a thread: {0}")]
    Thread(#[from] std::io::Error),
}

/// Hosts the driver of one device in its cell.
pub struct Host {
    driver: Box<dyn Driver>,
    session: DeviceSession,
    board: BoardWriter<Measurement>,
    watch: ExecutorWatch,
    commands: Option<CommandReader>,
    /// Present if the executor's clock follows this device: waits for the set-point of each exchange.
    set_point_wait: Option<SetPointWait>,
    wait: Duration,
    state_log: StateLog,
    diagnosis: DiagnosisFile,
    recorder: EventRecorder,
    health: Arc<DriverHealth>,
    check: ExchangeCheck,
    /// The last exchange was refused by `check`.
    is_refused: bool,
    /// Present once the device has been asked to leave command mode.
    exit: Option<CommandModeExit>,
    helpers: Helpers,
    /// Withdraws the announcement when the host is dropped.
    _announced: Announced,
}

impl Drop for Host {
    fn drop(&mut self) {
        // Must come before the fields are dropped: the helper threads end when their channels close.
        self.helpers.end();
    }
}

impl Host {
    /// Joins the cell and announces the device, which has not been reached yet.
    ///
    /// # Errors
    /// Returns an error if the cell cannot be joined, or if the device already has a driver there.
    pub fn join(
        cell: &Cell,
        (config, device): (&CellConfig, &DeviceConfig),
        (driver, reasons): (Box<dyn Driver>, &'static [Reason]),
    ) -> Result<Self, HostError> {
        let session = Session::join(cell, Role::Driver, &device.name)?;
        let leads = leads(config, device);
        let link = driver.diagnosis();
        let reasons = driver.reasons().unwrap_or(reasons);
        let mut board = session.create_board::<Measurement>(MEASUREMENT)?;
        let device_session = DeviceSession::new(device, monotonic_ns());
        let device_session = match leads {
            Some(_) => device_session.with_leading_clock(),
            None => device_session,
        };
        board.write(device_session.measurement());
        let announcement = session
            .announcement()
            .configured(Configuration::new(config.identity()).only(&device.name))
            .service(MEASUREMENT, board.service())
            .note(&reason::note(reasons));
        let helpers = Helpers::default();
        let writer = helpers.helper("events", SLOW_TURN_MAX);
        let turn = move || writer.turn();
        let recorder = EventRecorder::watched(cell, Role::Driver, &device.name, turn)?;
        // All threads are created before the device is announced; they start working with `Host::run`.
        let watch =
            ExecutorWatch::start(session, announcement.clone(), recorder.clone(), &helpers)?;
        let diagnosis = DiagnosisFile::start(cell, device, reasons, link, &helpers)?;
        let predecessor = events::predecessor(cell, Role::Driver, &device.name);
        let announced = cell.announce(&announcement)?;
        recorder.tell(EventKind::Started {
            note: String::new(),
            predecessor,
        });
        let look_ns = config.period_ns.saturating_mul(OBSERVE_PERIODS_MAX);
        tracing::info!(device = %device.name, "announced");
        Ok(Self {
            driver,
            session: device_session,
            board,
            watch,
            commands: None,
            set_point_wait: leads.map(SetPointWait::after),
            wait: Duration::from_nanos(look_ns).clamp(Duration::from_millis(1), WAIT_MAX),
            state_log: StateLog::new(recorder.clone(), device, reasons),
            diagnosis,
            recorder,
            health: DriverHealth::new(reasons),
            check: ExchangeCheck::new(device),
            is_refused: false,
            exit: None,
            helpers,
            _announced: announced,
        })
    }

    /// Returns the state of this driver for its supervisor.
    #[must_use]
    pub fn health(&self) -> Arc<DriverHealth> {
        Arc::clone(&self.health)
    }

    /// Returns the helper threads, which start working with [`Host::run`].
    #[must_use]
    pub fn helpers(&self) -> &Helpers {
        &self.helpers
    }

    /// Returns the recorder that writes events of this driver to both logs.
    #[must_use]
    pub fn recorder(&self) -> &EventRecorder {
        &self.recorder
    }

    /// Exchanges with the device until `stop` is set, the device is at rest, and it has left command mode.
    pub fn run(&mut self, stop: &AtomicBool) {
        self.helpers.start();
        let mut inputs = Inputs::NONE;
        // Relaxed: the flag publishes no other data.
        while !(stop.load(Ordering::Relaxed) && self.is_released()) {
            self.update_command_board();
            match self.driver.receive(self.wait, &mut inputs) {
                Ok(exchange) => match ExchangeCheck::check(&exchange) {
                    Ok(()) => self.exchange(inputs, &exchange),
                    Err(impossible) => self.refuse(&impossible),
                },
                Err(error) => self.lose(error),
            }
            self.health.update(self.session.measurement());
            self.state_log.update(&self.session);
            self.diagnosis.update(self.session.measurement());
        }
        self.recorder.tell(match self.helpers.failure() {
            None => EventKind::Stopping {
                why: "on request".to_owned(),
            },
            Some(why) => EventKind::HelperEnded { why },
        });
    }

    /// Plays one exchange, and answers it.
    fn exchange(&mut self, mut inputs: Inputs, exchange: &Exchange) {
        let arrived_ns = monotonic_ns();
        self.is_refused = false;
        if let Some(exit) = &mut self.exit {
            exit.observe(exchange.commandable);
        }
        self.observe();
        self.check.limit(&mut inputs);
        self.session.begin_exchange(arrived_ns, &inputs, exchange);
        self.await_set_point(arrived_ns, exchange.period_ns);
        let outputs = self.session.finish_exchange(exchange);
        if let Err(error) = self.driver.send(&outputs) {
            self.report_link_error(error);
        }
        self.board.write(self.session.measurement());
    }

    /// An exchange that cannot be played is not answered: the device is lost, and the value is logged once.
    fn refuse(&mut self, impossible: &ImpossibleExchange) {
        if !std::mem::replace(&mut self.is_refused, true) {
            tracing::error!(
                "the driver returned an impossible value: {impossible}; the device is lost"
            );
        }
        self.lose(LinkError::Lost {
            reason: reason::IMPOSSIBLE,
        });
    }

    fn lose(&mut self, error: LinkError) {
        self.observe();
        if self.report_link_error(error) {
            self.board.write(self.session.measurement());
        }
    }

    /// Reports a failed exchange to the session; returns true if the device is offline.
    fn report_link_error(&mut self, error: LinkError) -> bool {
        let lost = match error {
            LinkError::Silent => None,
            LinkError::Lost { reason } => Some(reason),
        };
        self.session.handle_link_error(monotonic_ns(), lost)
    }

    fn observe(&mut self) {
        let image = self.commands.as_mut().map(CommandReader::read);
        self.session.observe(monotonic_ns(), image);
    }

    /// If the executor's clock follows the device: publishes the measurement at once, and waits a bounded time for the
    /// set-point that the executor computes from it.
    fn await_set_point(&mut self, arrived_ns: u64, period_ns: u64) {
        let (Some(set_point_wait), Some(board)) = (&mut self.set_point_wait, &self.commands) else {
            return;
        };
        let measurement = self.session.measurement();
        self.board.write(measurement);
        let sequence = measurement.sequence;
        let is_current = set_point_wait.wait(arrived_ns, period_ns, |now_ns| {
            SetPointStatus::of(&board.head(), sequence, now_ns, period_ns)
        });
        if is_current {
            self.observe();
        }
    }

    fn update_command_board(&mut self) {
        while let Some(event) = self.watch.next_event() {
            self.session
                .set_executor_incompatible(matches!(event, ExecutorEvent::Incompatible));
            let commands = match event {
                ExecutorEvent::Commands(commands) => Some(commands),
                ExecutorEvent::Gone | ExecutorEvent::Incompatible => None,
            };
            if let Some(old) = std::mem::replace(&mut self.commands, commands) {
                self.watch.give_back(old);
            }
        }
    }

    /// Called once the stop is requested: returns true when the device is at rest and has left command mode.
    fn is_released(&mut self) -> bool {
        self.session.terminate();
        if !self.session.is_at_rest() {
            return false;
        }
        // Also of an arm that is not in command mode: it may be about to enter it.
        if !self.session.is_online_arm() {
            return true;
        }
        let now_ns = monotonic_ns();
        let exit = self.exit.get_or_insert_with(|| {
            self.driver.release();
            CommandModeExit::requested(now_ns)
        });
        exit.is_over(now_ns)
    }
}

/// Returns the offset from the arrival of a packet to the start of the executor's cycle, ns, if the executor's clock
/// follows this device.
fn leads(config: &CellConfig, device: &DeviceConfig) -> Option<u64> {
    let clock = config.clock?;
    let led = config.devices.get(clock.device)?;
    (led.name == device.name).then_some(clock.offset_ns)
}
