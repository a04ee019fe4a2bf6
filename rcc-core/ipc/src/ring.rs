//! Rings: a head and the last values of one writer in shared memory, each an entry of its own in an iceoryx2
//! blackboard. A write copies one value, however many the ring keeps. As with boards, helper threads create both ends,
//! and the real-time threads write and read without allocation or system call.

use std::fmt;

use bytemuck::Pod;
use iceoryx2::port::reader::{EntryHandle, Reader};
use iceoryx2::port::writer::{EntryHandleMut, Writer};
use rcc_os::process_instance::ProcessInstance;

use crate::board::{BoardError, Service};
use crate::session::{IceoryxError, Membership, Session, owner_of};
use crate::shared::Shared;

/// Key of the head; the values have the keys that follow.
const HEAD: u32 = 0;

/// The only writer of one ring.
pub struct RingWriter<H: Pod, T: Pod> {
    head: EntryHandleMut<Service, u32, Shared<H>>,
    places: Box<[EntryHandleMut<Service, u32, Shared<T>>]>,
    service: String,
    // Both keep the ring alive as long as it is written.
    _writer: Writer<Service, u32>,
    _membership: Membership,
}

impl<H: Pod, T: Pod> RingWriter<H, T> {
    /// Writes value `number`, replacing the value one ring length before it, and then the head. Real-time safe.
    #[inline]
    pub fn write(&mut self, number: u64, value: &T, head: &H) {
        if let Some(place) = self.places.get(place(number, self.places.len())) {
            place.update_with_copy(Shared(*value));
        }
        self.head.update_with_copy(Shared(*head));
    }

    /// Returns the full name under which other processes open this ring.
    #[must_use]
    pub fn service(&self) -> &str {
        &self.service
    }
}

impl<H: Pod, T: Pod> fmt::Debug for RingWriter<H, T> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "RingWriter({})", self.service)
    }
}

/// One reader of a ring; its values stay readable after the writer has died.
pub struct RingReader<H: Pod, T: Pod> {
    head: EntryHandle<Service, u32, Shared<H>>,
    places: Box<[EntryHandle<Service, u32, Shared<T>>]>,
    service: String,
    // Both keep the ring alive as long as it is read.
    _reader: Reader<Service, u32>,
    _membership: Membership,
}

impl<H: Pod, T: Pod> RingReader<H, T> {
    /// Returns the newest head; all zero before the first write. Real-time safe, like [`crate::BoardReader::read`].
    #[must_use]
    pub fn head(&self) -> H {
        self.head.get().0
    }

    /// Returns the value in the slot of value `number`: complete, but possibly already a later one. Writers therefore
    /// store the number in the value.
    #[must_use]
    pub fn at(&self, number: u64) -> T {
        let place = self.places.get(place(number, self.places.len()));
        place.map_or_else(T::zeroed, |entry| entry.get().0)
    }

    /// Returns the full name of the ring.
    #[must_use]
    pub fn service(&self) -> &str {
        &self.service
    }

    /// Returns the process instance that writes the ring. Calling [`ProcessInstance::liveness`] on it is not real-time
    /// safe.
    #[must_use]
    pub fn writer(&self) -> Option<ProcessInstance> {
        owner_of(&self.service)
    }
}

impl<H: Pod, T: Pod> fmt::Debug for RingReader<H, T> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "RingReader({})", self.service)
    }
}

/// Returns the slot of a value: less than `length`, which is greater than 0.
fn place(number: u64, length: usize) -> usize {
    (number % (length as u64).max(1)) as usize
}

impl Session {
    /// Creates the ring `name` of this session with `length` values, all zero.
    ///
    /// # Errors
    /// As [`Session::create_board`].
    pub fn create_ring<H: Pod, T: Pod>(
        &self,
        name: &str,
        length: u32,
    ) -> Result<RingWriter<H, T>, BoardError> {
        let bytes = size_of::<H>() + length as usize * size_of::<T>();
        let (writer, service) = self.create_blackboard(name, bytes as u64, |blackboard| {
            let blackboard = blackboard.add::<Shared<H>>(HEAD, Shared(H::zeroed()));
            (1..=length).fold(blackboard, |blackboard, key| {
                blackboard.add::<Shared<T>>(key, Shared(T::zeroed()))
            })
        })?;
        let failed = |error| BoardError::Failed {
            service: service.clone(),
            cause: IceoryxError::of(error),
        };
        let head = writer.entry::<Shared<H>>(&HEAD).map_err(failed)?;
        let places = (1..=length).map(|key| writer.entry::<Shared<T>>(&key).map_err(failed));
        Ok(RingWriter {
            head,
            places: places.collect::<Result<_, _>>()?,
            service,
            _writer: writer,
            _membership: self.membership(),
        })
    }

    /// Opens a ring by the full name that its writer announced.
    ///
    /// # Errors
    /// Returns an error if the ring does not exist, has another layout or length, or too many readers, or if iceoryx2
    /// fails.
    pub fn open_ring<H: Pod, T: Pod>(
        &self,
        service: &str,
        length: u32,
    ) -> Result<RingReader<H, T>, BoardError> {
        let reader = self.open_blackboard(service)?;
        // A writer of the same build has these keys, so a refusal here is a mismatch of builds.
        let other = |want, size| BoardError::OtherLayout {
            service: service.to_owned(),
            want,
            size,
        };
        let head = reader
            .entry::<Shared<H>>(&HEAD)
            .map_err(|_| other(std::any::type_name::<H>(), size_of::<H>()))?;
        let places = (1..=length).map(|key| {
            reader
                .entry::<Shared<T>>(&key)
                .map_err(|_| other(std::any::type_name::<T>(), size_of::<T>()))
        });
        Ok(RingReader {
            head,
            places: places.collect::<Result<_, _>>()?,
            service: service.to_owned(),
            _reader: reader,
            _membership: self.membership(),
        })
    }
}
