//! Carries frames between `ethercrab` and the socket. A frame that cannot be sent, or an answer that cannot be read, is a lost
//! exchange: the interface may be down because the cable was pulled, and comes up again.
//! A future, run by the thread of the session.

use std::future::Future;
use std::io;
use std::pin::Pin;
use std::sync::atomic::{AtomicU64, Ordering};
use std::task::{Context, Poll};

use async_io::Async;
use ethercrab::{PduRx, PduTx};

use crate::wire::{PACKET_MAX, Socket, is_gone};

/// Counters of frames; they outlast a session. Relaxed: they publish no other data.
#[derive(Debug, Default)]
pub struct FrameCounts {
    /// Frames that the interface did not take.
    pub unsent: AtomicU64,
    /// Packets that are no answer to a frame in flight: late, twice, or damaged.
    pub refused: AtomicU64,
}

/// Carries frames until the interface is gone.
pub struct Frames<'a> {
    socket: Async<Socket>,
    sender: PduTx<'a>,
    receiver: PduRx<'a>,
    packet: [u8; PACKET_MAX],
    counts: &'a FrameCounts,
}

impl<'a> Frames<'a> {
    /// Registers the socket.
    ///
    /// # Errors
    /// Returns an error of the operating system.
    pub fn new(
        socket: Socket,
        (sender, receiver): (PduTx<'a>, PduRx<'a>),
        counts: &'a FrameCounts,
    ) -> io::Result<Frames<'a>> {
        Ok(Frames {
            socket: Async::new(socket)?,
            sender,
            receiver,
            packet: [0; PACKET_MAX],
            counts,
        })
    }

    fn send_all(&mut self) -> io::Result<()> {
        let mut result = Ok(());
        while let Some(frame) = self.sender.next_sendable_frame() {
            let socket = self.socket.get_ref();
            // Said to be sent in any case: a frame that stays sendable would be tried again at once and for ever.
            let sent = frame.send_blocking(|bytes| {
                if let Err(error) = socket.send(bytes) {
                    self.counts.unsent.fetch_add(1, Ordering::Relaxed);
                    if is_gone(&error) {
                        result = Err(error);
                    }
                }
                Ok(bytes.len())
            });
            if sent.is_err() {
                break;
            }
        }
        result
    }

    fn receive_all(&mut self, context: &mut Context<'_>) -> Poll<io::Error> {
        loop {
            match self.socket.get_ref().receive(&mut self.packet) {
                Ok(Some(size)) => {
                    let packet = self.packet.get(..size).unwrap_or_default();
                    if self.receiver.receive_frame(packet).is_err() {
                        self.counts.refused.fetch_add(1, Ordering::Relaxed);
                    }
                }
                Err(error) if is_gone(&error) => return Poll::Ready(error),
                // An error such as "network is down" is reported once; then nothing is there.
                Ok(None) | Err(_) => match self.socket.poll_readable(context) {
                    Poll::Ready(Ok(())) => {}
                    Poll::Ready(Err(error)) => return Poll::Ready(error),
                    Poll::Pending => return Poll::Pending,
                },
            }
        }
    }
}

impl Future for Frames<'_> {
    type Output = io::Error;

    fn poll(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Error> {
        let this = self.get_mut();
        this.sender.replace_waker(context.waker());
        match this.send_all() {
            Err(error) => Poll::Ready(error),
            Ok(()) => this.receive_all(context),
        }
    }
}
