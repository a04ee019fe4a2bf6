//! Where the messages about a cell go: into a file, or to the viewers of a gateway. Both get the same bytes.

use crate::file::{AttachedText, ChannelInfo, RecordingError};

/// A channel of a sink.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ChannelId(usize);

impl ChannelId {
    /// Creates the id of the channel with this index in its sink.
    #[must_use]
    pub fn new(index: usize) -> ChannelId {
        ChannelId(index)
    }

    /// Returns the index.
    #[must_use]
    pub fn index(self) -> usize {
        self.0
    }
}

/// State of a sink after a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[must_use]
pub enum RecordingState {
    /// It goes on.
    Open,
    /// A recording has reached its greatest size; nothing more is written.
    Full,
}

/// Takes the messages about a cell.
pub trait MessageSink {
    /// Returns the channel with this content; adds it if it is new. It appears in a file with its first message. Viewers
    /// expect one type on a topic: in a file, a topic of another type gets a number.
    fn channel(&mut self, wanted: ChannelInfo) -> ChannelId;

    /// Says that the caller writes nothing more to these channels, unless it asks for them again: a recording without end
    /// forgets them. Viewers keep theirs.
    fn release(&mut self, _channels: &[ChannelId]) {}

    /// Attaches a text, to a file and to those that follow it.
    ///
    /// # Errors
    /// Fails if the file cannot be written.
    fn attach(&mut self, text: AttachedText, time_ns: u64) -> Result<(), RecordingError>;

    /// Writes a message; its time is ns since 1970.
    ///
    /// # Errors
    /// Fails if the file cannot be written; it ends at its last flush.
    fn write(
        &mut self,
        channel: ChannelId,
        time_ns: u64,
        message: &[u8],
    ) -> Result<RecordingState, RecordingError>;

    /// Writes a message with which each later file, and each viewer that comes later, begins.
    ///
    /// # Errors
    /// As [`MessageSink::write`].
    fn write_kept(
        &mut self,
        channel: ChannelId,
        time_ns: u64,
        message: &[u8],
    ) -> Result<RecordingState, RecordingError>;
}
