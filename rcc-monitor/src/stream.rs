//! The record stream of whatever executor lives in a cell: found, followed over its restarts, let go at its death.
//! Polled by the monitor's one thread. While no executor lives, this process is not in the cell, so it may be wiped.

use rcc_core::message::MonitorRecord;
use rcc_ipc::clean::{self, JANITOR_TIMEOUT};
use rcc_ipc::control::RECORDS;
use rcc_ipc::{Announcement, Build, BuildMismatch, Cell, Role, Session, Subscriber};

use crate::names::CommandDirectory;

/// Label under which the executor announces itself.
const EXECUTOR_LABEL: &str = "exec";

/// Why a living executor's stream cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum StreamError {
    /// The cell cannot be entered.
    #[error(transparent)]
    Session(#[from] rcc_ipc::SessionError),
    /// The stream cannot be opened or read.
    #[error(transparent)]
    Stream(#[from] rcc_ipc::StreamError),
    /// Places of dead monitors cannot be freed.
    #[error("all places of the stream are taken, and the janitor did not help: {0}")]
    Janitor(#[from] clean::CleanError),
    /// The announcement cannot be read.
    #[error(transparent)]
    Announcement(#[from] rcc_ipc::AnnounceError),
    /// Its records may mean something else than here.
    #[error("no value is read: {0}")]
    BuildMismatch(#[from] BuildMismatch),
    /// It offers no stream.
    #[error("the executor offers no `{RECORDS}`: are both programs of one build?")]
    NotOffered,
}

/// One life of an executor.
struct FollowedExecutor {
    // Before the session: what was opened through it is closed first.
    records: Subscriber<MonitorRecord>,
    names: CommandDirectory,
    announcement: Announcement,
    next_sequence: Option<u64>,
    _session: Session,
}

/// What a look at the stream gave.
#[derive(Debug, Default)]
pub struct StreamUpdate {
    /// Records, in order.
    pub records: Vec<MonitorRecord>,
    /// Records that were lost before or between them.
    pub lost: u64,
    /// An executor was found (true) or lost (false).
    pub changed: Option<bool>,
}

/// Follows the executors of a cell.
pub struct ExecutorFollower {
    cell_name: String,
    attached: Option<FollowedExecutor>,
}

impl ExecutorFollower {
    /// A follower that has found nothing yet.
    #[must_use]
    pub fn new(cell_name: &str) -> ExecutorFollower {
        ExecutorFollower {
            cell_name: cell_name.to_owned(),
            attached: None,
        }
    }

    /// True while an executor is followed.
    #[must_use]
    pub fn is_attached(&self) -> bool {
        self.attached.is_some()
    }

    /// Everything that came since the last look.
    ///
    /// # Errors
    /// The cell's name is not one, or a living executor's stream cannot be read.
    pub fn poll(&mut self) -> Result<StreamUpdate, StreamError> {
        let mut update = StreamUpdate::default();
        match &mut self.attached {
            None => {
                self.attached = find(&self.cell_name)?;
                update.changed = self.attached.is_some().then_some(true);
            }
            Some(attached) => {
                // In this order: what it sent before its death is read.
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

    /// The names of the commands of the executor that is followed.
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
    // Not known yet whether it lives: the next look tries again.
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
        // Monitors have no supervisor: one that was killed keeps its place until somebody cleans up after it.
        clean::run_janitor(&cell, JANITOR_TIMEOUT)?;
        records = session.subscribe(service);
    }
    let records = match records {
        Ok(records) => records,
        // It died between its announcement and now.
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
