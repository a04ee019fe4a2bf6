//! Requests and answers of bytes between processes (iceoryx2 request/response), polled by both sides.
//! Run by threads that are not real-time: a call allocates, and maps memory when peers come and go.

use std::fmt;
use std::time::{Duration, Instant};

use iceoryx2::active_request::ActiveRequest;
use iceoryx2::pending_response::PendingResponse;
use iceoryx2::port::backpressure_strategy::BackpressureStrategy as Backpressure;
use iceoryx2::port::client::{Client as IoxClient, RequestSendError};
use iceoryx2::port::server::Server as IoxServer;
use iceoryx2::port::{DegradationAction, LoanError, SendError};
use iceoryx2::prelude::{AllocationStrategy, PayloadHeader, ServiceName, ipc_threadsafe};
use iceoryx2::service::builder::request_response::RequestResponseOpenError;
use iceoryx2::service::port_factory::PortFactory as _;
use iceoryx2::service::port_factory::request_response::PortFactory;

use crate::life::Life;
use crate::room::{self, NoRoom};
use crate::session::{Cause, Membership, Session, owner_of};

/// The longest request, in bytes (a plan with its tables).
pub const REQUEST_MAX: usize = 4 << 20;
/// The longest answer, in bytes.
pub const RESPONSE_MAX: usize = 1 << 20;
/// Clients of one server at a time, dead ones that were not cleaned up included.
pub const CLIENTS_MAX: usize = 16;

/// Calls of one client that a server may hold: one in progress, and one given up by a client that calls again.
const ACTIVE_MAX: usize = 2;
/// Memory is taken for messages of this size, and grows by powers of two for larger ones.
const USUAL_SIZE: usize = 1 << 10;
/// Answers that a server has memory for at a time; iceoryx2 would reckon with 256 of the longest, and an executor
/// locks all of its memory.
const ANSWERS_MAX: usize = CLIENTS_MAX;
/// Requests that iceoryx2 takes memory for in a client.
const REQUESTS_MAX: usize = ACTIVE_MAX + 3;
/// More than iceoryx2 puts before each message.
const HEADER_SIZE: usize = 256;
/// Shared memory of a client or server beside large messages; measured below 900 kB.
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
    NoRoom(#[from] NoRoom),
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
        cause: Cause,
    },
}

/// Why a server could not look for requests.
#[derive(Debug, thiserror::Error)]
#[error("server {service} cannot receive: {cause}")]
pub struct PollError {
    /// Full service name.
    pub service: String,
    /// What iceoryx2 said.
    pub cause: Cause,
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
    /// Too little shared memory for this answer.
    #[error(transparent)]
    NoRoom(#[from] NoRoom),
    /// Anything else that iceoryx2 says; that memory ran out means that clients do not take their answers.
    #[error("the answer cannot be sent: {cause}")]
    Failed {
        /// What iceoryx2 said.
        cause: Cause,
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
    NoRoom(#[from] NoRoom),
    /// Anything else that iceoryx2 says.
    #[error("{service}: {cause}")]
    Failed {
        /// Full service name.
        service: String,
        /// What iceoryx2 said.
        cause: Cause,
    },
}

/// Takes requests of several clients.
pub struct Server {
    server: IoxServer<Service, [u8], (), [u8], ()>,
    service: String,
    membership: Membership,
}

impl fmt::Debug for Server {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "Server({})", self.service)
    }
}

impl Server {
    /// The next request, if one is there; never waits. Requests that their clients gave up, and such that claim more
    /// than [`REQUEST_MAX`] bytes, are left out.
    ///
    /// # Errors
    /// What iceoryx2 says; the server stays usable, so log it and go on.
    pub fn poll(&self) -> Result<Option<Request>, PollError> {
        // Each turn takes one request out of a bounded queue; clients cannot fill it faster than this empties it.
        loop {
            let received = self.server.receive().map_err(|error| PollError {
                service: self.service.clone(),
                cause: Cause::of(error),
            })?;
            match received {
                None => return Ok(None),
                // The length is the client's word; it is looked at before the bytes are.
                Some(active) if active.header().number_of_elements() > REQUEST_MAX as u64 => {}
                Some(active) => {
                    let _membership = self.membership.clone();
                    return Ok(Some(Request {
                        active,
                        _membership,
                    }));
                }
            }
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
    _membership: Membership,
}

impl fmt::Debug for Request {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "Request({} bytes)", self.bytes().len())
    }
}

impl Request {
    /// What the client sent: anything at all, so decode it with care. It lies in memory that the client could still
    /// write to.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        self.active.payload()
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
        require_room(bytes.len(), ANSWERS_MAX)?;
        let failed = |cause| AnswerError::Failed { cause };
        let response = self
            .active
            .loan_slice_uninit(bytes.len())
            .map_err(|error| failed(Cause::of(error)))?;
        response
            .write_from_slice(bytes)
            .send()
            .map_err(|error| failed(Cause::of(error)))
    }
}

/// Asks one server.
pub struct Client {
    client: IoxClient<Service, [u8], (), [u8], ()>,
    factory: Factory,
    service: String,
    server: Option<Life>,
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
        let pending = self.send(request)?;
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
                if !self.server_is_alive() {
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

    /// True while the process lives that made the server.
    #[must_use]
    pub fn server_is_alive(&self) -> bool {
        self.server.is_none_or(Life::is_alive)
    }

    fn send(&self, request: &[u8]) -> Result<Pending, CallError> {
        let size = request.len();
        if size > REQUEST_MAX {
            return Err(CallError::TooLarge {
                size,
                max: REQUEST_MAX,
            });
        }
        require_room(size, REQUESTS_MAX)?;
        if !self.server_is_alive() {
            return Err(CallError::ServerGone {
                service: self.service.clone(),
            });
        }
        let loan = self
            .client
            .loan_slice_uninit(size)
            .map_err(|error| match error {
                LoanError::ExceedsMaxLoanSize => CallError::TooLarge {
                    size,
                    max: REQUEST_MAX,
                },
                other => self.failed(other),
            })?;
        let pending = loan
            .write_from_slice(request)
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
        Ok(pending)
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
        if self.server_is_alive() && self.servers() > 0 {
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
            cause: Cause::of(error),
        }
    }
}

/// Memory for messages longer than the usual ones comes in powers of two, for all that may be under way at once.
fn require_room(size: usize, count: usize) -> Result<(), NoRoom> {
    if size <= USUAL_SIZE {
        return Ok(());
    }
    room::require(((size + HEADER_SIZE).next_power_of_two() * count) as u64)
}

type Factory = PortFactory<Service, [u8], (), [u8], ()>;
type Pending = PendingResponse<Service, [u8], (), [u8], ()>;

impl Session {
    /// Creates this session's server `name`.
    ///
    /// # Errors
    /// Too little shared memory, a name used twice or of another form, or what iceoryx2 says.
    pub fn serve(&self, name: &str) -> Result<Server, RequestError> {
        room::require(PORT_ROOM)?;
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
            .map_err(|error| failed(Cause::of(error)))?;
        let server = factory
            .server_builder()
            .initial_max_slice_len(USUAL_SIZE)
            .allocation_strategy(AllocationStrategy::PowerOfTwo)
            .override_response_preallocation(|_| ANSWERS_MAX)
            .max_loaned_responses_per_request(1)
            .backpressure_strategy(Backpressure::DiscardData)
            // A client that died half-way must not keep the others from being heard.
            .set_request_degradation_handler(|_, _| DegradationAction::Ignore)
            .set_response_degradation_handler(|_, _| DegradationAction::Ignore)
            .create()
            .map_err(|error| failed(Cause::of(error)))?;
        Ok(Server {
            server,
            service,
            membership: self.membership(),
        })
    }

    /// Opens the server of that full name, as its process announced it.
    ///
    /// # Errors
    /// No such server, too many clients, too little shared memory, or what iceoryx2 says.
    pub fn client(&self, service: &str) -> Result<Client, RequestError> {
        room::require(PORT_ROOM)?;
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
                other => failed(Cause::of(other)),
            })?;
        let client = factory
            .client_builder()
            .initial_max_slice_len(USUAL_SIZE)
            .allocation_strategy(AllocationStrategy::PowerOfTwo)
            .backpressure_strategy(Backpressure::DiscardData)
            .create()
            .map_err(|error| failed(Cause::of(error)))?;
        Ok(Client {
            client,
            factory,
            service: service.to_owned(),
            server: owner_of(service),
            _membership: self.membership(),
        })
    }
}
