//! One request and its answer on a connection that may stay open. The HTTP library sees exactly the bytes of one request,
//! and then the end of the connection; so each request passes the same checks and quotas, whichever connection carries
//! it. Run by the serving thread; CANCEL and ABORT by `front`.

use std::io;
use std::pin::Pin;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll, ready};
use std::time::{Duration, Instant};

use axum::Router;
use axum::body::{Body, Bytes};
use axum::extract::Request;
use axum::http::{HeaderValue, header};
use axum::response::Response;
use hyper::body::{Frame, Incoming, SizeHint};
use hyper::service::{Service as _, service_fn};
use hyper_util::rt::TokioIo;
use hyper_util::service::TowerToHyperService;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, ReadBuf};

use crate::server::peer::ClientPeer;
use crate::server::request_head::{HEAD_MAX, HEADERS_MAX, RequestHead};
use crate::server::stop_steps::ArrivalTime;

/// A connection after an answer.
pub(super) enum Answered<I> {
    /// It may carry another request; the bytes are those of it that have arrived.
    Open(I, Vec<u8>),
    /// It is to be closed.
    Closing(I),
    /// The client is gone.
    Gone,
}

/// Answers one request.
pub(super) async fn answer<I>(
    (peer, arrived): (ClientPeer, ArrivalTime),
    head: RequestHead,
    io: I,
    router: Router,
) -> Answered<I>
where
    I: AsyncRead + AsyncWrite + Unpin + Send + 'static,
{
    let stays_open = head.stays_open;
    let progress = Arc::new(Progress::default());
    let io = RequestStream::new(head, io, Arc::clone(&progress));
    let mut server = hyper::server::conn::http1::Builder::new();
    server
        .keep_alive(stays_open)
        // Not needed, and the wall clock may show anything.
        .auto_date_header(false)
        .max_headers(HEADERS_MAX)
        .header_read_timeout(None);
    let (router, observed) = (TowerToHyperService::new(router), Arc::clone(&progress));
    let service = service_fn(move |mut request: Request<Incoming>| {
        request.extensions_mut().insert(arrived);
        request.extensions_mut().insert(peer);
        let (answer, observed) = (router.call(request), Arc::clone(&observed));
        async move { answer.await.map(|response| observed.observe(response)) }
    });
    let connection = server.serve_connection(TokioIo::new(io), service);
    let stalled = progress.stalled();
    let served = tokio::select! {
        served = connection.without_shutdown() => served,
        () = stalled => return Answered::Gone,
    };
    // On an error the client is gone, and nobody can be told.
    let Ok(parts) = served else {
        return Answered::Gone;
    };
    let stream = parts.io.into_inner();
    let is_whole = stream.is_answered && stream.is_received() && parts.read_buf.is_empty();
    match stays_open && is_whole && !progress.closes.load(Ordering::Relaxed) {
        true => Answered::Open(stream.io, stream.next),
        false => Answered::Closing(stream.io),
    }
}

/// State shared by the service and the stream. Relaxed everywhere, because one thread serves an exchange.
#[derive(Debug, Default)]
struct Progress {
    /// All bytes of the request were passed on.
    is_received: AtomicBool,
    /// The answer's body has ended.
    is_over: AtomicBool,
    /// The client was told that the connection closes.
    closes: AtomicBool,
    /// Since when the client has taken nothing of an answer that it could take.
    blocked_since: Mutex<Option<Instant>>,
}

impl Progress {
    /// Observes the end of the answer, and tells the client if the connection cannot be used again because the request
    /// was answered before it had arrived.
    fn observe(self: &Arc<Progress>, mut response: Response) -> Response {
        if !self.is_received.load(Ordering::Relaxed) {
            let close = HeaderValue::from_static("close");
            response.headers_mut().insert(header::CONNECTION, close);
        }
        let closes = response.headers().contains_key(header::CONNECTION);
        self.closes.store(closes, Ordering::Relaxed);
        response.map(|body| {
            Body::new(ObservedBody {
                body,
                progress: Arc::clone(self),
            })
        })
    }

    fn set_blocked(&self, is_blocked: bool) {
        let mut since = self.since();
        *since = is_blocked.then(|| since.unwrap_or_else(Instant::now));
    }

    fn since(&self) -> std::sync::MutexGuard<'_, Option<Instant>> {
        self.blocked_since
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }

    /// Ends when the client has taken nothing for [`STALL_MAX`].
    async fn stalled(&self) {
        loop {
            tokio::time::sleep(STALL_CHECK).await;
            if self
                .since()
                .is_some_and(|since| since.elapsed() > STALL_MAX)
            {
                return;
            }
        }
    }
}

/// Time after which a client that takes nothing of its answer is disconnected.
pub const STALL_MAX: Duration = Duration::from_secs(20);
/// Interval at which this is checked.
const STALL_CHECK: Duration = Duration::from_secs(1);

/// A body whose end is observed.
struct ObservedBody {
    body: Body,
    progress: Arc<Progress>,
}

impl Drop for ObservedBody {
    fn drop(&mut self) {
        self.progress.is_over.store(true, Ordering::Relaxed);
    }
}

impl hyper::body::Body for ObservedBody {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Self::Error>>> {
        Pin::new(&mut self.body).poll_frame(context)
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

/// A connection that carries one request: its bytes and, once the answer is written, the end.
struct RequestStream<I> {
    /// Bytes of the request that have been read before.
    begun: Vec<u8>,
    consumed: usize,
    /// Length of the rest of the body, bytes.
    left: u64,
    /// Bytes of the next request.
    next: Vec<u8>,
    /// The whole answer was written to the connection.
    is_answered: bool,
    io: I,
    progress: Arc<Progress>,
}

impl<I> RequestStream<I> {
    fn new(head: RequestHead, io: I, progress: Arc<Progress>) -> RequestStream<I> {
        let mut begun = head.bytes;
        let (next, left) = match head.stays_open {
            true => {
                let size = head.size.saturating_add(head.body_size);
                let here = begun.len().min(size);
                (begun.split_off(here), (size - here) as u64)
            }
            // The library finds the end of the body.
            false => (Vec::new(), u64::MAX),
        };
        RequestStream {
            begun,
            consumed: 0,
            left,
            next,
            is_answered: false,
            io,
            progress,
        }
    }

    fn is_received(&self) -> bool {
        self.left == 0 && self.consumed == self.begun.len()
    }
}

impl<I: AsyncRead + Unpin> RequestStream<I> {
    /// Takes bytes of the next request, so that a client that goes is noticed while it waits. Ready at its end.
    fn poll_end(&mut self, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        while !self.is_answered && self.next.len() < HEAD_MAX {
            let mut bytes = [0; 1024];
            let mut into = ReadBuf::new(&mut bytes);
            ready!(Pin::new(&mut self.io).poll_read(context, &mut into))?;
            if into.filled().is_empty() {
                return Poll::Ready(Ok(()));
            }
            self.next.extend_from_slice(into.filled());
        }
        match self.is_answered {
            true => Poll::Ready(Ok(())),
            // Writing the answer goes on by itself.
            false => Poll::Pending,
        }
    }
}

impl<I: AsyncRead + Unpin> AsyncRead for RequestStream<I> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        into: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let rest = self.begun.get(self.consumed..).unwrap_or_default();
        let result = if !rest.is_empty() {
            let count = rest.len().min(into.remaining());
            into.put_slice(&rest[..count]);
            self.consumed += count;
            Poll::Ready(Ok(()))
        } else if self.left > 0 {
            let (before, left) = (into.filled().len(), self.left);
            let mut body = (&mut self.io).take(left);
            let read = Pin::new(&mut body).poll_read(context, into);
            self.left -= (into.filled().len() - before) as u64;
            read
        } else {
            return self.poll_end(context);
        };
        let is_received = self.is_received();
        self.progress
            .is_received
            .store(is_received, Ordering::Relaxed);
        result
    }
}

impl<I: AsyncWrite + Unpin> AsyncWrite for RequestStream<I> {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.io).poll_write(context, bytes);
        self.progress.set_blocked(written.is_pending());
        written
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        ready!(Pin::new(&mut self.io).poll_flush(context))?;
        if !self.is_answered && self.progress.is_over.load(Ordering::Relaxed) {
            self.is_answered = true;
            // The library may wait for bytes of the client; it is to read the end instead.
            context.waker().wake_by_ref();
        }
        Poll::Ready(Ok(()))
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.io).poll_shutdown(context)
    }
}
