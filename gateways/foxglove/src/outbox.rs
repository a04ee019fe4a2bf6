//! Messages that one client has not taken yet. Bounded: of messages the oldest are dropped and counted, so that a client that reads
//! slowly costs neither memory nor time of others; answers are never dropped, but a client that does not take them is
//! disconnected. Filled by every thread without waiting, emptied by the client's task.

use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};

use tokio::sync::Notify;
use tokio_tungstenite::tungstenite::{Bytes, Message};

/// Greatest size of the messages that wait for one client, bytes: about two seconds of a large cell at 1 kHz.
pub const MESSAGES_BYTES_MAX: usize = 4 << 20;
/// Greatest size of the answers and announcements that wait for one client, bytes.
pub const ANSWERS_BYTES_MAX: usize = 16 << 20;

#[derive(Debug, Default)]
struct Waiting {
    answers: VecDeque<Message>,
    answers_bytes: usize,
    messages: VecDeque<Bytes>,
    messages_bytes: usize,
    dropped: u64,
    is_closed: bool,
}

/// The queue of one client.
#[derive(Debug, Default)]
pub struct Outbox {
    waiting: Mutex<Waiting>,
    filled: Notify,
}

impl Outbox {
    fn lock(&self) -> MutexGuard<'_, Waiting> {
        // Each change is complete before the lock is given back.
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds a message of a channel, and drops the oldest ones if there is no room.
    pub fn message(&self, frame: Bytes) {
        let mut waiting = self.lock();
        waiting.messages_bytes += frame.len();
        waiting.messages.push_back(frame);
        while waiting.messages_bytes > MESSAGES_BYTES_MAX {
            let Some(oldest) = waiting.messages.pop_front() else {
                break;
            };
            waiting.messages_bytes -= oldest.len();
            waiting.dropped += 1;
        }
        drop(waiting);
        self.filled.notify_one();
    }

    /// Adds an answer or an announcement; it overtakes messages.
    pub fn answer(&self, answer: Message) {
        let mut waiting = self.lock();
        waiting.answers_bytes += answer.len();
        if waiting.answers_bytes > ANSWERS_BYTES_MAX {
            waiting.is_closed = true;
        } else {
            waiting.answers.push_back(answer);
        }
        drop(waiting);
        self.filled.notify_one();
    }

    /// Ends the connection after what waits already.
    pub fn close(&self) {
        self.lock().is_closed = true;
        self.filled.notify_one();
    }

    /// Returns how many messages were dropped since the last call.
    pub fn take_dropped(&self) -> u64 {
        std::mem::take(&mut self.lock().dropped)
    }

    fn take(&self) -> Option<Option<Message>> {
        let mut waiting = self.lock();
        if let Some(answer) = waiting.answers.pop_front() {
            waiting.answers_bytes -= answer.len();
            return Some(Some(answer));
        }
        if waiting.is_closed {
            return Some(None);
        }
        let message = waiting.messages.pop_front()?;
        waiting.messages_bytes -= message.len();
        Some(Some(Message::Binary(message)))
    }

    /// Waits for the next one to be sent; `None` once the connection has to end. Called by one task.
    pub async fn next(&self) -> Option<Message> {
        loop {
            if let Some(next) = self.take() {
                return next;
            }
            // A notification that comes before this is kept by `Notify`.
            self.filled.notified().await;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(number: u32, length: usize) -> Bytes {
        let mut frame = vec![0; length];
        frame[..4].copy_from_slice(&number.to_le_bytes());
        frame.into()
    }

    fn taken(outbox: &Outbox) -> Vec<Message> {
        std::iter::from_fn(|| outbox.take().flatten()).collect()
    }

    #[test]
    fn a_client_that_does_not_read_loses_the_oldest_messages() {
        let outbox = Outbox::default();
        let length = MESSAGES_BYTES_MAX / 10;
        for number in 0..25 {
            outbox.message(frame(number, length));
        }
        assert_eq!((outbox.take_dropped(), outbox.take_dropped()), (15, 0));
        let left = taken(&outbox);
        let first = left.first().cloned().map(Message::into_data);
        assert_eq!((left.len(), first), (10, Some(frame(15, length))));
        // There is room again.
        outbox.message(frame(25, length));
        assert_eq!((taken(&outbox).len(), outbox.take_dropped()), (1, 0));
    }

    #[test]
    fn answers_overtake_messages_and_too_many_of_them_end_the_connection() {
        let outbox = Outbox::default();
        outbox.message(frame(1, 8));
        outbox.answer(Message::text("answer"));
        assert_eq!(taken(&outbox).first(), Some(&Message::text("answer")));
        let long = "x".repeat(ANSWERS_BYTES_MAX / 2);
        for _ in 0..3 {
            outbox.answer(Message::text(&*long));
        }
        assert_eq!(taken(&outbox).len(), 2);
        assert_eq!(outbox.take(), Some(None), "closed");
    }
}
