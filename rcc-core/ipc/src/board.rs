//! Boards: the newest value of one writer in shared memory, which any process can read at any time (an iceoryx2
//! blackboard). Helper threads create and open boards and hand them over; real-time threads write and read them without
//! allocation or system call.

use std::fmt;

use bytemuck::Pod;
use iceoryx2::port::reader::{EntryHandle, Reader};
use iceoryx2::port::writer::{EntryHandleMut, Writer};
use iceoryx2::prelude::{ServiceName, ipc_threadsafe};
use iceoryx2::service::builder::blackboard::{BlackboardOpenError, Creator};
use rcc_os::process_instance::ProcessInstance;

use crate::session::{IceoryxError, Membership, Session, owner_of};
use crate::shared::Shared;
use crate::shm_space::{self, OutOfSharedMemory};

/// Maximum number of readers of one board, including dead readers that have not been cleaned up.
pub const READERS_MAX: usize = 32;
/// Maximum number of processes that have a board open.
const NODES_MAX: usize = 40;
/// Key of the single value of a board.
const KEY: u32 = 0;
/// Shared memory that a board needs besides its value, bytes.
const BOARD_ROOM: u64 = 256 << 10;

pub(crate) type Service = ipc_threadsafe::Service;

/// Error while creating or opening a board.
#[derive(Debug, thiserror::Error)]
pub enum BoardError {
    /// Not enough shared memory.
    #[error(transparent)]
    OutOfSharedMemory(#[from] OutOfSharedMemory),
    /// The name is empty, too long or not printable.
    #[error("invalid board name `{name}`: use up to 100 printable characters without spaces")]
    BadName {
        /// The given name.
        name: String,
    },
    /// The board does not exist: its writer has ended, or was restarted under another incarnation.
    #[error("board {service} not found: read its writer's announcement again")]
    DoesNotExist {
        /// Full service name.
        service: String,
    },
    /// The board holds another type, or the same type with another layout.
    #[error(
        "board {service} does not hold {want} of {size} bytes: are both programs of the same build?"
    )]
    OtherLayout {
        /// Full service name.
        service: String,
        /// The type that was expected.
        want: &'static str,
        /// Size of that type, bytes.
        size: usize,
    },
    /// Any other error from iceoryx2.
    #[error("board {service}: {cause}")]
    Failed {
        /// Full service name.
        service: String,
        /// Error from iceoryx2.
        cause: IceoryxError,
    },
}

/// The only writer of one board.
pub struct BoardWriter<T: Pod> {
    entry: EntryHandleMut<Service, u32, Shared<T>>,
    service: String,
    // Both keep the board alive as long as the entry is written.
    _writer: Writer<Service, u32>,
    _membership: Membership,
}

impl<T: Pod> BoardWriter<T> {
    /// Publishes `value` as the newest value. Real-time safe: two copies of the value and one atomic addition. If the
    /// process dies during the call, readers keep the old value.
    #[inline]
    pub fn write(&mut self, value: &T) {
        self.entry.update_with_copy(Shared(*value));
    }

    /// Returns the full name under which other processes open this board.
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

/// One reader of a board; the value stays readable after the writer has died.
pub struct BoardReader<T: Pod> {
    entry: EntryHandle<Service, u32, Shared<T>>,
    service: String,
    // Both keep the board alive as long as the entry is read.
    _reader: Reader<Service, u32>,
    _membership: Membership,
}

impl<T: Pod> BoardReader<T> {
    /// Returns the newest value; all zero before the first write. Real-time safe: no allocation, no system call.
    ///
    /// iceoryx2 repeats the copy if a write lands during it. This is the only loop in a cycle without a constant bound:
    /// a repetition needs another complete write within one copy (62 ns for 4 kB, with writers that write once per
    /// millisecond). More than one repetition was never observed.
    #[must_use]
    pub fn read(&self) -> T {
        self.entry.get().0
    }

    /// As [`BoardReader::read`], and copies the value to `place`, once less.
    #[inline]
    pub fn read_into(&self, place: &mut T) {
        *place = self.entry.get().0;
    }

    /// Returns the full name of the board.
    #[must_use]
    pub fn service(&self) -> &str {
        &self.service
    }

    /// Returns the process instance that writes the board. Calling [`ProcessInstance::liveness`] on it is not real-time
    /// safe.
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
    /// Creates the board `name` of this session with an all-zero value. Values up to about 100 kB are practical.
    ///
    /// # Errors
    /// Returns an error if shared memory is short, if the name is invalid or in use, or if iceoryx2 fails.
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

    /// Opens a board by the full name that its writer announced.
    ///
    /// # Errors
    /// Returns an error if the board does not exist, has another layout or too many readers, or if iceoryx2 fails.
    pub fn open_board<T: Pod>(&self, service: &str) -> Result<BoardReader<T>, BoardError> {
        let reader = self.open_blackboard(service)?;
        // A board always has its key, so a refusal here is a type mismatch.
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

    /// Creates the blackboard `name` of this session with the entries that `fill` adds (`bytes` in total); returns its
    /// writer and its full name.
    pub(crate) fn create_blackboard(
        &self,
        name: &str,
        bytes: u64,
        fill: impl FnOnce(Creator<u32, Service>) -> Creator<u32, Service>,
    ) -> Result<(Writer<Service, u32>, String), BoardError> {
        // iceoryx2 stores each entry twice.
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

    /// Opens a reader of the blackboard with this full name.
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
