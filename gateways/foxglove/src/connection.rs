//! One client: handshake, reading its requests, and writing what waits for it. A client that takes nothing is disconnected.
//! Run by the serving thread, a task for each client.

use std::sync::Arc;
use std::time::{Duration, Instant};

use futures_util::stream::{SplitSink, SplitStream};
use futures_util::{SinkExt, StreamExt};
use tokio::net::TcpStream;
use tokio::sync::mpsc::{self, Receiver, Sender};
use tokio::time::{interval, timeout};
use tokio_tungstenite::tungstenite::handshake::server::{ErrorResponse, Request as Head, Response};
use tokio_tungstenite::tungstenite::http::{HeaderValue, StatusCode, header};
use tokio_tungstenite::tungstenite::protocol::WebSocketConfig;
use tokio_tungstenite::tungstenite::protocol::frame::CloseFrame;
use tokio_tungstenite::tungstenite::protocol::frame::coding::CloseCode;
use tokio_tungstenite::tungstenite::{Bytes, Error, Message};
use tokio_tungstenite::{WebSocketStream, accept_hdr_async_with_config};

use crate::access::{Access, Refusal};
use crate::outbox::Outbox;
use crate::protocol::{self, Request, ServiceCall, StatusLevel};
use crate::server::{Server, tell};

/// Largest message of a client, bytes: the text of a net is at most 4 MiB.
const MESSAGE_MAX: usize = 5 << 20;
/// Time of a handshake.
const HANDSHAKE_MAX: Duration = Duration::from_secs(5);
/// Time for which a client may take nothing although something waits for it.
const STALL_MAX: Duration = Duration::from_secs(10);
/// Interval of pings, and the time after which a client that answers none is gone.
const PING_EVERY: Duration = Duration::from_secs(10);
const SILENCE_MAX: Duration = Duration::from_secs(30);
/// Interval at which a client is told what it loses.
const LOSSES_EVERY: Duration = Duration::from_secs(1);
/// Requests about parameters that wait for the loader.
const REQUESTS_MAX: usize = 64;

/// The reason why a connection ended otherwise than by the client or by us.
#[derive(Debug, thiserror::Error)]
pub enum ConnectionError {
    /// Not a client of this protocol, or one that may not connect.
    #[error("a connection was refused: {0}")]
    Refused(Refusal),
    /// The handshake did not come.
    #[error("a connection without a handshake was closed")]
    NoHandshake,
    /// The client breaks the protocol, or is lost.
    #[error("a client was lost: {0}")]
    Lost(#[from] Error),
    /// The client takes nothing.
    #[error(
        "a client took nothing for {STALL_MAX:?} and was disconnected; {0} messages had been dropped"
    )]
    Stalled(u64),
    /// The client does not answer pings.
    #[error("a client did not answer for {SILENCE_MAX:?} and was disconnected")]
    Silent,
}

/// Serves one connection to its end.
///
/// # Errors
/// Returns the reason why it ended, unless the client or this program closed it.
pub async fn run(server: &Arc<Server>, stream: TcpStream) -> Result<(), ConnectionError> {
    // An error only costs time.
    let _ = stream.set_nodelay(true);
    let socket = handshake(&server.access, stream).await?;
    let (mut sink, source) = socket.split();
    let Some((viewer, outbox)) = server.viewers.connect(&server.greeting()) else {
        // The client may be gone already.
        let _ = sink
            .send(close(CloseCode::Again, "too many viewers: close one"))
            .await;
        return Ok(());
    };
    let (requests, queue) = mpsc::channel(REQUESTS_MAX);
    let client = Client {
        server: Arc::clone(server),
        viewer,
        outbox: Arc::clone(&outbox),
    };
    let ended = tokio::select! {
        ended = write(sink, &outbox) => ended,
        ended = client.read(source, requests) => ended,
        () = client.answer(queue) => Ok(()),
    };
    server.viewers.disconnect(viewer);
    ended
}

async fn handshake(
    access: &Access,
    stream: TcpStream,
) -> Result<WebSocketStream<TcpStream>, ConnectionError> {
    let mut refusal = None;
    // The type of the callback's answer is the library's.
    #[allow(clippy::result_large_err)]
    let decide = |head: &Head, mut response: Response| -> Result<Response, ErrorResponse> {
        match access.check(head.uri(), head.headers()) {
            Ok(protocol) => {
                let name = HeaderValue::from_static(protocol);
                response
                    .headers_mut()
                    .insert(header::SEC_WEBSOCKET_PROTOCOL, name);
                Ok(response)
            }
            Err(reason) => {
                let mut answer = ErrorResponse::new(Some(format!("{reason}\n")));
                let status = StatusCode::from_u16(reason.status());
                *answer.status_mut() = status.unwrap_or(StatusCode::FORBIDDEN);
                refusal = Some(reason);
                Err(answer)
            }
        }
    };
    let config = WebSocketConfig::default()
        .max_message_size(Some(MESSAGE_MAX))
        .max_frame_size(Some(MESSAGE_MAX))
        .read_buffer_size(16 << 10);
    let accepted = accept_hdr_async_with_config(stream, decide, Some(config));
    match timeout(HANDSHAKE_MAX, accepted).await {
        Ok(Ok(socket)) => Ok(socket),
        Ok(Err(error)) => Err(refusal.map_or(error.into(), ConnectionError::Refused)),
        Err(_) => Err(ConnectionError::NoHandshake),
    }
}

fn close(code: CloseCode, reason: &'static str) -> Message {
    Message::Close(Some(CloseFrame {
        code,
        reason: reason.into(),
    }))
}

/// Writes what waits, until the connection has to end.
async fn write(
    mut sink: SplitSink<WebSocketStream<TcpStream>, Message>,
    outbox: &Outbox,
) -> Result<(), ConnectionError> {
    let mut pings = interval(PING_EVERY);
    let (mut told, mut dropped) = (Instant::now(), 0);
    loop {
        let next = tokio::select! {
            next = outbox.next() => next,
            _ = pings.tick() => Some(Message::Ping(Bytes::new())),
        };
        let is_end = next.is_none();
        let message = next.unwrap_or_else(|| close(CloseCode::Away, "rcc-foxglove ends"));
        match timeout(STALL_MAX, sink.send(message)).await {
            Ok(sent) => sent?,
            Err(_) => return Err(ConnectionError::Stalled(dropped + outbox.take_dropped())),
        }
        if is_end {
            return Ok(());
        }
        if told.elapsed() >= LOSSES_EVERY {
            told = Instant::now();
            let lost = outbox.take_dropped();
            dropped += lost;
            if lost > 0 {
                let words = format!("{lost} messages were dropped: this viewer reads too slowly");
                outbox.answer(protocol::status(StatusLevel::Warning, Some("slow"), &words));
            }
        }
    }
}

/// State that the tasks of one client share.
struct Client {
    server: Arc<Server>,
    viewer: u64,
    outbox: Arc<Outbox>,
}

impl Client {
    /// Reads requests until the client closes the connection.
    async fn read(
        &self,
        mut source: SplitStream<WebSocketStream<TcpStream>>,
        requests: Sender<Request>,
    ) -> Result<(), ConnectionError> {
        loop {
            let next = timeout(SILENCE_MAX, source.next()).await;
            let Some(message) = next.map_err(|_| ConnectionError::Silent)? else {
                return Ok(());
            };
            match message? {
                Message::Text(text) => match serde_json::from_str(&text) {
                    Ok(request) => self.request(request, &requests),
                    Err(error) => tell(&self.outbox, &format!("request not understood: {error}")),
                },
                Message::Binary(frame) => match ServiceCall::read(&frame) {
                    Some(call) => self.server.call(&self.outbox, call),
                    None => tell(
                        &self.outbox,
                        "frame not understood: only services take frames",
                    ),
                },
                Message::Close(_) => return Ok(()),
                // Pings are answered by the library.
                _ => {}
            }
        }
    }

    fn request(&self, request: Request, requests: &Sender<Request>) {
        let viewers = &self.server.viewers;
        match request {
            Request::Subscribe { subscriptions } => {
                for refused in viewers.subscribe(self.viewer, &subscriptions) {
                    let words = format!(
                        "subscription {} is not possible: there is no channel {}, the id is in use, or there are too many",
                        refused.id, refused.channel_id
                    );
                    tell(&self.outbox, &words);
                }
            }
            Request::Unsubscribe { subscription_ids } => {
                viewers.unsubscribe(self.viewer, &subscription_ids);
            }
            Request::SubscribeParameterUpdates { parameter_names } => {
                viewers.watch_parameters(self.viewer, parameter_names, true);
            }
            Request::UnsubscribeParameterUpdates { parameter_names } => {
                viewers.watch_parameters(self.viewer, parameter_names, false);
            }
            // In their order, and not here: CANCEL must not wait for them.
            request @ (Request::GetParameters { .. } | Request::SetParameters { .. }) => {
                if requests.try_send(request).is_err() {
                    let words = "too many requests for parameters: wait for their answers";
                    tell(&self.outbox, words);
                }
            }
            Request::Unknown => tell(&self.outbox, "this operation is not offered"),
        }
    }

    /// Answers requests about parameters one after the other, until the client is gone.
    async fn answer(&self, mut queue: Receiver<Request>) {
        while let Some(request) = queue.recv().await {
            match request {
                Request::GetParameters {
                    parameter_names,
                    id,
                } => {
                    let names = parameter_names;
                    self.server.get_parameters(&self.outbox, names, id).await;
                }
                Request::SetParameters { parameters, id } => {
                    self.server
                        .set_parameters(&self.outbox, parameters, id)
                        .await;
                }
                _ => {}
            }
        }
    }
}
