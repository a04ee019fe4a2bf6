//! Requests and answers of bytes between processes (iceoryx2 request/response). A request wakes its server; a client
//! polls for its answer, because the real-time thread, which has it, wakes nobody. A long request travels as a file next
//! to the shared memory, because as a message it would make both sides map ten times its size.
//! Runs on threads that are not real-time: a call allocates, and maps memory when peers come and go.

use std::fmt;
use std::io;
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use iceoryx2::active_request::ActiveRequest;
use iceoryx2::pending_response::PendingResponse;
use iceoryx2::port::SendError;
use iceoryx2::port::backpressure_strategy::BackpressureStrategy as Backpressure;
use iceoryx2::port::client::{Client as IoxClient, RequestSendError};
use iceoryx2::port::server::Server as IoxServer;
use iceoryx2::prelude::{PayloadHeader, ServiceName, ipc_threadsafe};
use iceoryx2::service::builder::request_response::RequestResponseOpenError;
use iceoryx2::service::port_factory::PortFactory as _;
use iceoryx2::service::port_factory::client::ClientCreateError;
use iceoryx2::service::port_factory::request_response::PortFactory;
use rcc_os::process_instance::ProcessInstance;
use rcc_protocol::control::{REQUEST_MAX, RESPONSE_MAX};

use crate::failed_connections::FailedConnections;
use crate::session::{IceoryxError, Membership, Session, owner_of};
use crate::shm_space::{self, OutOfSharedMemory};
use crate::spill_file::{self, SpillError, SpillFile};
use crate::wake::{WakeReceiver, WakeSender};

/// Maximum number of clients of one server, including dead ones that have not been cleaned up.
pub const CLIENTS_MAX: usize = 32;

/// Calls of one client that a server may hold: the current one, and one that the client gave up before calling again.
const ACTIVE_MAX: usize = 2;
/// Maximum length of a client's message, bytes; a longer request goes into a file that the message names.
const MESSAGE_MAX: usize = 4 << 10;
/// Number of answers that a server preallocates. iceoryx2 would preallocate 256 of maximum length, and an executor
/// locks all of its memory.
const ANSWERS_MAX: usize = 16;
/// Shared memory of a client or server, bytes; measured below 900 kB.
const PORT_ROOM: u64 = 1 << 20;
/// Shortest and longest polling interval of a client that waits for an answer. In between it is a [`POLL_DIVISOR`]th of the
/// time already waited, so that an answer is noticed little later than it arrives.
const POLL_FIRST: Duration = Duration::from_micros(50);
const POLL_LAST: Duration = Duration::from_millis(1);
const POLL_DIVISOR: u32 = 16;
/// Interval at which a waiting client checks whether the server's process is alive.
const LIFE_CHECK: Duration = Duration::from_millis(20);

type Service = ipc_threadsafe::Service;

/// Error while creating a server or client.
#[derive(Debug, thiserror::Error)]
pub enum RequestError {
    /// Not enough shared memory.
    #[error(transparent)]
    OutOfSharedMemory(#[from] OutOfSharedMemory),
    /// The name is empty, too long or not printable.
    #[error("invalid server name `{name}`: use up to 100 printable characters without spaces")]
    BadName {
        /// The given name.
        name: String,
    },
    /// The socket that wakes the server cannot be created.
    #[error("server {service}: the socket that wakes it cannot be created: {source}")]
    Wake {
        /// Full service name.
        service: String,
        /// Error from the system.
        source: std::io::Error,
    },
    /// The server does not exist: its process has ended, or was restarted under another incarnation.
    #[error("server {service} not found: read its announcement again")]
    DoesNotExist {
        /// Full service name.
        service: String,
    },
    /// Any other error from iceoryx2.
    #[error("server {service}: {cause}")]
    Failed {
        /// Full service name.
        service: String,
        /// Error from iceoryx2.
        cause: IceoryxError,
    },
}

/// Error while polling for a request.
#[derive(Debug, thiserror::Error)]
pub enum PollError {
    /// The message is invalid, or names a file that is missing or invalid. The client is told that no answer comes.
    #[error("server {service} refused a request: {fault}")]
    Refused {
        /// Full service name.
        service: String,
        /// Fault of the message.
        fault: SpillError,
    },
    /// Any other error from iceoryx2.
    #[error("server {service} cannot receive: {cause}")]
    Failed {
        /// Full service name.
        service: String,
        /// Error from iceoryx2.
        cause: IceoryxError,
    },
}

/// Error while sending an answer.
#[derive(Debug, thiserror::Error)]
pub enum AnswerError {
    /// The answer is longer than [`RESPONSE_MAX`]; the client is told that no answer comes.
    #[error("answer too long: {size} bytes, the limit is {max}")]
    TooLarge {
        /// Its length, bytes.
        size: usize,
        /// The limit, bytes.
        max: usize,
    },
    /// Any other error from iceoryx2. If it ran out of memory, clients do not take their answers.
    #[error("the answer cannot be sent: {cause}")]
    Failed {
        /// Error from iceoryx2.
        cause: IceoryxError,
    },
}

/// Error of a call.
#[derive(Debug, thiserror::Error)]
pub enum CallError {
    /// The server is alive but did not answer in time. It is unknown whether it carries out the request.
    #[error("{service} did not answer within {waited:?}")]
    Timeout {
        /// Full service name.
        service: String,
        /// Time waited.
        waited: Duration,
    },
    /// The server's process died, or closed the server.
    #[error("{service} is gone: read its announcement again")]
    ServerGone {
        /// Full service name.
        service: String,
    },
    /// The server dropped the request without answering.
    #[error("{service} accepted the request but sent no answer")]
    Unanswered {
        /// Full service name.
        service: String,
    },
    /// The request is longer than [`REQUEST_MAX`], or the answer claims to be longer than [`RESPONSE_MAX`].
    #[error("message too long: {size} bytes, the limit is {max}")]
    TooLarge {
        /// Its length, bytes.
        size: usize,
        /// The limit, bytes.
        max: usize,
    },
    /// Not enough shared memory for this request.
    #[error(transparent)]
    OutOfSharedMemory(#[from] OutOfSharedMemory),
    /// The file of a long request cannot be written.
    #[error(transparent)]
    SpillFile(#[from] SpillError),
    /// Any other error from iceoryx2.
    #[error("{service}: {cause}")]
    Failed {
        /// Full service name.
        service: String,
        /// Error from iceoryx2.
        cause: IceoryxError,
    },
}

/// Receives requests of several clients.
pub struct Server {
    server: IoxServer<Service, [u8], (), [u8], ()>,
    factory: Factory,
    failed: FailedConnections,
    wake: WakeReceiver,
    service: String,
    folder: PathBuf,
    membership: Membership,
}

impl fmt::Debug for Server {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "Server({})", self.service)
    }
}

impl Server {
    /// Returns the next request, if any; never waits. Skips requests that their clients have given up.
    ///
    /// # Errors
    /// Returns an error if a request is invalid or if iceoryx2 fails. The server stays usable: log the error and
    /// continue.
    pub fn poll(&self) -> Result<Option<Request>, PollError> {
        if self.failed.take_due() {
            // A client that comes and goes changes the list of clients, for which `receive` connects to all of them.
            drop(self.factory.client_builder().create());
        }
        let received = self.server.receive().map_err(|error| PollError::Failed {
            service: self.service.clone(),
            cause: IceoryxError::of(error),
        })?;
        let Some(active) = received else {
            return Ok(None);
        };
        // The client sets this length, so check it before touching the payload.
        let claimed = active.header().number_of_elements();
        let message = if claimed > MESSAGE_MAX as u64 {
            Err(SpillError::TooLarge {
                size: claimed,
                max: MESSAGE_MAX as u64,
            })
        } else {
            spill_file::open(&self.folder, active.payload())
        };
        match message {
            Ok(bytes) => Ok(Some(Request {
                active,
                bytes,
                _membership: self.membership.clone(),
            })),
            Err(fault) => Err(PollError::Refused {
                service: self.service.clone(),
                fault,
            }),
        }
    }

    /// Waits until a request has arrived since the last wait, at most `timeout`; may return early.
    pub fn wait(&self, timeout: Duration) {
        self.wake.wait(timeout);
    }

    /// Returns an end that wakes [`Server::wait`], for a thread that has something for the thread that waits.
    ///
    /// # Errors
    /// Returns an error if the system has no socket left.
    pub fn waker(&self) -> io::Result<WakeSender> {
        WakeSender::connect(&self.folder, &self.service)
    }

    /// Returns the full name under which clients find this server.
    #[must_use]
    pub fn service(&self) -> &str {
        &self.service
    }
}

/// One request. It may be kept, sent to another thread and answered later; if it is dropped, the client is told at
/// once.
pub struct Request {
    active: ActiveRequest<Service, [u8], (), [u8], ()>,
    bytes: Vec<u8>,
    _membership: Membership,
}

impl fmt::Debug for Request {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "Request({} bytes)", self.bytes().len())
    }
}

impl Request {
    /// Returns a copy of the bytes that the client sent, which the client cannot change any more. They may be anything:
    /// decode them with care.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Takes the bytes out, so that another thread can decode them.
    #[must_use]
    pub fn take_bytes(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.bytes)
    }

    /// Returns true while the client waits for the answer (also for a client that was killed just now).
    #[must_use]
    pub fn is_awaited(&self) -> bool {
        self.active.is_connected()
    }

    /// Sends the answer. A client that is gone, or hangs, is not an error.
    ///
    /// # Errors
    /// Returns an error if the answer is too long, or if iceoryx2 fails.
    pub fn answer(self, bytes: &[u8]) -> Result<(), AnswerError> {
        if bytes.len() > RESPONSE_MAX {
            return Err(AnswerError::TooLarge {
                size: bytes.len(),
                max: RESPONSE_MAX,
            });
        }
        let failed = |cause| AnswerError::Failed { cause };
        let response = self
            .active
            .loan_slice_uninit(bytes.len())
            .map_err(|error| failed(IceoryxError::of(error)))?;
        response
            .write_from_slice(bytes)
            .send()
            .map_err(|error| failed(IceoryxError::of(error)))
    }
}

/// Sends requests to one server.
pub struct Client {
    client: Mutex<Port>,
    factory: Factory,
    failed: FailedConnections,
    wake: Option<WakeSender>,
    service: String,
    folder: PathBuf,
    server: Option<ProcessInstance>,
    _membership: Membership,
}

impl fmt::Debug for Client {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "Client({})", self.service)
    }
}

impl Client {
    /// Sends `request` and waits at most `timeout` for the answer.
    ///
    /// # Errors
    /// Returns [`CallError`]; the client stays usable after an error.
    pub fn call(&self, request: &[u8], timeout: Duration) -> Result<Vec<u8>, CallError> {
        let started = Instant::now();
        // The file of a long request stays until the answer arrives or is no longer awaited.
        let (pending, _file) = self.send(request)?;
        let mut life_checked = started;
        loop {
            // In this order: the answer may arrive between the two checks.
            let open = pending.is_connected();
            if let Some(answer) = self.answer(&pending)? {
                return Ok(answer);
            }
            if !open {
                return Err(self.no_answer());
            }
            let now = Instant::now();
            if now.duration_since(life_checked) >= LIFE_CHECK {
                life_checked = now;
                if self.server_is_dead() {
                    return Err(CallError::ServerGone {
                        service: self.service.clone(),
                    });
                }
            }
            if now.duration_since(started) >= timeout {
                let service = self.service.clone();
                return Err(CallError::Timeout {
                    service,
                    waited: timeout,
                });
            }
            let pause = now.duration_since(started) / POLL_DIVISOR;
            std::thread::sleep(pause.clamp(POLL_FIRST, POLL_LAST));
        }
    }

    /// Returns the full name of the server.
    #[must_use]
    pub fn service(&self) -> &str {
        &self.service
    }

    /// Returns true if the process that created the server is known to be dead.
    #[must_use]
    pub fn server_is_dead(&self) -> bool {
        self.server
            .is_some_and(|instance| instance.liveness().is_dead())
    }

    fn port(&self) -> MutexGuard<'_, Port> {
        // Only whole ports are stored.
        self.client.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn send(&self, request: &[u8]) -> Result<(Pending, Option<SpillFile>), CallError> {
        let size = request.len();
        if size > REQUEST_MAX {
            return Err(CallError::TooLarge {
                size,
                max: REQUEST_MAX,
            });
        }
        if self.server_is_dead() {
            return Err(CallError::ServerGone {
                service: self.service.clone(),
            });
        }
        let (message, file) = if spill_file::fits(size, MESSAGE_MAX) {
            (spill_file::message(request), None)
        } else {
            shm_space::require(size as u64)?;
            let (message, file) = SpillFile::create(&self.folder, request)?;
            (message, Some(file))
        };
        if self.failed.take_due() {
            let port = port(&self.factory, &self.failed).map_err(|error| self.failed(error))?;
            *self.port() = port;
        }
        let loan = self
            .port()
            .loan_slice_uninit(message.len())
            .map_err(|error| self.failed(error))?;
        let pending = loan
            .write_from_slice(&message)
            .send()
            .map_err(|error| match error {
                RequestSendError::SendError(SendError::UnableToDeliver) => CallError::ServerGone {
                    service: self.service.clone(),
                },
                other => self.failed(other),
            })?;
        if pending.number_of_server_connections() == 0 {
            return Err(CallError::ServerGone {
                service: self.service.clone(),
            });
        }
        if let Some(server) = &self.wake {
            server.wake();
        }
        Ok((pending, file))
    }

    fn answer(&self, pending: &Pending) -> Result<Option<Vec<u8>>, CallError> {
        let Some(response) = pending.receive().map_err(|error| self.failed(error))? else {
            return Ok(None);
        };
        // The server sets this length, so check it before touching the payload.
        let size = usize::try_from(response.header().number_of_elements()).unwrap_or(usize::MAX);
        if size > RESPONSE_MAX {
            return Err(CallError::TooLarge {
                size,
                max: RESPONSE_MAX,
            });
        }
        Ok(Some(response.payload().to_vec()))
    }

    /// Distinguishes a live server that dropped the request from a server that is gone.
    fn no_answer(&self) -> CallError {
        let service = self.service.clone();
        if !self.server_is_dead() && self.servers() > 0 {
            CallError::Unanswered { service }
        } else {
            CallError::ServerGone { service }
        }
    }

    fn servers(&self) -> usize {
        self.factory.dynamic_config().number_of_servers()
    }

    fn failed(&self, error: impl fmt::Debug) -> CallError {
        CallError::Failed {
            service: self.service.clone(),
            cause: IceoryxError::of(error),
        }
    }
}

type Factory = PortFactory<Service, [u8], (), [u8], ()>;
type Port = IoxClient<Service, [u8], (), [u8], ()>;
/// Creates the port of a client.
fn port(factory: &Factory, failed: &FailedConnections) -> Result<Port, ClientCreateError> {
    factory
        .client_builder()
        .initial_max_slice_len(MESSAGE_MAX)
        .backpressure_strategy(Backpressure::DiscardData)
        .set_request_degradation_handler(failed.handler())
        .set_response_degradation_handler(failed.handler())
        .create()
}

type Pending = PendingResponse<Service, [u8], (), [u8], ()>;

impl Session {
    /// Creates the server `name` of this session.
    ///
    /// # Errors
    /// Returns an error if shared memory is short, if the name is invalid or in use, or if iceoryx2 fails.
    pub fn serve(&self, name: &str) -> Result<Server, RequestError> {
        shm_space::require(PORT_ROOM)?;
        let service_name = self
            .service_name(name)
            .ok_or_else(|| RequestError::BadName {
                name: name.to_owned(),
            })?;
        let service = service_name.as_str().to_owned();
        let failed = |cause| RequestError::Failed {
            service: service.clone(),
            cause,
        };
        let factory = self
            .node()
            .service_builder(&service_name)
            .request_response::<[u8], [u8]>()
            .max_servers(1)
            .max_clients(CLIENTS_MAX)
            .max_nodes(CLIENTS_MAX + 1)
            .max_loaned_requests(1)
            .max_active_requests_per_client(ACTIVE_MAX)
            .max_response_buffer_size(1)
            .max_borrowed_responses_per_pending_response(1)
            // A server that does not poll loses the oldest requests, and blocks no client.
            .enable_safe_overflow_for_requests(true)
            .enable_safe_overflow_for_responses(true)
            .enable_fire_and_forget_requests(false)
            .create()
            .map_err(|error| failed(IceoryxError::of(error)))?;
        let failed_connections = FailedConnections::default();
        let server = factory
            .server_builder()
            .initial_max_slice_len(RESPONSE_MAX)
            .override_response_preallocation(|_| ANSWERS_MAX)
            .max_loaned_responses_per_request(1)
            .backpressure_strategy(Backpressure::DiscardData)
            .set_request_degradation_handler(failed_connections.handler())
            .set_response_degradation_handler(failed_connections.handler())
            .create()
            .map_err(|error| failed(IceoryxError::of(error)))?;
        let folder = self.cell().iox_root();
        // Not before the server exists: a client that finds the socket must find the server.
        let wake = WakeReceiver::bind(&folder, &service).map_err(|source| RequestError::Wake {
            service: service.clone(),
            source,
        })?;
        Ok(Server {
            server,
            factory,
            failed: failed_connections,
            wake,
            service,
            folder,
            membership: self.membership(),
        })
    }

    /// Opens a server by the full name that its process announced.
    ///
    /// # Errors
    /// Returns an error if the server does not exist or has too many clients, if shared memory is short, or if iceoryx2
    /// fails.
    pub fn client(&self, service: &str) -> Result<Client, RequestError> {
        shm_space::require(PORT_ROOM)?;
        let failed = |cause| RequestError::Failed {
            service: service.to_owned(),
            cause,
        };
        let service_name = ServiceName::new(service).map_err(|_| RequestError::BadName {
            name: service.to_owned(),
        })?;
        let factory = self
            .node()
            .service_builder(&service_name)
            .request_response::<[u8], [u8]>()
            .open()
            .map_err(|error| match error {
                RequestResponseOpenError::DoesNotExist => RequestError::DoesNotExist {
                    service: service.to_owned(),
                },
                other => failed(IceoryxError::of(other)),
            })?;
        let failed_connections = FailedConnections::default();
        let client =
            port(&factory, &failed_connections).map_err(|error| failed(IceoryxError::of(error)))?;
        let folder = self.cell().iox_root();
        Ok(Client {
            client: Mutex::new(client),
            factory,
            failed: failed_connections,
            // Without it the server finds the request when it polls.
            wake: WakeSender::connect(&folder, service).ok(),
            service: service.to_owned(),
            folder,
            server: owner_of(service),
            _membership: self.membership(),
        })
    }
}
