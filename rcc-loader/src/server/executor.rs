//! The loader's link to the executor of its cell: the executor is found by its announcement, dropped at its death, and
//! found again. Used by blocking threads of the server; they never wait for the real-time thread, only for the intake
//! thread.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError, RwLock, TryLockError};
use std::time::Duration;

use rcc_api::codes;
use rcc_api::error::ApiError;
use rcc_core::helper::{HelperEntry, HelperTable};
use rcc_core::message::{
    CommandEntry, CommandState, CycleStatus, DeviceEntry, MAGIC, MonitorRecord, Tables,
};
use rcc_core::timing::CycleTiming;
use rcc_ipc::{BoardReader, Cell, Client, Session, StreamError, Subscriber};
use rcc_os::process_instance::Liveness;
use rcc_protocol::announcement::EXECUTOR_LABEL;
use rcc_protocol::control::{Answer, CONTROL, Call, HELPERS, RECORDS, STATUS, TABLES, TIMING};
use rcc_protocol::{Announcement, Build, Role, wire};

use super::caller::Caller;
use super::error::{no_executor, of_call};

/// Maximum time for an answer of the executor, which includes allocating arenas and planning paths.
const CALL_TIMEOUT: Duration = Duration::from_secs(5);

/// Classes of calls. Calls of one class wait for each other because they share ports to the executor. Slow or frequent
/// calls never delay a CANCEL or ABORT: these have two ports of their own, so that even one that gets no answer does
/// not block the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum CallClass {
    Stop,
    /// Loads: plans are decoded, nets are built and rehearsed; up to seconds.
    Install,
    /// Changes: may take as long as rebuilding a net.
    Change,
    /// Queries, and leases, which must be renewed in time: take a cycle or two.
    Query,
}

impl CallClass {
    fn of(call: &Call) -> CallClass {
        match call {
            Call::Cancel { .. } | Call::Abort { .. } => CallClass::Stop,
            Call::Install { .. } => CallClass::Install,
            Call::Start { .. }
            | Call::Switch { .. }
            | Call::Set { .. }
            | Call::Unload { .. }
            | Call::InstallRules { .. }
            | Call::BindLease { .. }
            | Call::Reject { .. } => CallClass::Change,
            Call::Reserve
            | Call::RemoveRule { .. }
            | Call::Rules { .. }
            | Call::GrantLease { .. }
            | Call::RenewLease { .. }
            | Call::EndLease { .. }
            | Call::Read { .. }
            | Call::Record
            | Call::Recorded { .. }
            | Call::Acknowledge => CallClass::Query,
        }
    }

    /// Returns the indices of the ports of this class.
    fn ports(self) -> std::ops::Range<usize> {
        match self {
            CallClass::Stop => 0..2,
            CallClass::Install => 2..3,
            CallClass::Change => 3..4,
            CallClass::Query => 4..PORTS,
        }
    }
}

/// Number of ports from a loader to the executor.
const PORTS: usize = 5;
/// Number of readers of the executor's tables: of them, for CANCEL and ABORT only, as many as these have threads.
const TABLE_READERS: usize = 4;
const STOP_TABLE_READERS: usize = 2;

/// A connection to one incarnation of the executor.
pub struct ExecutorConnection {
    /// The executor's announcement.
    pub announcement: Announcement,
    clients: Vec<Mutex<Client>>,
    status: Mutex<BoardReader<CycleStatus>>,
    /// The first [`STOP_TABLE_READERS`] are reserved for CANCEL and ABORT, which therefore never wait for a preempted
    /// thread that lists commands.
    tables: Vec<Mutex<BoardReader<Tables>>>,
    timing: Mutex<BoardReader<CycleTiming>>,
    helpers: Mutex<BoardReader<HelperTable>>,
}

impl ExecutorConnection {
    /// Reads the executor's counters.
    pub fn status(&self) -> CycleStatus {
        locked(&self.status).read()
    }

    /// Reads the table of the executor's helper threads; empty before the first cycle.
    pub fn helpers(&self) -> Vec<HelperEntry> {
        let table = locked(&self.helpers).read();
        let written = table.magic == MAGIC;
        let is_there = |row: &HelperEntry| written && !row.name().is_empty();
        table.helpers.into_iter().filter(is_there).collect()
    }

    /// Reads the histograms and the costs of primitives; boxed because they are large. All zero before they are first
    /// written.
    pub fn timing(&self) -> Box<CycleTiming> {
        Box::new(locked(&self.timing).read())
    }

    /// Reads the executor's tables; boxed because they are large. Empty before the first cycle.
    pub fn tables(&self) -> Box<TableSnapshot> {
        snapshot(self.tables.get(STOP_TABLE_READERS..))
    }

    /// As [`ExecutorConnection::tables`], without waiting for other requests than CANCEL and ABORT.
    pub fn tables_for_stop(&self) -> Box<TableSnapshot> {
        snapshot(self.tables.get(..STOP_TABLE_READERS))
    }
    /// Returns true if this incarnation is known to be dead.
    pub fn is_dead(&self) -> bool {
        self.announcement.liveness().is_dead()
    }

    /// Returns a free port of the class, or waits for one.
    fn port(&self, class: CallClass) -> Option<MutexGuard<'_, Client>> {
        free(self.clients.get(class.ports())?)
    }

    fn call(&self, cell: &str, caller: &Caller, call: &Call) -> Result<Answer, ApiError> {
        let bytes = wire::encode(call).map_err(|error| other_format(&error))?;
        let class = CallClass::of(call);
        let client = self.port(class).ok_or_else(|| no_executor(cell))?;
        // Checked only now that the port is free: other callers may have used up all of this caller's time. An
        // operation that ends a motion is carried out even if nobody waits any more, because its client wanted the arm
        // to stop.
        let patience = match class {
            CallClass::Stop => CALL_TIMEOUT,
            _ => caller.remaining_time(CALL_TIMEOUT)?,
        };
        let answer = client
            .call(&bytes, patience)
            .map_err(|error| of_call(cell, &error))?;
        drop(client);
        wire::decode(&answer).map_err(|error| other_format(&error))
    }
}

fn other_format(error: &dyn std::fmt::Display) -> ApiError {
    ApiError::new(
        codes::OTHER_BUILD,
        format!("loader and executor use different message formats: {error}"),
        "install both from the same build and restart them",
    )
}

/// A port of one stream or set-point channel to one incarnation of the executor: its calls wait for no others.
pub struct ExecutorPort {
    cell: String,
    client: Client,
}

impl ExecutorPort {
    /// Calls the executor.
    ///
    /// # Errors
    /// Returns an error if this executor is gone, does not answer in time, or the two do not understand each other.
    pub fn call(&self, call: &Call) -> Result<Answer, ApiError> {
        let bytes = wire::encode(call).map_err(|error| other_format(&error))?;
        let answer = self.client.call(&bytes, CALL_TIMEOUT);
        let answer = answer.map_err(|error| of_call(&self.cell, &error))?;
        wire::decode(&answer).map_err(|error| other_format(&error))
    }
}

/// A snapshot of the executor's tables.
#[derive(Clone, Debug, Default)]
pub struct TableSnapshot {
    /// Existing commands.
    pub commands: Vec<CommandEntry>,
    /// Devices, in the order of the configuration; empty before the first cycle.
    pub devices: Vec<DeviceEntry>,
}

impl TableSnapshot {
    /// Returns the row of a command.
    pub fn command(&self, id: u64) -> Option<&CommandEntry> {
        self.commands.iter().find(|row| row.id == id)
    }
}

/// The link to the executor.
pub struct ExecutorLink {
    session: Session,
    attached: RwLock<Option<Arc<ExecutorConnection>>>,
}

impl ExecutorLink {
    /// Creates a link that is not connected yet.
    #[must_use]
    pub fn new(session: Session) -> ExecutorLink {
        ExecutorLink {
            session,
            attached: RwLock::new(None),
        }
    }

    /// Returns the cell.
    #[must_use]
    pub fn cell(&self) -> &Cell {
        self.session.cell()
    }

    /// Returns the loader's announcement, without its configuration.
    #[must_use]
    pub fn own(&self) -> Announcement {
        self.session.announcement()
    }

    /// Returns the living executor; looks it up again if the known one is dead. The second value is true if it is
    /// another incarnation than before.
    ///
    /// # Errors
    /// Returns [`codes::NO_EXECUTOR`] if none is alive or it cannot be reached, and [`codes::OTHER_BUILD`] if its
    /// shared-memory layout differs.
    pub fn attach(&self) -> Result<(Arc<ExecutorConnection>, bool), ApiError> {
        let known = self.attached.read();
        let known = known.unwrap_or_else(PoisonError::into_inner).clone();
        if let Some(known) = known.filter(|known| !known.is_dead()) {
            return Ok((known, false));
        }
        let attached = self.attached.write();
        let mut attached = attached.unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = attached.as_ref().filter(|known| !known.is_dead()) {
            return Ok((Arc::clone(known), false));
        }
        *attached = None;
        let cell = self.session.cell();
        let unknown = |why: String| {
            ApiError::new(
                codes::NO_EXECUTOR,
                format!(
                    "cannot tell whether the executor of cell '{}' is running: {why}",
                    cell.name()
                ),
                "try again; if the error persists, the loader has too few file descriptors (LimitNOFILE=)",
            )
        };
        let announcement = cell
            .announced(Role::Executor, EXECUTOR_LABEL)
            .map_err(|error| unknown(error.to_string()))?
            .ok_or_else(|| no_executor(cell.name()))?;
        match announcement.liveness() {
            Liveness::Alive => {}
            Liveness::Dead => return Err(no_executor(cell.name())),
            Liveness::Unknown(error) => return Err(unknown(error.to_string())),
        }
        let found = Arc::new(self.open(announcement)?);
        *attached = Some(Arc::clone(&found));
        Ok((found, true))
    }

    /// Calls the executor, without a caller's deadline.
    ///
    /// # Errors
    /// Returns an error if there is no executor, it does not answer in time, or the two do not understand each other.
    pub fn call(&self, call: &Call) -> Result<Answer, ApiError> {
        self.call_for(&Caller::default(), call)
    }

    /// Calls the executor while `caller` waits; CANCEL and ABORT in any case.
    ///
    /// # Errors
    /// As for [`ExecutorLink::call`]; also if the caller has gone, and the executor was not called.
    pub fn call_for(&self, caller: &Caller, call: &Call) -> Result<Answer, ApiError> {
        let (attached, _) = self.attach()?;
        attached.call(self.session.cell().name(), caller, call)
    }

    /// Opens a port of its own to the living executor.
    ///
    /// # Errors
    /// As for [`ExecutorLink::attach`].
    pub fn open_port(&self) -> Result<ExecutorPort, ApiError> {
        let (attached, _) = self.attach()?;
        let cell = self.session.cell().name();
        // `attach` has found it in this announcement.
        let control = attached.announcement.services.get(CONTROL);
        let control = control.ok_or_else(|| no_executor(cell))?;
        let client = self.session.client(control);
        Ok(ExecutorPort {
            cell: cell.to_owned(),
            client: client.map_err(|error| cannot_open(cell, &error))?,
        })
    }

    /// Subscribes to the records of the monitors of an executor.
    ///
    /// # Errors
    /// Returns an error if the executor is gone or has no room for another reader.
    pub fn subscribe_records(
        &self,
        attached: &ExecutorConnection,
    ) -> Result<Subscriber<MonitorRecord>, ApiError> {
        let cell = self.session.cell().name();
        let records = attached.announcement.services.get(RECORDS);
        let records = records.ok_or_else(|| no_executor(cell))?;
        self.session
            .subscribe(records)
            .map_err(|error| match error {
                StreamError::Full { .. } => ApiError::new(
                    codes::TOO_MANY_PORTS,
                    error.to_string(),
                    "close another stream of monitored values",
                ),
                error => cannot_open(cell, &error),
            })
    }

    fn open(&self, announcement: Announcement) -> Result<ExecutorConnection, ApiError> {
        let cell = self.session.cell().name();
        Build::require_layout(&announcement).map_err(|other| {
            ApiError::new(
                codes::OTHER_BUILD,
                format!(
                    "the executor of cell '{cell}' was built from another version ({}) than the loader ({})",
                    other.theirs, other.own
                ),
                rcc_protocol::build::REMEDY,
            )
        })?;
        let service = |name: &str| {
            announcement.services.get(name).ok_or_else(|| {
                ApiError::new(
                    codes::OTHER_BUILD,
                    format!("the executor of cell '{cell}' does not offer `{name}`"),
                    "install loader and executor from the same build and restart them",
                )
            })
        };
        let failed = |error: &dyn std::fmt::Display| cannot_open(cell, error);
        let control = service(CONTROL)?;
        let clients = (0..PORTS).map(|_| self.session.client(control).map(Mutex::new));
        let clients: Result<Vec<_>, _> = clients.collect();
        let status = self.session.open_board(service(STATUS)?);
        let tables = service(TABLES)?;
        let tables = (0..TABLE_READERS).map(|_| self.session.open_board(tables).map(Mutex::new));
        let tables: Result<Vec<_>, _> = tables.collect();
        let timing = self.session.open_board(service(TIMING)?);
        let helpers = self.session.open_board(service(HELPERS)?);
        Ok(ExecutorConnection {
            clients: clients.map_err(|error| failed(&error))?,
            status: Mutex::new(status.map_err(|error| failed(&error))?),
            tables: tables.map_err(|error| failed(&error))?,
            timing: Mutex::new(timing.map_err(|error| failed(&error))?),
            helpers: Mutex::new(helpers.map_err(|error| failed(&error))?),
            announcement,
        })
    }
}

fn cannot_open(cell: &str, error: &dyn std::fmt::Display) -> ApiError {
    ApiError::new(
        codes::NO_EXECUTOR,
        format!("the executor of cell '{cell}' cannot be opened: {error}"),
        "try again; if the error persists, restart the cell",
    )
}

/// Reads the tables with a free one of these readers.
fn snapshot(readers: Option<&[Mutex<BoardReader<Tables>>]>) -> Box<TableSnapshot> {
    let Some(tables) = readers.and_then(free).map(|reader| reader.read()) else {
        return Box::default();
    };

    let written = tables.magic == MAGIC;
    Box::new(TableSnapshot {
        commands: tables
            .commands
            .into_iter()
            .filter(|row| written && row.id != 0)
            .filter(|row| CommandState::from_number(row.state) != CommandState::None)
            .collect(),
        devices: if written {
            tables.devices.to_vec()
        } else {
            Vec::new()
        },
    })
}

/// Locks one that is free, or waits for the last.
fn free<T>(all: &[Mutex<T>]) -> Option<MutexGuard<'_, T>> {
    let free = all.iter().find_map(|one| match one.try_lock() {
        Ok(one) => Some(one),
        Err(TryLockError::Poisoned(poisoned)) => Some(poisoned.into_inner()),
        Err(TryLockError::WouldBlock) => None,
    });
    free.or_else(|| all.last().map(locked))
}

/// A panic in another thread leaves these values intact, because each is a single handle.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
