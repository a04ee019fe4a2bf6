//! Serves the connections of one listener: the Unix socket, or TCP if it is configured. A connection carries one
//! request, bounded in size and time, and each peer has a quota of concurrent requests and of requests per second. A
//! client that exceeds a limit gets an error, is disconnected and logged, while others are served. CANCEL and ABORT
//! have quotas of their own. Run by the one thread that serves connections.

mod quotas;

use std::cell::Cell;
use std::convert::Infallible;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use axum::Router;
use axum::http::StatusCode;
use hyper_util::rt::TokioIo;
use hyper_util::service::TowerToHyperService;
use rcc_api::codes;
use rcc_api::error::ApiError;
use rcc_api::token::Token;
use rcc_ipc::events::EventRecorder;
use rcc_protocol::events::{EventKind, event_text};
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::net::{TcpListener, UnixListener};
use tokio::time::timeout;

use quotas::{ClientPeer, HeadPermit, Quotas, RequestClass};
pub use quotas::{ConnectionLimits, HEADS_MAX, STOPS, TCP, UNAUTHENTICATED, UNIX};

use super::request_head::{self, HEADERS_MAX, PrefixedStream, RequestHead};

/// Time allowed for the head of a request, from the connection on.
pub const HEAD_TIME_MAX: Duration = Duration::from_secs(2);
/// Time allowed for a whole connection: request, work, and delivery of the answer.
pub const CONNECTION_TIME_MAX: Duration = Duration::from_secs(20);
/// How long, and for how many bytes, the input of a client that was answered early is still read; closing at once would
/// lose the answer.
const LINGER_LIMITS: (Duration, u64) = (Duration::from_millis(500), 1 << 20);
/// Maximum number of connections being drained at a time.
const DRAINING_MAX: usize = 64;
/// Pause after a failed `accept`, for example when no file descriptor is free.
const ACCEPT_RETRY_AFTER: Duration = Duration::from_millis(50);

thread_local! {
    /// hyper 1.12 caches a date per serving thread. It creates the cache at the first request, even with
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

/// Serves one listener forever. With a `token`, requests without it are refused.
pub async fn serve(
    listener: Listener,
    limits: ConnectionLimits,
    token: Option<Token>,
    recorder: Option<EventRecorder>,
    router: Router,
) -> Infallible {
    let context = Arc::new(ListenerContext {
        quotas: Quotas::new(limits),
        token,
        recorder,
        draining: AtomicUsize::new(0),
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
        let talk = serve_request(&context, peer, permit, io, router);
        if timeout(CONNECTION_TIME_MAX, talk).await.is_err() {
            let what = format!("the connection took longer than {CONNECTION_TIME_MAX:?}");
            context.log_refusal(peer, &too_slow(what));
        }
    });
}

/// Reads one request and answers it.
async fn serve_request<I>(
    context: &ListenerContext,
    peer: ClientPeer,
    permit: HeadPermit,
    mut io: I,
    router: Router,
) where
    I: AsyncRead + AsyncWrite + Unpin + Send + 'static,
{
    let head = match read_head(permit, &mut io).await {
        Ok(Some(head)) => head,
        Ok(None) => return,
        Err(error) => return refuse(context, peer, io, &error).await,
    };
    // Check the token before the quota: a peer without the token takes nothing from those at its address who have it.
    if !context.is_authorized(head.bearer.as_deref()) {
        return match context
            .quotas
            .admit(peer, RequestClass::Unauthenticated, Instant::now())
        {
            Ok(_permit) => refuse(context, peer, io, &no_token()).await,
            Err(error) => {
                context.log_refusal(peer, &error);
                write_without_waiting(&mut io, &error);
            }
        };
    }
    let class = match head.is_stop {
        true => RequestClass::Stop,
        false => RequestClass::Usual,
    };
    let permit = match context.quotas.admit(peer, class, Instant::now()) {
        Ok(permit) => permit,
        Err(error) => return refuse(context, peer, io, &error).await,
    };
    if rcc_os::wall::is_before_epoch() && !DATE_CACHED.get() {
        return refuse(context, peer, io, &no_clock()).await;
    }
    DATE_CACHED.set(true);
    let mut server = hyper::server::conn::http1::Builder::new();
    server
        .keep_alive(false)
        // Not needed, and the wall clock may show anything.
        .auto_date_header(false)
        .max_headers(HEADERS_MAX)
        .header_read_timeout(None);
    let io = TokioIo::new(PrefixedStream::new(head.bytes, io));
    let connection = server.serve_connection(io, TowerToHyperService::new(router));
    let served = connection.without_shutdown().await;
    // The client has its answer; draining its input must not occupy a slot.
    drop(permit);
    // On an error the client is gone, and nobody can be told.
    if let Ok(parts) = served {
        drain_input(context, parts.io.into_inner().io).await;
    }
}

/// Reads the head, unless it takes too long or its slot is taken by another connection. Returns `None` if the client
/// sent nothing.
async fn read_head<I: AsyncRead + Unpin>(
    mut permit: HeadPermit,
    io: &mut I,
) -> Result<Option<RequestHead>, ApiError> {
    tokio::select! {
        // Data that is already there is read, however many connections wait.
        biased;
        head = timeout(HEAD_TIME_MAX, request_head::read(io)) => head.unwrap_or_else(|_| {
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
    // Relaxed, because only one thread counts.
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
