//! Follows the record stream of a cell's executor over restarts: finds it, reads it, and drops it at the executor's
//! death. Polled by the monitor's one thread. While there is no executor this process is not in the cell, so the cell
//! may be removed.

use rcc_core::message::MonitorRecord;
use rcc_ipc::clean::{self, JANITOR_TIMEOUT};
use rcc_ipc::{Cell, Session, Subscriber};
use rcc_protocol::announcement::EXECUTOR_LABEL;
use rcc_protocol::control::RECORDS;
use rcc_protocol::{Announcement, Build, BuildMismatch, Role};

use crate::names::CommandDirectory;

/// The reason why the stream of a living executor cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum StreamError {
    /// The cell cannot be joined.
    #[error(transparent)]
    Session(#[from] rcc_ipc::SessionError),
    /// The stream cannot be opened or read.
    #[error(transparent)]
    Stream(#[from] rcc_ipc::StreamError),
    /// A board of the executor cannot be opened.
    #[error(transparent)]
    Board(#[from] rcc_ipc::BoardError),
    /// The slots of dead monitors cannot be freed.
    #[error("all slots of the stream are taken, and cleaning up after dead monitors failed: {0}")]
    Janitor(#[from] clean::CleanError),
    /// The announcement cannot be read.
    #[error(transparent)]
    Announcement(#[from] rcc_ipc::AnnounceError),
    /// The executor is of another build, so its records may have another meaning.
    #[error("cannot read values: {0}")]
    BuildMismatch(#[from] BuildMismatch),
    /// The executor announces no stream.
    #[error(
        "the executor announces no `{RECORDS}`: make sure that both programs are from the same build"
    )]
    NotOffered,
}

/// A connection to one incarnation of the executor.
struct FollowedExecutor {
    // Declared before the session, because what was opened through it must be closed first.
    records: Subscriber<MonitorRecord>,
    names: CommandDirectory,
    announcement: Announcement,
    next_sequence: Option<u64>,
    _session: Session,
}

/// The result of one poll.
#[derive(Debug, Default)]
pub struct StreamUpdate {
    /// New records, in order.
    pub records: Vec<MonitorRecord>,
    /// Number of records lost before or between them.
    pub lost: u64,
    /// `Some(true)` if an executor was found, `Some(false)` if it was lost.
    pub changed: Option<bool>,
}

/// Follows the executors of a cell.
pub struct ExecutorFollower {
    cell_name: String,
    attached: Option<FollowedExecutor>,
}

impl ExecutorFollower {
    /// Creates a follower that is not connected yet.
    #[must_use]
    pub fn new(cell_name: &str) -> ExecutorFollower {
        ExecutorFollower {
            cell_name: cell_name.to_owned(),
            attached: None,
        }
    }

    /// Returns true while an executor is followed.
    #[must_use]
    pub fn is_attached(&self) -> bool {
        self.attached.is_some()
    }

    /// Returns everything that arrived since the last poll.
    ///
    /// # Errors
    /// Returns an error if the cell's name is invalid, or if a living executor's stream cannot be read.
    pub fn poll(&mut self) -> Result<StreamUpdate, StreamError> {
        let mut update = StreamUpdate::default();
        match &mut self.attached {
            None => {
                self.attached = find(&self.cell_name)?;
                update.changed = self.attached.is_some().then_some(true);
            }
            Some(attached) => {
                // Checked before reading, so that records sent before its death are still read.
                let dead = attached.announcement.liveness().is_dead();
                while attached.records.read_into(&mut update.records)? {}
                for record in &update.records {
                    let expected = attached.next_sequence.unwrap_or(record.sequence);
                    update.lost += record.sequence.saturating_sub(expected);
                    attached.next_sequence = Some(record.sequence + 1);
                }
                if dead && update.records.is_empty() {
                    self.attached = None;
                    update.changed = Some(false);
                }
            }
        }
        Ok(update)
    }

    /// Returns the announcement of the followed executor.
    #[must_use]
    pub fn announcement(&self) -> Option<&Announcement> {
        self.attached
            .as_ref()
            .map(|attached| &attached.announcement)
    }

    /// Returns the names of the followed executor's commands.
    pub fn names(&mut self) -> Option<&mut CommandDirectory> {
        self.attached.as_mut().map(|attached| &mut attached.names)
    }
}

fn find(cell_name: &str) -> Result<Option<FollowedExecutor>, StreamError> {
    let cell = match Cell::find(cell_name) {
        Ok(Some(cell)) => cell,
        Ok(None) => return Ok(None),
        Err(error) => return Err(rcc_ipc::SessionError::from(error).into()),
    };
    let announced = cell.announced(Role::Executor, EXECUTOR_LABEL);
    // If its liveness is not known, the next poll tries again.
    let living = |announcement: &Announcement| announcement.liveness().is_alive();
    let Some(announcement) = announced?.filter(living) else {
        return Ok(None);
    };
    Build::require_layout(&announcement)?;
    let service = announcement.services.get(RECORDS);
    let service = service.ok_or(StreamError::NotOffered)?;
    let session = Session::join(
        &cell,
        Role::Monitor,
        &format!("tail-{}", std::process::id()),
    )?;
    let mut records = session.subscribe(service);
    if matches!(records, Err(rcc_ipc::StreamError::Full { .. })) {
        // Monitors have no supervisor: a killed one keeps its slot until somebody cleans up after it.
        clean::run_janitor(&cell, JANITOR_TIMEOUT)?;
        records = session.subscribe(service);
    }
    let records = match records {
        Ok(records) => records,
        // The executor died after its announcement was read.
        Err(_) if announcement.liveness().is_dead() => return Ok(None),
        Err(error) => return Err(error.into()),
    };
    Ok(Some(FollowedExecutor {
        records,
        names: CommandDirectory::of(&cell, announcement.incarnation),
        announcement,
        next_sequence: None,
        _session: session,
    }))
}
