//! One MCAP file that is being written: whole chunks only, so that what a killed recorder leaves can be read up to its last
//! flush, and cut back to that place if the disk is full. Run by the thread that writes.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use mcap::records::MessageHeader;
use mcap::write::{NoSeek, WriteOptions};
use mcap::{Attachment, McapError, Writer};

use crate::schemas::MessageSchema;

/// Size of a chunk, bytes; a second that is larger becomes several chunks.
const CHUNK_BYTES: u64 = 1 << 20;
/// Bytes of the summary for each chunk, and for each channel of a chunk.
const SUMMARY_BYTES: [u64; 2] = [96, 10];
/// Bytes around a message in the file: its record and its places in two indexes.
const MESSAGE_BYTES: u64 = 9 + 22 + 16;

/// Where the bytes go.
struct Output {
    file: File,
    /// Bytes written to the system; read by the [`McapFile`] of the same thread.
    written: Arc<AtomicU64>,
}

impl Write for Output {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let count = self.file.write(bytes)?;
        self.written.fetch_add(count as u64, Ordering::Relaxed);
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// The reason why a file cannot be written.
#[derive(Debug, thiserror::Error)]
#[error("{path}: {source}")]
pub struct RecordingError {
    /// The file.
    pub path: PathBuf,
    /// The reason.
    pub source: io::Error,
}

impl RecordingError {
    fn new(path: &Path, error: McapError) -> RecordingError {
        let source = match error {
            McapError::Io(error) => error,
            other => io::Error::other(other),
        };
        RecordingError {
            path: path.to_owned(),
            source,
        }
    }
}

/// A channel: its topic, its type, and what else is known of it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChannelInfo {
    /// Topic.
    pub topic: String,
    /// Type of its messages.
    pub schema: MessageSchema,
    /// Metadata.
    pub metadata: BTreeMap<String, String>,
}

/// A text that belongs to a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AttachedText {
    /// Name, such as `line.yaml`.
    pub name: String,
    /// Media type.
    pub media_type: String,
    /// Content.
    pub text: String,
}

/// A file that is being written.
pub struct McapFile {
    path: PathBuf,
    writer: Option<Writer<NoSeek<BufWriter<Output>>>>,
    written: Arc<AtomicU64>,
    /// Length at the last flush: up to here the file can be read, bytes.
    readable: u64,
    /// Bytes since then, about.
    pending: u64,
    summary: u64,
    channels: u64,
}

impl McapFile {
    /// Creates a file; one that exists is kept, and is an error, unless `replace`.
    ///
    /// # Errors
    /// Fails if the file exists or cannot be written.
    pub fn create(path: &Path, replace: bool) -> Result<McapFile, RecordingError> {
        let failed = |error| RecordingError::new(path, error);
        let mut options = OpenOptions::new();
        options.write(true);
        match replace {
            true => options.create(true).truncate(true),
            false => options.create_new(true),
        };
        let file = options
            .open(path)
            .map_err(|error| failed(McapError::Io(error)))?;
        let written = Arc::new(AtomicU64::new(0));
        let output = Output {
            file,
            written: Arc::clone(&written),
        };
        let output = BufWriter::with_capacity(1 << 16, output);
        let writer = WriteOptions::new()
            .profile("ros2")
            .library("rcc")
            .compression(None)
            .chunk_size(Some(CHUNK_BYTES))
            .disable_seeking(true)
            // The file is written once, from front to back: a checksum of each chunk is enough.
            .calculate_data_section_crc(false)
            .create(NoSeek::new(output))
            .map_err(failed)?;
        let mut file = McapFile {
            path: path.to_owned(),
            writer: Some(writer),
            written,
            readable: 0,
            pending: 0,
            summary: 1 << 10,
            channels: 0,
        };
        file.flush()?;
        Ok(file)
    }

    /// Returns its path.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns its length if it were finished now, bytes; rather too much.
    #[must_use]
    pub fn length(&self) -> u64 {
        self.readable + self.pending + self.summary
    }

    /// Does something with the writer; an error ends the file.
    fn with<T>(
        &mut self,
        work: impl FnOnce(&mut Writer<NoSeek<BufWriter<Output>>>) -> Result<T, McapError>,
    ) -> Result<T, RecordingError> {
        let result = match &mut self.writer {
            Some(writer) => work(writer),
            None => Err(McapError::AttemptedWriteAfterFailure),
        };
        result.map_err(|error| {
            self.cut();
            RecordingError::new(&self.path, error)
        })
    }

    /// Cuts the file back to its last flush, where a reader finds the end of a chunk.
    fn cut(&mut self) {
        let Some(writer) = self.writer.take() else {
            return;
        };
        // Bytes that are still in the buffer came after the last flush, and are dropped with it.
        let (output, _) = writer.into_inner().into_inner().into_parts();
        // If this fails too, readers stop at the torn chunk instead.
        let _ = output.file.set_len(self.readable);
    }

    /// Adds a channel; returns its number in this file.
    ///
    /// # Errors
    /// Fails if the file cannot be written.
    pub fn add_channel(&mut self, info: &ChannelInfo) -> Result<u16, RecordingError> {
        let schema = &info.schema;
        let id = self.with(|writer| {
            let id = writer.add_schema(&schema.name, "ros2msg", schema.text.as_bytes())?;
            writer.add_channel(id, &info.topic, "cdr", &info.metadata)
        })?;
        let metadata = info
            .metadata
            .iter()
            .map(|(key, value)| key.len() + value.len() + 8);
        let texts = schema.text.len() + info.topic.len() + metadata.sum::<usize>() + 100;
        // Once in the data, once in the summary.
        self.pending += texts as u64;
        self.summary += texts as u64;
        self.channels += 1;
        Ok(id)
    }

    /// Writes a message.
    ///
    /// # Errors
    /// Fails if the file cannot be written; the recording ends at its last flush.
    pub fn write(
        &mut self,
        channel_id: u16,
        sequence: u32,
        log_time: u64,
        message: &[u8],
    ) -> Result<(), RecordingError> {
        let header = MessageHeader {
            channel_id,
            sequence,
            log_time,
            publish_time: log_time,
        };
        self.with(|writer| writer.write_to_known_channel(&header, message))?;
        self.pending += message.len() as u64 + MESSAGE_BYTES;
        Ok(())
    }

    /// Writes an attachment.
    ///
    /// # Errors
    /// As [`McapFile::write`].
    pub fn attach(&mut self, text: &AttachedText, time_ns: u64) -> Result<(), RecordingError> {
        let attachment = Attachment {
            log_time: time_ns,
            create_time: time_ns,
            name: text.name.clone(),
            media_type: text.media_type.clone(),
            data: text.text.as_bytes().into(),
        };
        self.with(|writer| writer.attach(&attachment))?;
        self.pending += (text.text.len() + text.name.len() + 200) as u64;
        self.summary += (text.name.len() + 100) as u64;
        Ok(())
    }

    /// Ends the chunk and passes everything to the system: a reader finds all that was written before.
    ///
    /// # Errors
    /// As [`McapFile::write`].
    pub fn flush(&mut self) -> Result<(), RecordingError> {
        self.with(|writer| writer.flush())?;
        let [chunk, channel] = SUMMARY_BYTES;
        let chunks = self.pending / CHUNK_BYTES + 1;
        self.summary += chunks * (chunk + channel * self.channels);
        self.readable = self.written.load(Ordering::Relaxed);
        self.pending = 0;
        Ok(())
    }

    /// Writes the index and ends the file; returns its length in bytes.
    ///
    /// # Errors
    /// As [`McapFile::write`].
    pub fn finish(mut self) -> Result<u64, RecordingError> {
        self.flush()?;
        self.with(|writer| writer.finish().map(|_| ()))?;
        let Some(writer) = self.writer.take() else {
            return Ok(self.readable);
        };
        let output = writer.into_inner().into_inner();
        match output.into_inner() {
            Ok(_) => Ok(self.written.load(Ordering::Relaxed)),
            Err(error) => {
                let (error, output) = error.into_parts();
                let (output, _) = output.into_parts();
                // Without its index it is complete up to the last flush.
                let _ = output.file.set_len(self.readable);
                Err(RecordingError::new(&self.path, McapError::Io(error)))
            }
        }
    }
}
