//! Serves the connections of one listener: the Unix socket, or TCP if it is configured. A connection carries requests
//! one after the other, each bounded in size and time and counted like one on a connection of its own: each peer has a
//! quota of concurrent requests and of requests per second. A client that exceeds a limit gets an error, is
//! disconnected and logged, while others are served. CANCEL and ABORT have quotas of their own.
//!
//! The thread `front` accepts connections, reads the heads of requests, and carries out CANCEL and ABORT; all other
//! requests, with their bodies and answers, are the serving thread's. So no flood of bodies is before a CANCEL.

mod exchange;
mod quotas;

use std::cell::Cell;
use std::convert::Infallible;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use axum::Router;
use axum::http::StatusCode;
use rcc_api::codes;
use rcc_api::error::ApiError;
use rcc_api::token::Token;
use rcc_ipc::events::EventRecorder;
use rcc_protocol::events::{EventKind, event_text};
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::net::{TcpListener, UnixListener};
use tokio::runtime::Handle;
use tokio::time::timeout;

use exchange::Answered;
pub use exchange::STALL_MAX;
pub use quotas::{ConnectionLimits, HEADS_MAX, STOPS, STREAMS, TCP, UNAUTHENTICATED, UNIX};
use quotas::{HeadPermit, Quotas, RequestPermit};

use super::peer::ClientPeer;
use super::request_class::RequestClass;
use super::request_head::{self, RequestHead};
use super::stop_steps::ArrivalTime;

/// Time allowed for the head of a request, from the connection or from its first byte on.
pub const HEAD_TIME_MAX: Duration = Duration::from_secs(2);
/// Time allowed for a request after its head: body, work, and delivery of the answer; streams are not limited.
pub const EXCHANGE_TIME_MAX: Duration = Duration::from_secs(20);
/// Time after which a connection that is kept open without a request is closed.
pub const IDLE_TIME_MAX: Duration = Duration::from_secs(60);
/// How long, and for how many bytes, the input of a client that was answered early is still read; closing at once would
/// lose the answer.
const LINGER_LIMITS: (Duration, u64) = (Duration::from_millis(500), 1 << 20);
/// Maximum number of connections being drained at a time.
const DRAINING_MAX: usize = 64;
/// Pause after a failed `accept`, for example when no file descriptor is free.
const ACCEPT_RETRY_AFTER: Duration = Duration::from_millis(50);

thread_local! {
    /// hyper 1.12 caches a date per thread. It creates the cache at the first request, even with
    /// `auto_date_header(false)`, and panics if the wall clock shows a time before 1970 at that moment; afterwards the
    /// clock may show anything.
    static DATE_CACHED: Cell<bool> = const { Cell::new(false) };
}

/// A listening socket.
#[derive(Debug)]
pub enum Listener {
    /// The cell's Unix socket.
    Unix(UnixListener),
    /// A TCP address.
    Tcp(TcpListener),
}

/// State shared by the connections of one listener.
struct ListenerContext {
    quotas: Arc<Quotas>,
    token: Option<Token>,
    recorder: Option<EventRecorder>,
    draining: AtomicUsize,
    /// The serving thread.
    serving: Handle,
}

impl ListenerContext {
    fn log_refusal(&self, peer: ClientPeer, error: &ApiError) {
        let said = self.quotas.log_refusal(Instant::now());
        if let Some(others) = said {
            let (code, message) = (error.code.code, &error.message);
            tracing::warn!(%peer, code, others, "client disconnected: {message}");
            if let Some(recorder) = &self.recorder {
                recorder.tell(EventKind::ClientCutOff {
                    client: peer.to_string(),
                    why: event_text(&format!("{code} {message}")),
                });
            }
        }
    }

    fn is_authorized(&self, bearer: Option<&[u8]>) -> bool {
        let token = self.token.as_ref();
        token.is_none_or(|token| token.is(bearer.unwrap_or_default()))
    }
}

/// Serves one listener forever, all requests but CANCEL and ABORT on the thread of `serving`. With a `token`, requests
/// without it are refused. Run by the thread `front`.
pub async fn serve(
    listener: Listener,
    limits: ConnectionLimits,
    token: Option<Token>,
    recorder: Option<EventRecorder>,
    (serving, router): (Handle, Router),
) -> Infallible {
    let context = Arc::new(ListenerContext {
        quotas: Quotas::new(limits),
        token,
        recorder,
        draining: AtomicUsize::new(0),
        serving,
    });
    loop {
        let accepted = match &listener {
            Listener::Unix(listener) => listener.accept().await.map(|(stream, _)| {
                let pid = stream.peer_cred().ok().and_then(|peer| peer.pid());
                spawn_connection(
                    &context,
                    ClientPeer::Process(pid.unwrap_or(0)),
                    stream,
                    &router,
                );
            }),
            Listener::Tcp(listener) => listener.accept().await.map(|(stream, address)| {
                // Small answers of a kept-open connection do not wait for the client's acknowledgement. On an error the
                // connection is broken, which is found when it is read.
                let _ = stream.set_nodelay(true);
                spawn_connection(&context, ClientPeer::Address(address.ip()), stream, &router);
            }),
        };
        if let Err(error) = accepted {
            tracing::warn!(%error, "cannot accept a connection");
            tokio::time::sleep(ACCEPT_RETRY_AFTER).await;
        }
    }
}

/// Serves a connection in a task of its own.
fn spawn_connection<I>(context: &Arc<ListenerContext>, peer: ClientPeer, io: I, router: &Router)
where
    I: AsyncRead + AsyncWrite + Unpin + Send + 'static,
{
    let (context, router) = (Arc::clone(context), router.clone());
    let permit = context.quotas.await_head(peer);
    tokio::spawn(async move {
        let (mut io, mut begun, mut permit) = (io, Vec::new(), permit);
        while let Some(connection) =
            serve_request(&context, peer, permit, (io, begun), &router).await
        {
            (io, begun) = connection;
            let next = await_next(&context, peer, &mut io, &mut begun).await;
            permit = match next {
                Some(permit) => permit,
                None => return,
            };
        }
    });
}

/// Waits until a kept-open connection has a byte of the next request. Returns `None` if it is to be closed: its client
/// is gone or has been idle for too long, or another connection takes its slot.
async fn await_next<I: AsyncRead + Unpin>(
    context: &ListenerContext,
    peer: ClientPeer,
    io: &mut I,
    begun: &mut Vec<u8>,
) -> Option<HeadPermit> {
    if begun.is_empty() {
        let mut permit = context.quotas.await_next(peer);
        tokio::select! {
            biased;
            read = timeout(IDLE_TIME_MAX, io.read_buf(begun)) => match read {
                Ok(Ok(count)) if count > 0 => {}
                _ => return None,
            },
            _ = &mut permit.displaced => return None,
        }
    }
    Some(context.quotas.await_head(peer))
}

/// Reads one request, whose first bytes may have been read before, and answers it. Returns the connection with the
/// bytes of the next request that have arrived, unless it is closed.
async fn serve_request<I>(
    context: &Arc<ListenerContext>,
    peer: ClientPeer,
    permit: HeadPermit,
    (mut io, begun): (I, Vec<u8>),
    router: &Router,
) -> Option<(I, Vec<u8>)>
where
    I: AsyncRead + AsyncWrite + Unpin + Send + 'static,
{
    let arrived = ArrivalTime(Instant::now());
    let admitted = match read_head(permit, &mut io, begun).await {
        Ok(Some(head)) => admit(context, peer, head),
        Ok(None) => return None,
        Err(error) => Err(Refusal::Answered(error)),
    };
    let (head, permit) = match admitted {
        Ok(admitted) => admitted,
        Err(Refusal::Answered(error)) => {
            refuse(context, peer, io, &error).await;
            return None;
        }
        Err(Refusal::CutOff(error)) => {
            context.log_refusal(peer, &error);
            write_without_waiting(&mut io, &error);
            return None;
        }
    };
    let is_stop = head.class == RequestClass::Stop;
    let exchange = exchange(
        Arc::clone(context),
        peer,
        (arrived, head, permit),
        io,
        router.clone(),
    );
    match is_stop {
        true => exchange.await,
        // A panic, which the panic hook reports, closes the connection.
        false => context.serving.spawn(exchange).await.unwrap_or(None),
    }
}

/// Answers one admitted request. Returns the connection with the bytes of the next request that have arrived, unless it
/// is closed.
async fn exchange<I>(
    context: Arc<ListenerContext>,
    peer: ClientPeer,
    (arrived, head, permit): (ArrivalTime, RequestHead, RequestPermit),
    io: I,
    router: Router,
) -> Option<(I, Vec<u8>)>
where
    I: AsyncRead + AsyncWrite + Unpin + Send + 'static,
{
    if rcc_os::wall::is_before_epoch() && !DATE_CACHED.get() {
        refuse(&context, peer, io, &no_clock()).await;
        return None;
    }
    DATE_CACHED.set(true);
    let is_limited = head.class != RequestClass::Stream;
    let answer = exchange::answer((peer, arrived), head, io, router);
    let answered = match is_limited {
        true => timeout(EXCHANGE_TIME_MAX, answer).await,
        false => Ok(answer.await),
    };
    // The client has its answer; draining its input must not occupy a slot.
    drop(permit);
    match answered {
        Ok(Answered::Open(io, next)) => Some((io, next)),
        Ok(Answered::Closing(io)) => {
            drain_input(&context, io).await;
            None
        }
        Ok(Answered::Gone) => None,
        Err(_) => {
            let what = format!("the request took longer than {EXCHANGE_TIME_MAX:?}");
            context.log_refusal(peer, &too_slow(what));
            None
        }
    }
}

/// The reason why a request is not served.
enum Refusal {
    /// The error is sent to the client, and its input is read for a while.
    Answered(ApiError),
    /// As much of the error as fits into the socket's buffer is sent, without waiting.
    CutOff(ApiError),
}

/// Takes a slot for a request, if its token and the quotas allow it.
fn admit(
    context: &ListenerContext,
    peer: ClientPeer,
    head: RequestHead,
) -> Result<(RequestHead, RequestPermit), Refusal> {
    let (quotas, now) = (&context.quotas, Instant::now());
    // Check the token before the quota: a peer without the token takes nothing from those at its address who have it.
    if !context.is_authorized(head.bearer.as_deref()) {
        let admitted = quotas.admit(peer, RequestClass::Unauthenticated, now);
        return Err(match admitted {
            Ok(_permit) => Refusal::Answered(no_token()),
            Err(error) => Refusal::CutOff(error),
        });
    }
    let permit = quotas.admit(peer, head.class, now);
    Ok((head, permit.map_err(Refusal::Answered)?))
}

/// Reads the head, unless it takes too long or its slot is taken by another connection. Returns `None` if the client
/// sent nothing.
async fn read_head<I: AsyncRead + Unpin>(
    mut permit: HeadPermit,
    io: &mut I,
    begun: Vec<u8>,
) -> Result<Option<RequestHead>, ApiError> {
    tokio::select! {
        // Data that is already there is read, however many connections wait.
        biased;
        head = timeout(HEAD_TIME_MAX, request_head::read(io, begun)) => head.unwrap_or_else(|_| {
            Err(too_slow(format!("the head of the request took longer than {HEAD_TIME_MAX:?}")))
        }),
        _ = &mut permit.displaced => Err(ApiError::new(
            codes::TOO_MANY,
            format!("{HEADS_MAX} connections have not sent a complete head, and this is the oldest one of its client"),
            "send the head of a request at once",
        )),
    }
}

fn no_clock() -> ApiError {
    ApiError::new(
        codes::PROCESS_FAILED,
        "the clock of this machine shows a time before 1970, and requests cannot be answered until it is set",
        "set the clock (`timedatectl set-time`) and try again; running nets continue",
    )
}

fn too_slow(what: String) -> ApiError {
    ApiError::new(codes::TOO_SLOW, what, "send the whole request at once")
}

fn no_token() -> ApiError {
    ApiError::new(
        codes::NO_TOKEN,
        "the request has no valid token for this cell",
        "use `rcc-cli --token-file FILE` or RCC_TOKEN; in HTTP: `authorization: Bearer TOKEN`",
    )
}

async fn refuse<I>(context: &ListenerContext, peer: ClientPeer, mut io: I, error: &ApiError)
where
    I: AsyncRead + AsyncWrite + Unpin,
{
    context.log_refusal(peer, error);
    if timeout(LINGER_LIMITS.0, io.write_all(&http_response(error)))
        .await
        .is_ok_and(|sent| sent.is_ok())
    {
        drain_input(context, io).await;
    }
}

/// Writes as much as fits into the socket's buffer, without waiting.
fn write_without_waiting<I: AsyncWrite + Unpin>(io: &mut I, error: &ApiError) {
    let mut context = std::task::Context::from_waker(std::task::Waker::noop());
    let _ = std::pin::Pin::new(io).poll_write(&mut context, &http_response(error));
}

/// Formats an HTTP response with the error's status and JSON body, without the HTTP library.
fn http_response(error: &ApiError) -> Vec<u8> {
    let status = StatusCode::from_u16(error.code.status).unwrap_or(StatusCode::BAD_REQUEST);
    // Serializing strings and a list cannot fail.
    let body = serde_json::to_string(&error.body()).unwrap_or_default();
    let challenge = if status == StatusCode::UNAUTHORIZED {
        "www-authenticate: Bearer\r\n"
    } else {
        ""
    };
    let length = body.len();
    format!(
        "HTTP/1.1 {status}\r\ncontent-type: application/json\r\n{challenge}connection: close\r\n\
         content-length: {length}\r\n\r\n{body}"
    )
    .into_bytes()
}

/// Shuts down the sending side and reads the remaining input for a short time, because closing at once would make the
/// kernel discard what the client has not read. Beyond [`DRAINING_MAX`] connections close at once.
async fn drain_input<I: AsyncRead + AsyncWrite + Unpin>(context: &ListenerContext, mut io: I) {
    let (time, bytes) = LINGER_LIMITS;
    // Relaxed: only a count.
    if context.draining.fetch_add(1, Ordering::Relaxed) < DRAINING_MAX {
        // Whether the client is gone or still sending does not matter.
        let _ = timeout(time, async {
            io.shutdown().await?;
            tokio::io::copy(&mut (&mut io).take(bytes), &mut tokio::io::sink()).await
        })
        .await;
    }
    context.draining.fetch_sub(1, Ordering::Relaxed);
}
