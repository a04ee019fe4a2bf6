//! Boards: the newest value of one writer in shared memory, read by anybody at any time (an iceoryx2 blackboard).
//! Created and opened by helper threads, handed over, written and read by the real-time threads: both allocate nothing
//! and make no system call.

use std::fmt;

use bytemuck::Pod;
use iceoryx2::port::reader::{EntryHandle, Reader};
use iceoryx2::port::writer::{EntryHandleMut, Writer};
use iceoryx2::prelude::{ServiceName, ipc_threadsafe};
use iceoryx2::service::builder::blackboard::{BlackboardOpenError, Creator};

use crate::process_instance::ProcessInstance;
use crate::session::{IceoryxError, Membership, Session, owner_of};
use crate::shared::Shared;
use crate::shm_space::{self, OutOfSharedMemory};

/// At most this many readers of one board, dead ones that were not cleaned up included.
pub const READERS_MAX: usize = 32;
/// Processes that may have a board open.
const NODES_MAX: usize = 40;
/// A board has one value; this is its key.
const KEY: u32 = 0;
/// Shared memory of a board beside its value.
const BOARD_ROOM: u64 = 256 << 10;

pub(crate) type Service = ipc_threadsafe::Service;

/// Why a board is not there.
#[derive(Debug, thiserror::Error)]
pub enum BoardError {
    /// Too little shared memory.
    #[error(transparent)]
    OutOfSharedMemory(#[from] OutOfSharedMemory),
    /// A name that is empty, too long or not printable.
    #[error("'{name}' cannot name a board: use up to 100 printable characters without spaces")]
    BadName {
        /// What was given.
        name: String,
    },
    /// No such board: its writer is gone, or has another incarnation now.
    #[error("there is no board {service}: read its writer's announcement again")]
    DoesNotExist {
        /// Full service name.
        service: String,
    },
    /// The board holds another type, or the same one with another layout.
    #[error(
        "board {service} does not hold {want} of {size} bytes: are both programs of the same build?"
    )]
    OtherLayout {
        /// Full service name.
        service: String,
        /// The type we expected.
        want: &'static str,
        /// Its bytes.
        size: usize,
    },
    /// Anything else that iceoryx2 says.
    #[error("board {service}: {cause}")]
    Failed {
        /// Full service name.
        service: String,
        /// What iceoryx2 said.
        cause: IceoryxError,
    },
}

/// The only writer of one board.
pub struct BoardWriter<T: Pod> {
    entry: EntryHandleMut<Service, u32, Shared<T>>,
    service: String,
    // Both keep the board in being as long as the entry is written.
    _writer: Writer<Service, u32>,
    _membership: Membership,
}

impl<T: Pod> BoardWriter<T> {
    /// Makes `value` the newest one. Real-time safe: two copies of the value and one atomic addition.
    /// A death in the midst of it leaves the old value.
    pub fn write(&mut self, value: &T) {
        self.entry.update_with_copy(Shared(*value));
    }

    /// Full name under which others open this board.
    #[must_use]
    pub fn service(&self) -> &str {
        &self.service
    }
}

impl<T: Pod> fmt::Debug for BoardWriter<T> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "BoardWriter({})", self.service)
    }
}

/// One reader of a board; the value stays readable after its writer's death.
pub struct BoardReader<T: Pod> {
    entry: EntryHandle<Service, u32, Shared<T>>,
    service: String,
    // Both keep the board in being as long as the entry is read.
    _reader: Reader<Service, u32>,
    _membership: Membership,
}

impl<T: Pod> BoardReader<T> {
    /// The newest value; all zero before the first write. Real-time safe: no allocation, no system call.
    ///
    /// iceoryx2 copies again when a write lands during the copy. This is the one loop without a constant bound that a
    /// cycle runs: a repetition needs another whole write within one copy (62 ns for 4 kB, with writers that write
    /// each millisecond), and never more than one was seen.
    #[must_use]
    pub fn read(&self) -> T {
        self.entry.get().0
    }

    /// Full name of the board.
    #[must_use]
    pub fn service(&self) -> &str {
        &self.service
    }

    /// The life of the process that writes it. Ask it with [`ProcessInstance::liveness`], not in a real-time thread.
    #[must_use]
    pub fn writer(&self) -> Option<ProcessInstance> {
        owner_of(&self.service)
    }
}

impl<T: Pod> fmt::Debug for BoardReader<T> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "BoardReader({})", self.service)
    }
}

impl Session {
    /// Creates the board `name` of this session with the value zero; up to some 100 kB are fine.
    ///
    /// # Errors
    /// Too little shared memory, a name used twice or of another form, or what iceoryx2 says.
    pub fn create_board<T: Pod>(&self, name: &str) -> Result<BoardWriter<T>, BoardError> {
        let (writer, service) =
            self.create_blackboard(name, size_of::<T>() as u64, |blackboard| {
                blackboard.add::<Shared<T>>(KEY, Shared(T::zeroed()))
            })?;
        let entry = writer
            .entry::<Shared<T>>(&KEY)
            .map_err(|error| BoardError::Failed {
                service: service.clone(),
                cause: IceoryxError::of(error),
            })?;
        Ok(BoardWriter {
            entry,
            service,
            _writer: writer,
            _membership: self.membership(),
        })
    }

    /// Opens the board of that full name, as its writer announced it.
    ///
    /// # Errors
    /// No such board, another layout, too many readers, or what iceoryx2 says.
    pub fn open_board<T: Pod>(&self, service: &str) -> Result<BoardReader<T>, BoardError> {
        let reader = self.open_blackboard(service)?;
        // A board always has its key, so a refusal here is about the type.
        let entry = reader
            .entry::<Shared<T>>(&KEY)
            .map_err(|_| BoardError::OtherLayout {
                service: service.to_owned(),
                want: std::any::type_name::<T>(),
                size: size_of::<T>(),
            })?;
        Ok(BoardReader {
            entry,
            service: service.to_owned(),
            _reader: reader,
            _membership: self.membership(),
        })
    }

    /// A blackboard `name` of this session with the entries that `fill` adds, `bytes` in all, and its full name.
    pub(crate) fn create_blackboard(
        &self,
        name: &str,
        bytes: u64,
        fill: impl FnOnce(Creator<u32, Service>) -> Creator<u32, Service>,
    ) -> Result<(Writer<Service, u32>, String), BoardError> {
        // Each entry is there twice.
        shm_space::require(2 * bytes + BOARD_ROOM)?;
        let service_name = self.service_name(name).ok_or_else(|| BoardError::BadName {
            name: name.to_owned(),
        })?;
        let service = service_name.as_str().to_owned();
        let failed = |cause| BoardError::Failed {
            service: service.clone(),
            cause,
        };
        let blackboard = self
            .node()
            .service_builder(&service_name)
            .blackboard_creator::<u32>()
            .max_readers(READERS_MAX)
            .max_nodes(NODES_MAX);
        let blackboard = fill(blackboard)
            .create()
            .map_err(|error| failed(IceoryxError::of(error)))?;
        let writer = blackboard
            .writer_builder()
            .create()
            .map_err(|error| failed(IceoryxError::of(error)))?;
        Ok((writer, service))
    }

    /// A reader of the blackboard of that full name.
    pub(crate) fn open_blackboard(
        &self,
        service: &str,
    ) -> Result<Reader<Service, u32>, BoardError> {
        let failed = |cause| BoardError::Failed {
            service: service.to_owned(),
            cause,
        };
        let service_name = ServiceName::new(service).map_err(|_| BoardError::BadName {
            name: service.to_owned(),
        })?;
        let blackboard = self
            .node()
            .service_builder(&service_name)
            .blackboard_opener::<u32>()
            .open()
            .map_err(|error| match error {
                BlackboardOpenError::DoesNotExist => BoardError::DoesNotExist {
                    service: service.to_owned(),
                },
                other => failed(IceoryxError::of(other)),
            })?;
        blackboard
            .reader_builder()
            .create()
            .map_err(|error| failed(IceoryxError::of(error)))
    }
}
