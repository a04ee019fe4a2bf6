//! Streams: fixed-size records from one publisher to any number of subscribers (iceoryx2 publish/subscribe). Used by
//! the pump thread and by monitors, never by a real-time thread: sending allocates and maps memory.

use std::fmt;
use std::marker::PhantomData;

use bytemuck::Pod;
use iceoryx2::port::backpressure_strategy::BackpressureStrategy as Backpressure;
use iceoryx2::port::publisher::Publisher as IoxPublisher;
use iceoryx2::port::subscriber::{Subscriber as IoxSubscriber, SubscriberCreateError};
use iceoryx2::prelude::{PayloadHeader, ServiceName, ipc_threadsafe};
use iceoryx2::service::builder::publish_subscribe::PublishSubscribeOpenError;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;

use crate::failed_connections::FailedConnections;
use crate::session::{IceoryxError, Membership, Session, owner_of};
use crate::shared::Shared;
use crate::shm_space::{self, OutOfSharedMemory};

/// Maximum number of subscribers of one stream, including dead ones that have not been cleaned up.
pub const SUBSCRIBERS_MAX: usize = 16;
/// Number of batches buffered per subscriber; older ones are lost. With one batch per millisecond: 128 ms.
pub const BATCHES_MAX: usize = 128;

/// Size of a full batch, bytes, unless a single record is larger.
const BATCH_BYTES: usize = 4096;
/// Shared memory that a stream needs besides its batches, bytes.
const STREAM_ROOM: u64 = 1 << 20;

type Service = ipc_threadsafe::Service;

/// Returns the number of `T` records that fit into one batch; [`Publisher::publish`] splits longer slices.
#[must_use]
pub const fn batch_records_max<T>() -> usize {
    let size = if size_of::<T>() == 0 {
        1
    } else {
        size_of::<T>()
    };
    let fit = BATCH_BYTES / size;
    if fit == 0 { 1 } else { fit }
}

/// Error of a stream.
#[derive(Debug, thiserror::Error)]
pub enum StreamError {
    /// Not enough shared memory.
    #[error(transparent)]
    OutOfSharedMemory(#[from] OutOfSharedMemory),
    /// The name is empty, too long or not printable.
    #[error("invalid stream name `{name}`: use up to 100 printable characters without spaces")]
    BadName {
        /// The given name.
        name: String,
    },
    /// The stream does not exist: its process has ended, or was restarted under another incarnation.
    #[error("stream {service} not found: read its publisher's announcement again")]
    DoesNotExist {
        /// Full service name.
        service: String,
    },
    /// The stream has records of another type, or of the same type with another layout.
    #[error(
        "stream {service} does not carry {want} of {size} bytes: are both programs of the same build?"
    )]
    OtherLayout {
        /// Full service name.
        service: String,
        /// The type that was expected.
        want: &'static str,
        /// Size of that type, bytes.
        size: usize,
    },
    /// The stream has the maximum number of subscribers, possibly including dead ones that no janitor has cleaned up.
    #[error("stream {service} already has {SUBSCRIBERS_MAX} subscribers: stop one of them")]
    Full {
        /// Full service name.
        service: String,
    },
    /// Any other error from iceoryx2.
    #[error("stream {service}: {cause}")]
    Failed {
        /// Full service name.
        service: String,
        /// Error from iceoryx2.
        cause: IceoryxError,
    },
}

/// The sending end of a stream.
pub struct Publisher<T: Pod> {
    publisher: IoxPublisher<Service, [Shared<T>], ()>,
    factory: Factory<T>,
    failed: FailedConnections,
    service: String,
    _membership: Membership,
}

impl<T: Pod> fmt::Debug for Publisher<T> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "Publisher({})", self.service)
    }
}

impl<T: Pod> Publisher<T> {
    /// Sends the records in order; returns at once. A subscriber that is too slow loses its oldest batches. Collect the
    /// records of at least a millisecond per call: each call uses at least one of [`BATCHES_MAX`] buffer places.
    ///
    /// # Errors
    /// Returns an error if iceoryx2 fails; earlier batches were sent.
    pub fn publish(&mut self, records: &[T]) -> Result<(), StreamError> {
        if self.failed.take_due() {
            // A subscriber that comes and goes changes the list of subscribers, for which `send` connects to all of them.
            drop(self.factory.subscriber_builder().create());
        }
        for batch in records.chunks(batch_records_max::<T>()) {
            let loan = self
                .publisher
                .loan_slice_uninit(batch.len())
                .map_err(|error| self.failed(error))?;
            let mut rest = batch.iter().copied();
            let sample = loan.write_from_fn(|_| Shared(rest.next().unwrap_or_else(T::zeroed)));
            sample.send().map_err(|error| self.failed(error))?;
        }
        Ok(())
    }

    /// Returns the full name under which other processes subscribe.
    #[must_use]
    pub fn service(&self) -> &str {
        &self.service
    }

    fn failed(&self, error: impl fmt::Debug) -> StreamError {
        StreamError::Failed {
            service: self.service.clone(),
            cause: IceoryxError::of(error),
        }
    }
}

/// The receiving end of a stream; it gets records that are published after it subscribed.
pub struct Subscriber<T: Pod> {
    subscriber: Port<T>,
    factory: Factory<T>,
    failed: FailedConnections,
    service: String,
    _membership: Membership,
    _record: PhantomData<T>,
}

impl<T: Pod> fmt::Debug for Subscriber<T> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "Subscriber({})", self.service)
    }
}

impl<T: Pod> Subscriber<T> {
    /// Returns the next batch, if any; never waits. Lost records between two batches show in the sequence numbers that
    /// the records carry.
    ///
    /// # Errors
    /// Returns an error if iceoryx2 fails, or if a batch claims more records than fit.
    pub fn next_batch(&mut self) -> Result<Option<Vec<T>>, StreamError> {
        let mut records = Vec::new();
        Ok(self.read_into(&mut records)?.then_some(records))
    }

    /// Like [`Subscriber::next_batch`], appending to `records`; returns false if there was no batch.
    ///
    /// # Errors
    /// As [`Subscriber::next_batch`].
    pub fn read_into(&mut self, records: &mut Vec<T>) -> Result<bool, StreamError> {
        let failed = |cause| StreamError::Failed {
            service: self.service.clone(),
            cause,
        };
        if self.failed.take_due() {
            self.subscriber = port(&self.factory, &self.failed)
                .map_err(|error| failed(IceoryxError::of(error)))?;
        }
        let received = self
            .subscriber
            .receive()
            .map_err(|error| failed(IceoryxError::of(error)))?;
        let Some(sample) = received else {
            return Ok(false);
        };
        // The publisher sets this length, so check it before touching the payload.
        let count = sample.header().number_of_elements();
        if count > batch_records_max::<T>() as u64 {
            return Err(failed(IceoryxError(format!(
                "a batch claims {count} records"
            ))));
        }
        records.extend(sample.payload().iter().map(|record| record.0));
        Ok(true)
    }

    /// Returns the full name of the stream.
    #[must_use]
    pub fn service(&self) -> &str {
        &self.service
    }

    /// Returns true if the process that created the stream is known to be dead; records that it sent can still be read.
    #[must_use]
    pub fn publisher_is_dead(&self) -> bool {
        owner_of(&self.service).is_some_and(|instance| instance.liveness().is_dead())
    }
}

type Factory<T> = PortFactory<Service, [Shared<T>], ()>;
type Port<T> = IoxSubscriber<Service, [Shared<T>], ()>;

/// Creates the port of a subscriber.
fn port<T: Pod>(
    factory: &Factory<T>,
    failed: &FailedConnections,
) -> Result<Port<T>, SubscriberCreateError> {
    factory
        .subscriber_builder()
        .buffer_size(BATCHES_MAX)
        .set_degradation_handler(failed.handler())
        .create()
}

impl Session {
    /// Creates the stream `name` of this session.
    ///
    /// # Errors
    /// Returns an error if shared memory is short, if the name is invalid or in use, or if iceoryx2 fails.
    pub fn publisher<T: Pod>(&self, name: &str) -> Result<Publisher<T>, StreamError> {
        let batch = batch_records_max::<T>() * size_of::<T>() + 64;
        shm_space::require((batch * SUBSCRIBERS_MAX * (BATCHES_MAX + 2)) as u64 + STREAM_ROOM)?;
        let service_name = self
            .service_name(name)
            .ok_or_else(|| StreamError::BadName {
                name: name.to_owned(),
            })?;
        let service = service_name.as_str().to_owned();
        let failed = |cause| StreamError::Failed {
            service: service.clone(),
            cause,
        };
        let factory = self
            .node()
            .service_builder(&service_name)
            .publish_subscribe::<[Shared<T>]>()
            .max_publishers(1)
            .max_subscribers(SUBSCRIBERS_MAX)
            .max_nodes(SUBSCRIBERS_MAX + 1)
            .subscriber_max_buffer_size(BATCHES_MAX)
            .subscriber_max_borrowed_samples(2)
            .history_size(0)
            .enable_safe_overflow(true)
            .create()
            .map_err(|error| failed(IceoryxError::of(error)))?;
        let failed_connections = FailedConnections::default();
        let publisher = factory
            .publisher_builder()
            .initial_max_slice_len(batch_records_max::<T>())
            .max_loaned_samples(1)
            .backpressure_strategy(Backpressure::DiscardData)
            .set_degradation_handler(failed_connections.handler())
            .create()
            .map_err(|error| failed(IceoryxError::of(error)))?;
        Ok(Publisher {
            publisher,
            factory,
            failed: failed_connections,
            service,
            _membership: self.membership(),
        })
    }

    /// Subscribes to a stream by the full name that its process announced.
    ///
    /// # Errors
    /// Returns an error if the stream does not exist, has another layout or too many subscribers, or if iceoryx2 fails.
    pub fn subscribe<T: Pod>(&self, service: &str) -> Result<Subscriber<T>, StreamError> {
        shm_space::require(STREAM_ROOM)?;
        let failed = |cause| StreamError::Failed {
            service: service.to_owned(),
            cause,
        };
        let full = || StreamError::Full {
            service: service.to_owned(),
        };
        let service_name = ServiceName::new(service).map_err(|_| StreamError::BadName {
            name: service.to_owned(),
        })?;
        let factory = self
            .node()
            .service_builder(&service_name)
            .publish_subscribe::<[Shared<T>]>()
            .open()
            .map_err(|error| match error {
                PublishSubscribeOpenError::ExceedsMaxNumberOfNodes => full(),
                PublishSubscribeOpenError::DoesNotExist => StreamError::DoesNotExist {
                    service: service.to_owned(),
                },
                PublishSubscribeOpenError::IncompatibleTypes => StreamError::OtherLayout {
                    service: service.to_owned(),
                    want: std::any::type_name::<T>(),
                    size: size_of::<T>(),
                },
                other => failed(IceoryxError::of(other)),
            })?;
        let failed_connections = FailedConnections::default();
        let subscriber = port(&factory, &failed_connections).map_err(|error| match error {
            SubscriberCreateError::ExceedsMaxSupportedSubscribers => full(),
            other => failed(IceoryxError::of(other)),
        })?;
        Ok(Subscriber {
            subscriber,
            factory,
            failed: failed_connections,
            service: service.to_owned(),
            _membership: self.membership(),
            _record: PhantomData,
        })
    }
}
