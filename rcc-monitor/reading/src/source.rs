//! Sources of a recording: the record stream, the boards of the executor, and the measurements of the devices. Every
//! monitor can read these. Polled by the main thread.

use std::path::Path;

use rcc_config::CellConfig;
use rcc_config::device::DeviceConfig;
use rcc_core::kinematics::Arm;
use rcc_core::message::{CycleStatus, MAGIC, Measurement, MonitorRecord, Tables};
use rcc_core::primitive::ChannelKind;
use rcc_core::unit::Unit;
use rcc_ipc::{BoardReader, Cell, Session};
use rcc_protocol::control::{MEASUREMENT, STATUS, TABLES};
use rcc_protocol::{Announcement, Role};
use rcc_recording::arm::ViewedArm;
use rcc_recording::device::{ChannelLabel, RecordedDevice};

use crate::stream::{ExecutorFollower, StreamError};

/// Data of one poll.
#[derive(Clone, Debug, Default)]
pub struct SourceBatch {
    /// A new executor: its incarnation, and the devices of its configuration.
    pub executor: Option<ExecutorFacts>,
    /// Records of monitors, in order.
    pub records: Vec<MonitorRecord>,
    /// Records that the stream lost before or between them.
    pub lost: u64,
    /// New measurements, by index of the device; `None` if its driver is gone.
    pub measurements: Vec<(usize, Option<Measurement>)>,
    /// Measurements that were overwritten before they were read.
    pub missed: u64,
    /// Status and tables, once a second.
    pub status: Option<Box<(CycleStatus, Tables)>>,
    /// False once an executor that was followed is gone.
    pub gone: bool,
}

impl SourceBatch {
    /// Returns true if there is nothing to write.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.executor.is_none()
            && self.records.is_empty()
            && self.measurements.is_empty()
            && self.status.is_none()
            && self.lost == 0
            && !self.gone
    }
}

/// An executor, and the devices of its configuration.
#[derive(Clone, Debug)]
pub struct ExecutorFacts {
    /// The cell.
    pub cell: Cell,
    /// Incarnation.
    pub incarnation: u64,
    /// Devices, in the order of the configuration.
    pub devices: Vec<RecordedDevice>,
    /// Text of the cell's file; empty if it cannot be read.
    pub cell_text: String,
}

/// The measurement board of one device.
struct DeviceBoard {
    name: String,
    board: Option<(BoardReader<Measurement>, Announcement)>,
    sequence: u64,
}

/// Session and boards that are open while an executor lives.
struct Attached {
    // Boards are closed before the session through which they were opened.
    status: BoardReader<CycleStatus>,
    tables: BoardReader<Tables>,
    devices: Vec<DeviceBoard>,
    session: Session,
}

/// Reads a cell.
pub struct CellSource {
    cell_name: String,
    follower: ExecutorFollower,
    attached: Option<Attached>,
    polls: u64,
    /// Polls between two searches for drivers, and between two readings of the tables.
    search_every: u64,
}

impl CellSource {
    /// Creates a source that is polled `polls_hz` times a second.
    #[must_use]
    pub fn new(cell_name: &str, polls_hz: u64) -> CellSource {
        CellSource {
            cell_name: cell_name.to_owned(),
            follower: ExecutorFollower::new(cell_name),
            attached: None,
            polls: 0,
            search_every: polls_hz.max(1),
        }
    }

    /// Returns true while there is an executor.
    #[must_use]
    pub fn is_attached(&self) -> bool {
        self.attached.is_some()
    }

    /// Reads everything that is new. The stream is read in each fifth poll only: its buffers hold more than 100 ms.
    ///
    /// # Errors
    /// Fails if a living executor cannot be read.
    pub fn poll(&mut self) -> Result<SourceBatch, StreamError> {
        let mut batch = SourceBatch::default();
        self.polls += 1;
        if self.polls.is_multiple_of(5) || self.attached.is_none() {
            let update = self.follower.poll()?;
            (batch.records, batch.lost) = (update.records, update.lost);
            match update.changed {
                Some(true) => batch.executor = self.attach()?,
                Some(false) => {
                    self.attached = None;
                    batch.gone = true;
                }
                None => {}
            }
        }
        let Some(attached) = &mut self.attached else {
            return Ok(batch);
        };
        if self.polls.is_multiple_of(self.search_every / 10) {
            attached.find_drivers(&mut batch);
        }
        attached.read_devices(&mut batch);
        if self.polls.is_multiple_of(self.search_every) {
            let tables = attached.tables.read();
            batch.status = Some(Box::new((attached.status.read(), tables)));
        }
        Ok(batch)
    }

    /// Opens the boards of the executor that was found.
    fn attach(&mut self) -> Result<Option<ExecutorFacts>, StreamError> {
        let Some(found) = self.follower.announcement().cloned() else {
            return Ok(None);
        };
        let cell = Cell::find(&self.cell_name).map_err(rcc_ipc::SessionError::from)?;
        let Some(cell) = cell else { return Ok(None) };
        let label = format!("record-{}", std::process::id());
        let session = Session::join(&cell, Role::Monitor, &label)?;
        let service = |name: &str| found.services.get(name).cloned().unwrap_or_default();
        let status = session.open_board(&service(STATUS));
        let tables = session.open_board(&service(TABLES));
        let (status, tables) = match (status, tables) {
            (Ok(status), Ok(tables)) => (status, tables),
            // It died after its announcement was read; the next poll of the stream notices.
            _ if found.liveness().is_dead() => return Ok(None),
            (Err(error), _) | (_, Err(error)) => return Err(StreamError::Board(error)),
        };
        let file = found.configuration.as_ref().map(|one| one.file.clone());
        let file = file.unwrap_or_default();
        let config = CellConfig::load_offline(Path::new(&file)).ok();
        let devices: Vec<RecordedDevice> = match &config {
            Some(config) => config.devices.iter().map(recorded_device).collect(),
            None => Vec::new(),
        };
        let boards = devices.iter().map(|device| DeviceBoard {
            name: device.name.clone(),
            board: None,
            sequence: 0,
        });
        self.attached = Some(Attached {
            status,
            tables,
            devices: boards.collect(),
            session,
        });
        Ok(Some(ExecutorFacts {
            incarnation: found.incarnation,
            devices,
            cell_text: rcc_os::file::read_text(Path::new(&file), 1 << 20).unwrap_or_default(),
            cell,
        }))
    }
}

impl Attached {
    /// Drops the boards of dead drivers and opens those of new ones.
    fn find_drivers(&mut self, batch: &mut SourceBatch) {
        for (index, device) in self.devices.iter_mut().enumerate() {
            if let Some((_, announcement)) = &device.board {
                if !announcement.liveness().is_dead() {
                    continue;
                }
                device.board = None;
                batch.measurements.push((index, None));
            }
            let cell = self.session.cell();
            let found = cell.announced(Role::Driver, &device.name).ok().flatten();
            let Some(found) = found.filter(|found| found.liveness().is_alive()) else {
                continue;
            };
            // A driver that is just starting or ending is tried again.
            let service = found.services.get(MEASUREMENT);
            let board = service.and_then(|service| self.session.open_board(service).ok());
            device.board = board.map(|board| (board, found));
            device.sequence = 0;
        }
    }

    fn read_devices(&mut self, batch: &mut SourceBatch) {
        for (index, device) in self.devices.iter_mut().enumerate() {
            let Some((board, _)) = &device.board else {
                continue;
            };
            let measured = board.read();
            if measured.magic != MAGIC || measured.sequence == device.sequence {
                continue;
            }
            if device.sequence != 0 {
                let step = measured.sequence.saturating_sub(device.sequence);
                batch.missed += step.saturating_sub(1);
            }
            device.sequence = measured.sequence;
            batch.measurements.push((index, Some(measured)));
        }
    }
}

fn recorded_device(device: &DeviceConfig) -> RecordedDevice {
    let kinds = [
        ChannelKind::DigitalInput,
        ChannelKind::DigitalOutput,
        ChannelKind::AnalogInput,
        ChannelKind::AnalogOutput,
    ];
    let model = device.model();
    let viewed = |arm: Arm| ViewedArm::new(&device.name, device.base, arm, model.limits);
    RecordedDevice {
        name: device.name.clone(),
        arm: model.arm.map(viewed),
        channels: kinds.map(|kind| {
            let rows = device.channels_of(kind);
            let label = |row: &rcc_config::device::ChannelConfig| ChannelLabel {
                name: row.name.clone(),
                unit: (row.unit != Unit::ONE).then(|| row.unit.to_string()),
            };
            rows.map(label).collect()
        }),
    }
}
