//! Everything around a driver: boards, life, set-points in time, rest, release. A driver only speaks its wire.
//! One thread exchanges with the device; a helper thread watches the announcements and opens boards.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use rcc_config::{CellConfig, DeviceConfig};
use rcc_core::message::Measurement;
use rcc_ipc::control::MEASUREMENT;
use rcc_ipc::events::{self, Kind, Recorder};
use rcc_ipc::{
    AnnounceError, Announced, Announcement, BoardError, BoardWriter, Cell, CommandReader,
    Configuration, Role, Session, SessionError, monotonic_ns,
};
use rcc_process::Helpers;
use thiserror::Error;

use crate::driver::{Driver, Inputs, LinkError};

mod answer;
pub mod blend;
pub mod compliance;
pub mod detour;
pub mod diagnosis;
pub mod diary;
pub mod limits;
pub mod pace;
pub mod player;
pub mod pulse;
pub mod reason;
pub mod release;
pub mod station;
pub mod track;
pub mod watch;

#[cfg(test)]
mod tests;

use answer::{Answer, Look};
use diagnosis::Diagnosis;
use diary::Diary;
use pulse::Pulse;
use reason::Reason;
use station::{LOOK_PERIODS, Station};
use watch::{News, Watch};

/// Longest wait for the device: a stop that was asked for is seen after it.
const WAIT_MAX: Duration = Duration::from_millis(10);
/// How long a line of the event log may take on a slow disk.
const SLOW_TURN_MAX: Duration = Duration::from_secs(10);
/// How long a device that was asked to leave command mode is still answered, ns.
const FAREWELL_NS: u64 = 1_000_000_000;

/// Why a driver cannot work in its cell.
#[derive(Debug, Error)]
pub enum HostError {
    /// Not in the cell.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// The measurement board cannot be made.
    #[error(transparent)]
    Board(#[from] BoardError),
    /// The device has a driver already, or the folder cannot be used.
    #[error(transparent)]
    Announce(#[from] AnnounceError),
    /// The system refuses a thread.
    #[error("the system refuses a thread: {0}")]
    Thread(#[from] std::io::Error),
}

/// One device in its cell.
pub struct Host {
    driver: Box<dyn Driver>,
    station: Station,
    board: BoardWriter<Measurement>,
    watch: Watch,
    commands: Option<CommandReader>,
    /// When to answer, if the executor's clock follows this device.
    answer: Option<Answer>,
    wait: Duration,
    diary: Diary,
    diagnosis: Diagnosis,
    recorder: Recorder,
    pulse: Arc<Pulse>,
    /// CLOCK_MONOTONIC at which the device was asked to leave command mode.
    farewell_ns: Option<u64>,
    helpers: Helpers,
    /// Taken back when the host ends.
    _announced: Announced,
}

impl Drop for Host {
    fn drop(&mut self) {
        // Before its fields go: the helpers' ends of them are what the helpers end with.
        self.helpers.end();
    }
}

impl Host {
    /// Brings a device into its cell and announces it; it has not been reached yet.
    ///
    /// # Errors
    /// The cell cannot be joined, or has a driver for this device.
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
        let station = Station::new(device, monotonic_ns());
        let station = match leads {
            Some(_) => station.leading(),
            None => station,
        };
        board.write(station.measurement());
        let announcement = Announcement::of(&session)
            .configured(Configuration::new(config.identity()).only(&device.name))
            .service(MEASUREMENT, board.service())
            .note(&reason::note(reasons));
        let helpers = Helpers::default();
        let writer = helpers.helper("events", SLOW_TURN_MAX);
        let turn = move || writer.turn();
        let recorder = Recorder::watched(cell, Role::Driver, &device.name, turn)?;
        // All threads are made before the device is announced; they begin with `Host::run`.
        let watch = Watch::start(session, announcement.clone(), recorder.clone(), &helpers)?;
        let diagnosis = Diagnosis::start(cell, device, reasons, link, &helpers)?;
        let predecessor = events::predecessor(cell, Role::Driver, &device.name);
        let announced = cell.announce(&announcement)?;
        recorder.tell(Kind::Started {
            note: String::new(),
            predecessor,
        });
        let look_ns = config.period_ns.saturating_mul(LOOK_PERIODS);
        tracing::info!(device = %device.name, "announced");
        Ok(Self {
            driver,
            station,
            board,
            watch,
            commands: None,
            answer: leads.map(Answer::after),
            wait: Duration::from_nanos(look_ns).clamp(Duration::from_millis(1), WAIT_MAX),
            diary: Diary::new(recorder.clone(), device, reasons),
            diagnosis,
            recorder,
            pulse: Pulse::new(reasons),
            farewell_ns: None,
            helpers,
            _announced: announced,
        })
    }

    /// How this driver does, for whoever supervises it.
    #[must_use]
    pub fn pulse(&self) -> Arc<Pulse> {
        Arc::clone(&self.pulse)
    }

    /// The threads beside the one that exchanges with the device. They begin with [`Host::run`].
    #[must_use]
    pub fn helpers(&self) -> &Helpers {
        &self.helpers
    }

    /// To both logs, as an event of this driver.
    #[must_use]
    pub fn recorder(&self) -> &Recorder {
        &self.recorder
    }

    /// Exchanges with the device until `stop` is set and the device has been brought to rest and let go.
    pub fn run(&mut self, stop: &AtomicBool) {
        self.helpers.go();
        let mut inputs = Inputs::NONE;
        // Relaxed: nothing else is told with it.
        while !(stop.load(Ordering::Relaxed) && self.is_let_go()) {
            self.take_boards();
            match self.driver.receive(self.wait, &mut inputs) {
                Ok(exchange) => {
                    let arrived_ns = monotonic_ns();
                    self.observe();
                    self.station.arrive(arrived_ns, &inputs, &exchange);
                    self.await_set_point(arrived_ns, exchange.period_ns);
                    let outputs = self.station.answer(&exchange);
                    if let Err(error) = self.driver.send(&outputs) {
                        self.silence(error);
                    }
                    self.board.write(self.station.measurement());
                }
                Err(error) => {
                    self.observe();
                    if self.silence(error) {
                        self.board.write(self.station.measurement());
                    }
                }
            }
            self.pulse.turn(self.station.measurement());
            self.diary.look(&self.station);
            self.diagnosis.turn(self.station.measurement());
        }
        self.recorder.tell(match self.helpers.failure() {
            None => Kind::Stopping {
                why: "asked to".to_owned(),
            },
            Some(why) => Kind::HelperEnded { why },
        });
    }

    /// True if the device is offline.
    fn silence(&mut self, error: LinkError) -> bool {
        let lost = match error {
            LinkError::Silent => None,
            LinkError::Lost { reason } => Some(reason),
        };
        self.station.silence(monotonic_ns(), lost)
    }

    fn observe(&mut self) {
        let image = self.commands.as_mut().map(CommandReader::read);
        self.station.observe(monotonic_ns(), image);
    }

    /// Where the executor's clock follows the device: tells the executor at once what was measured, and waits a while
    /// for the set-point that it computes from that.
    fn await_set_point(&mut self, arrived_ns: u64, period_ns: u64) {
        let (Some(answer), Some(board)) = (&mut self.answer, &self.commands) else {
            return;
        };
        let measurement = self.station.measurement();
        self.board.write(measurement);
        let sequence = measurement.sequence;
        let is_here = answer.wait(arrived_ns, period_ns, |now_ns| {
            Look::of(&board.head(), sequence, now_ns, period_ns)
        });
        if is_here {
            self.observe();
        }
    }

    fn take_boards(&mut self) {
        while let Some(news) = self.watch.news() {
            self.station.meet_stranger(matches!(news, News::Stranger));
            let commands = match news {
                News::Commands(commands) => Some(commands),
                News::Gone | News::Stranger => None,
            };
            if let Some(old) = std::mem::replace(&mut self.commands, commands) {
                self.watch.give_back(old);
            }
        }
    }

    /// The end was asked for: the device rests, and has left command mode or has had its time to.
    fn is_let_go(&mut self) -> bool {
        self.station.terminate();
        if !self.station.is_at_rest() {
            return false;
        }
        if !self.station.is_held_by_us() {
            return true;
        }
        let now_ns = monotonic_ns();
        let since_ns = *self.farewell_ns.get_or_insert_with(|| {
            self.driver.release();
            now_ns
        });
        now_ns.saturating_sub(since_ns) > FAREWELL_NS
    }
}

/// How long after its packets cycles begin, if the executor's clock follows this device; ns.
fn leads(config: &CellConfig, device: &DeviceConfig) -> Option<u64> {
    let clock = config.clock?;
    let led = config.devices.get(clock.device)?;
    (led.name == device.name).then_some(clock.offset_ns)
}
