//! Requests and answers of bytes between processes (iceoryx2 request/response), polled by both sides. A long request
//! travels as a file beside the shared memory: as a message it would make both sides map ten times its size.
//! Run by threads that are not real-time: a call allocates, and maps memory when peers come and go.

use std::fmt;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use iceoryx2::active_request::ActiveRequest;
use iceoryx2::pending_response::PendingResponse;
use iceoryx2::port::backpressure_strategy::BackpressureStrategy as Backpressure;
use iceoryx2::port::client::{Client as IoxClient, RequestSendError};
use iceoryx2::port::server::Server as IoxServer;
use iceoryx2::port::{DegradationAction, SendError};
use iceoryx2::prelude::{PayloadHeader, ServiceName, ipc_threadsafe};
use iceoryx2::service::builder::request_response::RequestResponseOpenError;
use iceoryx2::service::port_factory::PortFactory as _;
use iceoryx2::service::port_factory::request_response::PortFactory;

use crate::process_instance::ProcessInstance;
use crate::session::{IceoryxError, Membership, Session, owner_of};
use crate::shm_space::{self, OutOfSharedMemory};
use crate::spill_file::{self, SpillError, SpillFile};

/// The longest request, in bytes (a plan with its tables).
pub const REQUEST_MAX: usize = 4 << 20;
/// The longest answer, in bytes.
pub const RESPONSE_MAX: usize = 16 << 10;
/// Clients of one server at a time, dead ones that were not cleaned up included.
pub const CLIENTS_MAX: usize = 32;

/// Calls of one client that a server may hold: one in progress, and one given up by a client that calls again.
const ACTIVE_MAX: usize = 2;
/// The longest message of a client: what is longer goes into a file, and the message names it.
const MESSAGE_MAX: usize = 4 << 10;
/// Answers that a server has memory for at a time; iceoryx2 would reckon with 256 of the longest, and an executor
/// locks all of its memory.
const ANSWERS_MAX: usize = 16;
/// Shared memory of a client or server; measured below 900 kB.
const PORT_ROOM: u64 = 1 << 20;
/// A client looks for the answer at these intervals: at once, then in growing steps.
const POLL_FIRST: Duration = Duration::from_micros(20);
const POLL_LAST: Duration = Duration::from_millis(1);
/// How often a waiting client looks whether the server's process still lives.
const LIFE_CHECK: Duration = Duration::from_millis(20);

type Service = ipc_threadsafe::Service;

/// Why there is no server or no client.
#[derive(Debug, thiserror::Error)]
pub enum RequestError {
    /// Too little shared memory.
    #[error(transparent)]
    OutOfSharedMemory(#[from] OutOfSharedMemory),
    /// A name that is empty, too long or not printable.
    #[error("'{name}' cannot name a server: use up to 100 printable characters without spaces")]
    BadName {
        /// What was given.
        name: String,
    },
    /// No such server: its process is gone, or has another incarnation now.
    #[error("there is no server {service}: read its announcement again")]
    DoesNotExist {
        /// Full service name.
        service: String,
    },
    /// Anything else that iceoryx2 says.
    #[error("server {service}: {cause}")]
    Failed {
        /// Full service name.
        service: String,
        /// What iceoryx2 said.
        cause: IceoryxError,
    },
}

/// Why a server has no request although something came, or may have come.
#[derive(Debug, thiserror::Error)]
pub enum PollError {
    /// A message that is none of ours, or a file that it names and that is none: its client is told that no answer
    /// comes.
    #[error("server {service} refused a request: {fault}")]
    Refused {
        /// Full service name.
        service: String,
        /// What is wrong with it.
        fault: SpillError,
    },
    /// Anything else that iceoryx2 says.
    #[error("server {service} cannot receive: {cause}")]
    Failed {
        /// Full service name.
        service: String,
        /// What iceoryx2 said.
        cause: IceoryxError,
    },
}

/// Why an answer was not sent.
#[derive(Debug, thiserror::Error)]
pub enum AnswerError {
    /// More than [`RESPONSE_MAX`] bytes; the client is told that no answer comes.
    #[error("an answer of {size} bytes is longer than {max}")]
    TooLarge {
        /// Its bytes.
        size: usize,
        /// The limit.
        max: usize,
    },
    /// Anything else that iceoryx2 says; that memory ran out means that clients do not take their answers.
    #[error("the answer cannot be sent: {cause}")]
    Failed {
        /// What iceoryx2 said.
        cause: IceoryxError,
    },
}

/// Why a call has no answer.
#[derive(Debug, thiserror::Error)]
pub enum CallError {
    /// The server lives but did not answer in time. Whether it does what was asked is not known.
    #[error("{service} did not answer within {waited:?}")]
    Timeout {
        /// Full service name.
        service: String,
        /// The time waited.
        waited: Duration,
    },
    /// The server's process died, or closed its server.
    #[error("{service} is gone: read its announcement again")]
    ServerGone {
        /// Full service name.
        service: String,
    },
    /// The server dropped the request without an answer.
    #[error("{service} took the request and gave no answer")]
    Unanswered {
        /// Full service name.
        service: String,
    },
    /// The request is longer than [`REQUEST_MAX`], or the answer claims to be longer than [`RESPONSE_MAX`].
    #[error("a message of {size} bytes is longer than {max}")]
    TooLarge {
        /// Its bytes.
        size: usize,
        /// The limit.
        max: usize,
    },
    /// Too little shared memory for this request.
    #[error(transparent)]
    OutOfSharedMemory(#[from] OutOfSharedMemory),
    /// A long request could not be laid down as a file.
    #[error(transparent)]
    SpillFile(#[from] SpillError),
    /// Anything else that iceoryx2 says.
    #[error("{service}: {cause}")]
    Failed {
        /// Full service name.
        service: String,
        /// What iceoryx2 said.
        cause: IceoryxError,
    },
}

/// Takes requests of several clients.
pub struct Server {
    server: IoxServer<Service, [u8], (), [u8], ()>,
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
    /// The next request, if one is there; never waits. Requests that their clients gave up are left out.
    ///
    /// # Errors
    /// A request that is none, or what iceoryx2 says; the server stays usable, so log it and go on.
    pub fn poll(&self) -> Result<Option<Request>, PollError> {
        let received = self.server.receive().map_err(|error| PollError::Failed {
            service: self.service.clone(),
            cause: IceoryxError::of(error),
        })?;
        let Some(active) = received else {
            return Ok(None);
        };
        // The length is the client's word; it is looked at before the bytes are.
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

    /// Full name under which clients find this server.
    #[must_use]
    pub fn service(&self) -> &str {
        &self.service
    }
}

/// One request. It may be kept, sent to another thread and answered later; dropped, its client is told at once.
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
    /// What the client sent: anything at all, so decode it with care. A copy, which the client cannot change any more.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Takes out what the client sent, so that another thread can decode it.
    #[must_use]
    pub fn take_bytes(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.bytes)
    }

    /// True while the client waits for the answer (a client killed a moment ago still seems to).
    #[must_use]
    pub fn is_awaited(&self) -> bool {
        self.active.is_connected()
    }

    /// Answers. A client that is gone, or hangs, is no error.
    ///
    /// # Errors
    /// An answer too large, or what iceoryx2 says.
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

/// Asks one server.
pub struct Client {
    client: IoxClient<Service, [u8], (), [u8], ()>,
    factory: Factory,
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
    /// Sends `request` and waits for its answer, at most `timeout`.
    ///
    /// # Errors
    /// See [`CallError`]; after an error the client can be used again.
    pub fn call(&self, request: &[u8], timeout: Duration) -> Result<Vec<u8>, CallError> {
        let started = Instant::now();
        // The file of a long request stays until its answer is there, or none is waited for.
        let (pending, _file) = self.send(request)?;
        let mut pause = POLL_FIRST;
        let mut life_checked = started;
        loop {
            // In this order: an answer may arrive between the two looks.
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
            std::thread::sleep(pause);
            pause = (pause * 2).min(POLL_LAST);
        }
    }

    /// Full name of the server.
    #[must_use]
    pub fn service(&self) -> &str {
        &self.service
    }

    /// True if the process that made the server is known to be dead.
    #[must_use]
    pub fn server_is_dead(&self) -> bool {
        self.server.is_some_and(|life| life.liveness().is_dead())
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
        let loan = self
            .client
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
        Ok((pending, file))
    }

    fn answer(&self, pending: &Pending) -> Result<Option<Vec<u8>>, CallError> {
        let Some(response) = pending.receive().map_err(|error| self.failed(error))? else {
            return Ok(None);
        };
        // The length is the server's word; it is looked at before the bytes are.
        let size = usize::try_from(response.header().number_of_elements()).unwrap_or(usize::MAX);
        if size > RESPONSE_MAX {
            return Err(CallError::TooLarge {
                size,
                max: RESPONSE_MAX,
            });
        }
        Ok(Some(response.payload().to_vec()))
    }

    /// The request was dropped on the other side: by a server that lives on, or together with the server.
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
type Pending = PendingResponse<Service, [u8], (), [u8], ()>;

impl Session {
    /// Creates this session's server `name`.
    ///
    /// # Errors
    /// Too little shared memory, a name used twice or of another form, or what iceoryx2 says.
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
            // A server that does not look loses the oldest requests, and blocks nobody.
            .enable_safe_overflow_for_requests(true)
            .enable_safe_overflow_for_responses(true)
            .enable_fire_and_forget_requests(false)
            .create()
            .map_err(|error| failed(IceoryxError::of(error)))?;
        let server = factory
            .server_builder()
            .initial_max_slice_len(RESPONSE_MAX)
            .override_response_preallocation(|_| ANSWERS_MAX)
            .max_loaned_responses_per_request(1)
            .backpressure_strategy(Backpressure::DiscardData)
            // A client that died half-way must not keep the others from being heard.
            .set_request_degradation_handler(|_, _| DegradationAction::Ignore)
            .set_response_degradation_handler(|_, _| DegradationAction::Ignore)
            .create()
            .map_err(|error| failed(IceoryxError::of(error)))?;
        Ok(Server {
            server,
            service,
            folder: self.cell().iox_root(),
            membership: self.membership(),
        })
    }

    /// Opens the server of that full name, as its process announced it.
    ///
    /// # Errors
    /// No such server, too many clients, too little shared memory, or what iceoryx2 says.
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
        let client = factory
            .client_builder()
            .initial_max_slice_len(MESSAGE_MAX)
            .backpressure_strategy(Backpressure::DiscardData)
            .create()
            .map_err(|error| failed(IceoryxError::of(error)))?;
        Ok(Client {
            client,
            factory,
            service: service.to_owned(),
            folder: self.cell().iox_root(),
            server: owner_of(service),
            _membership: self.membership(),
        })
    }
}
