//! Queue of the messages to a client: bounded, and never blocks its senders. Filled by the engine and by the thread
//! that reads the connection; emptied by the thread that writes it.

use std::net::{Shutdown, TcpStream};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};

use crate::dio::DioMessage;
use crate::websocket::text_frame;

/// Batches that wait for a client at most; one that does not read loses its connection, and may come again.
const WAITING_MAX: usize = 2048;

/// The sending side of a connection.
#[derive(Clone, Debug)]
pub struct Outbox {
    /// Number of the connection.
    pub connection: u64,
    sender: SyncSender<Vec<u8>>,
    socket: Arc<TcpStream>,
}

impl Outbox {
    /// Returns the outbox of a connection, and what its writing thread receives.
    #[must_use]
    pub fn new(connection: u64, socket: Arc<TcpStream>) -> (Outbox, Receiver<Vec<u8>>) {
        let (sender, receiver) = sync_channel(WAITING_MAX);
        let outbox = Outbox {
            connection,
            sender,
            socket,
        };
        (outbox, receiver)
    }

    /// Sends messages as one batch.
    pub fn send(&self, messages: &[DioMessage]) {
        if !messages.is_empty() {
            self.send_frame(
                messages
                    .iter()
                    .flat_map(|message| text_frame(&message.to_string()))
                    .collect(),
            );
        }
    }

    /// Sends a frame.
    pub fn send_frame(&self, frame: Vec<u8>) {
        match self.sender.try_send(frame) {
            // The connection ends anyway.
            Ok(()) | Err(TrySendError::Disconnected(_)) => {}
            Err(TrySendError::Full(_)) => {
                tracing::warn!(
                    connection = self.connection,
                    "a client does not read; its connection is closed"
                );
                self.close();
            }
        }
    }

    /// Closes the connection; its threads then end.
    pub fn close(&self) {
        // It may be closed already.
        let _ = self.socket.shutdown(Shutdown::Both);
    }
}
