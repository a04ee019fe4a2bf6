//! The loader's link to the executor of its cell: found by its announcement, lost with its life, found again.
//! Used by blocking threads of the server; it never waits for the real-time thread, only for the intake thread.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};
use std::time::Duration;

use rcc_core::helper::{HelperEntry, HelperTable};
use rcc_core::message::{CommandEntry, CommandState, CycleStatus, DeviceEntry, MAGIC, Tables};
use rcc_core::timing::CycleTiming;
use rcc_ipc::control::{Answer, CONTROL, Call, HELPERS, STATUS, TABLES, TIMING};
use rcc_ipc::{Announcement, BoardReader, Build, Cell, Client, Liveness, Role, Session, wire};

use super::caller::Caller;
use super::codes;
use super::error::ApiError;

/// Label of the executor in its announcement.
pub const EXECUTOR_LABEL: &str = "exec";

/// How long the executor may take for an answer: it allocates arenas and plans paths meanwhile.
const CALL_TIMEOUT: Duration = Duration::from_secs(5);

/// Calls that wait for each other, because they share a port to the executor. What takes long, or is asked often, never
/// keeps a CANCEL or ABORT waiting: these have two ports of their own, so that one without an answer does not either.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum CallClass {
    Stop,
    /// Plans are decoded, and nets made and rehearsed: up to seconds.
    Install,
    /// As long as a net is made anew.
    Change,
    /// A cycle or two.
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
            | Call::Reject { .. } => CallClass::Change,
            Call::Reserve
            | Call::Read { .. }
            | Call::Record
            | Call::Recorded { .. }
            | Call::Acknowledge => CallClass::Query,
        }
    }

    /// Its ports, as indices.
    fn ports(self) -> std::ops::Range<usize> {
        match self {
            CallClass::Stop => 0..2,
            CallClass::Install => 2..3,
            CallClass::Change => 3..4,
            CallClass::Query => 4..PORTS,
        }
    }
}

/// Ports of a loader to the executor.
const PORTS: usize = 5;

/// One life of the executor, with what it offers.
pub struct ExecutorConnection {
    /// What it announced.
    pub announcement: Announcement,
    clients: Vec<Mutex<Client>>,
    status: Mutex<BoardReader<CycleStatus>>,
    tables: Mutex<BoardReader<Tables>>,
    timing: Mutex<BoardReader<CycleTiming>>,
    helpers: Mutex<BoardReader<HelperTable>>,
}

impl ExecutorConnection {
    /// The executor's counters.
    pub fn status(&self) -> CycleStatus {
        locked(&self.status).read()
    }

    /// The executor's helper threads; nothing before the first cycle.
    pub fn helpers(&self) -> Vec<HelperEntry> {
        let table = locked(&self.helpers).read();
        let written = table.magic == MAGIC;
        let is_there = |row: &HelperEntry| written && !row.name().is_empty();
        table.helpers.into_iter().filter(is_there).collect()
    }

    /// Histograms and what primitives cost; boxed, as they are large. All zero before they are first written.
    pub fn timing(&self) -> Box<CycleTiming> {
        Box::new(locked(&self.timing).read())
    }

    /// The executor's tables; boxed, as they are large. Empty before the first cycle.
    pub fn tables(&self) -> Box<TableSnapshot> {
        let tables = locked(&self.tables).read();
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

    /// True if that very process is known to be dead.
    pub fn is_dead(&self) -> bool {
        self.announcement.liveness().is_dead()
    }

    /// A port of the lane, as soon as one is free.
    fn port(&self, class: CallClass) -> Option<MutexGuard<'_, Client>> {
        let ports = self.clients.get(class.ports())?;
        let free = ports.iter().find_map(|port| match port.try_lock() {
            Ok(client) => Some(client),
            Err(TryLockError::Poisoned(poisoned)) => Some(poisoned.into_inner()),
            Err(TryLockError::WouldBlock) => None,
        });
        free.or_else(|| ports.last().map(locked))
    }

    fn call(&self, cell: &str, caller: &Caller, call: &Call) -> Result<Answer, ApiError> {
        let other_build = |error: &dyn std::fmt::Display| {
            ApiError::new(
                codes::OTHER_BUILD,
                format!("loader and executor do not understand each other: {error}"),
                "install both from one build and restart them",
            )
        };
        let bytes = wire::encode(call).map_err(|error| other_build(&error))?;
        let class = CallClass::of(call);
        let client = self
            .port(class)
            .ok_or_else(|| ApiError::no_executor(cell))?;
        // Asked when it is our turn: others may have taken all of the caller's time. An operation that ends a motion is
        // carried out although nobody waits any more: whoever asked for it wanted the arm to stop.
        let patience = match class {
            CallClass::Stop => CALL_TIMEOUT,
            _ => caller.remaining_time(CALL_TIMEOUT)?,
        };
        let answer = client
            .call(&bytes, patience)
            .map_err(|error| ApiError::of_call(cell, &error))?;
        drop(client);
        wire::decode(&answer).map_err(|error| other_build(&error))
    }
}

/// The executor's tables at one moment.
#[derive(Clone, Debug, Default)]
pub struct TableSnapshot {
    /// Commands that exist.
    pub commands: Vec<CommandEntry>,
    /// Devices, in the order of the configuration; empty before the first cycle.
    pub devices: Vec<DeviceEntry>,
}

impl TableSnapshot {
    /// The row of a command.
    pub fn command(&self, id: u64) -> Option<&CommandEntry> {
        self.commands.iter().find(|row| row.id == id)
    }
}

/// The link.
pub struct ExecutorLink {
    session: Session,
    attached: Mutex<Option<Arc<ExecutorConnection>>>,
}

impl ExecutorLink {
    /// A link that has found nothing yet.
    #[must_use]
    pub fn new(session: Session) -> ExecutorLink {
        ExecutorLink {
            session,
            attached: Mutex::new(None),
        }
    }

    /// The cell.
    #[must_use]
    pub fn cell(&self) -> &Cell {
        self.session.cell()
    }

    /// What the loader announces, but for its configuration.
    #[must_use]
    pub fn own(&self) -> Announcement {
        Announcement::of(&self.session)
    }

    /// The living executor, looked for anew when the one we knew is dead. The second value is true when it is another
    /// one than before.
    ///
    /// # Errors
    /// [`codes::NO_EXECUTOR`] when none lives or it cannot be reached; [`codes::OTHER_BUILD`] when its layout is another.
    pub fn attach(&self) -> Result<(Arc<ExecutorConnection>, bool), ApiError> {
        let mut attached = locked(&self.attached);
        if let Some(known) = attached.as_ref().filter(|known| !known.is_dead()) {
            return Ok((Arc::clone(known), false));
        }
        *attached = None;
        let cell = self.session.cell();
        let unknown = |why: String| {
            ApiError::new(
                codes::NO_EXECUTOR,
                format!(
                    "whether the executor of cell '{}' runs is not known: {why}",
                    cell.name()
                ),
                "try again; if it stays so, the loader has too few file descriptors (LimitNOFILE=)",
            )
        };
        let announcement = cell
            .announced(Role::Executor, EXECUTOR_LABEL)
            .map_err(|error| unknown(error.to_string()))?
            .ok_or_else(|| ApiError::no_executor(cell.name()))?;
        match announcement.liveness() {
            Liveness::Alive => {}
            Liveness::Dead => return Err(ApiError::no_executor(cell.name())),
            Liveness::Unknown(error) => return Err(unknown(error.to_string())),
        }
        let found = Arc::new(self.open(announcement)?);
        *attached = Some(Arc::clone(&found));
        Ok((found, true))
    }

    /// Asks the executor, whoever waits for it.
    ///
    /// # Errors
    /// It is not there, does not answer, or does not understand.
    pub fn call(&self, call: &Call) -> Result<Answer, ApiError> {
        self.call_for(&Caller::default(), call)
    }

    /// Asks the executor while `caller` waits; to CANCEL and ABORT in any case.
    ///
    /// # Errors
    /// As [`ExecutorLink::call`]; or nobody waits for it any more, and it was not asked.
    pub fn call_for(&self, caller: &Caller, call: &Call) -> Result<Answer, ApiError> {
        let (attached, _) = self.attach()?;
        attached.call(self.session.cell().name(), caller, call)
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
                rcc_ipc::build::REMEDY,
            )
        })?;
        let service = |name: &str| {
            announcement.services.get(name).ok_or_else(|| {
                ApiError::new(
                    codes::OTHER_BUILD,
                    format!("the executor of cell '{cell}' does not offer `{name}`"),
                    "install loader and executor from one build and restart them",
                )
            })
        };
        let failed = |error: &dyn std::fmt::Display| {
            ApiError::new(
                codes::NO_EXECUTOR,
                format!("the executor of cell '{cell}' cannot be opened: {error}"),
                "try again; if it stays so, restart the cell",
            )
        };
        let control = service(CONTROL)?;
        let clients = (0..PORTS).map(|_| self.session.client(control).map(Mutex::new));
        let clients: Result<Vec<_>, _> = clients.collect();
        let status = self.session.open_board(service(STATUS)?);
        let tables = self.session.open_board(service(TABLES)?);
        let timing = self.session.open_board(service(TIMING)?);
        let helpers = self.session.open_board(service(HELPERS)?);
        Ok(ExecutorConnection {
            clients: clients.map_err(|error| failed(&error))?,
            status: Mutex::new(status.map_err(|error| failed(&error))?),
            tables: Mutex::new(tables.map_err(|error| failed(&error))?),
            timing: Mutex::new(timing.map_err(|error| failed(&error))?),
            helpers: Mutex::new(helpers.map_err(|error| failed(&error))?),
            announcement,
        })
    }
}

/// A panic in another thread leaves these values whole: each is one handle.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
