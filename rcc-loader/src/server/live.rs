//! Streamed answers, which last until the client ends them: a worker thread produces pieces, the serving thread sends
//! them. Number and size of the pieces that a client has not received are bounded; further ones are refused, and the
//! worker counts them.

use std::convert::Infallible;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};

use axum::body::{Body, Bytes};
use axum::http::header;
use axum::response::{IntoResponse, Response};
use hyper::body::Frame;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, mpsc};

use super::quota::QuotaPermit;

/// Maximum number of pieces that a client has not taken.
pub const PIECES_MAX: usize = 64;
/// Maximum size of the pieces that a client has not taken, bytes.
pub const BYTES_MAX: usize = 256 << 10;

/// The worker's end; the answer ends when it is dropped.
#[derive(Debug)]
pub struct LiveSender {
    pieces: mpsc::Sender<Piece>,
    room: Arc<Semaphore>,
}

#[derive(Debug)]
struct Piece {
    bytes: Bytes,
    _room: Option<OwnedSemaphorePermit>,
}

/// The piece does not fit, because the client takes them too slowly.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClientTooSlow;

impl LiveSender {
    /// Sends a piece, unless the client has too many.
    ///
    /// # Errors
    /// Returns [`ClientTooSlow`] if it has, and the piece is lost; nothing if it is gone.
    pub fn send(&self, piece: String) -> Result<(), ClientTooSlow> {
        let room = Arc::clone(&self.room)
            .try_acquire_many_owned(share(&piece))
            .map_err(|_| ClientTooSlow)?;
        let (bytes, _room) = (piece.into(), Some(room));
        match self.pieces.try_send(Piece { bytes, _room }) {
            Err(mpsc::error::TrySendError::Full(_)) => Err(ClientTooSlow),
            // A client that is gone is found by `is_over`.
            Ok(()) | Err(mpsc::error::TrySendError::Closed(_)) => Ok(()),
        }
    }

    /// Sends the last piece, and waits for room. Not for the serving thread.
    pub fn finish(self, piece: String) {
        // The last piece is short, and takes no room.
        let (bytes, _room) = (piece.into(), None);
        // On an error the client is gone.
        let _ = self.pieces.blocking_send(Piece { bytes, _room });
    }

    /// Returns true if the client is gone.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.pieces.is_closed()
    }
}

/// Returns the part of the buffer that a piece takes, bytes; one that is longer than the buffer takes all of it.
fn share(piece: &str) -> u32 {
    piece.len().min(BYTES_MAX) as u32
}

/// Creates an answer of this content type, and its sender. `place` is dropped with the answer.
pub fn answer(content_type: &'static str, place: QuotaPermit) -> (LiveSender, Response) {
    let (pieces, taken) = mpsc::channel(PIECES_MAX);
    let room = Arc::new(Semaphore::new(BYTES_MAX));
    let body = Body::new(LiveBody {
        taken,
        _place: place,
    });
    let headers = [
        (header::CONTENT_TYPE, content_type),
        (header::CACHE_CONTROL, "no-store"),
    ];
    let response = (headers, body).into_response();
    (LiveSender { pieces, room }, response)
}

struct LiveBody {
    taken: mpsc::Receiver<Piece>,
    _place: QuotaPermit,
}

impl hyper::body::Body for LiveBody {
    type Data = Bytes;
    type Error = Infallible;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Infallible>>> {
        let piece = self.taken.poll_recv(context);
        piece.map(|piece| piece.map(|piece| Ok(Frame::data(piece.bytes))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::server::peer::ClientPeer;
    use crate::server::quota::{Quota, QuotaLimits};

    #[test]
    fn a_client_that_takes_nothing_is_sent_a_bounded_number_of_bytes_and_pieces() {
        let places = Quota::new(QuotaLimits {
            all: 2,
            of_peer: 2,
            reserve: 0,
            small: 0,
        });
        let place = || places.take(ClientPeer::Process(1), 1);
        let (sender, response) = answer("text/plain", place().expect("a place"));
        let sent = (0..1000).filter(|_| sender.send("x".repeat(4096)).is_ok());
        assert_eq!(sent.count(), BYTES_MAX / 4096);
        let (small, other) = answer("text/plain", place().expect("a place"));
        let sent = (0..1000).filter(|_| small.send("x".to_owned()).is_ok());
        assert_eq!(sent.count(), PIECES_MAX);
        assert!(!sender.is_over() && place().is_none());
        drop((response, other));
        assert!(sender.is_over() && place().is_some());
    }
}
