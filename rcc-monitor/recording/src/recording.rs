//! A recording: channels, attached texts and messages, in one file or in segments of which the oldest are removed. Run by
//! the thread that writes.

use std::collections::VecDeque;
use std::fs;
use std::path::{Path, PathBuf};

use crate::file::{AttachedText, ChannelInfo, McapFile, RecordingError};
use crate::sink::{ChannelId, MessageSink, RecordingState};

/// Number of segments that a recording without end consists of.
pub const SEGMENTS: u64 = 8;

/// Behaviour of a recording at its greatest size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WhenFull {
    /// It ends.
    Stop,
    /// Its oldest segment is removed.
    RemoveOldest,
}

/// Where a recording is written, and how large it may become.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecordingOptions {
    /// The file; segments have a number before the extension.
    pub path: PathBuf,
    /// An existing file is replaced; otherwise it is an error.
    pub replace: bool,
    /// Greatest size of all files together, bytes.
    pub bytes_max: u64,
    /// Behaviour at that size.
    pub when_full: WhenFull,
}

struct Channel {
    /// As it was asked for.
    wanted: ChannelInfo,
    info: ChannelInfo,
    /// Its number in the current file.
    number: Option<u16>,
    sequence: u32,
    /// The newest message, if each segment must begin with it.
    kept: Option<Vec<u8>>,
}

/// Amount of data that was written.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RecordingSummary {
    /// The files that exist, the newest last.
    pub files: Vec<PathBuf>,
    /// Their size together, bytes.
    pub bytes: u64,
    /// Messages written, including those of removed segments.
    pub messages: u64,
    /// Removed segments.
    pub removed: u64,
    /// Times of the first and last message that still exist, ns since 1970; 0 if there is none.
    pub span_ns: [u64; 2],
}

/// A finished segment.
struct Segment {
    path: PathBuf,
    bytes: u64,
    first_ns: u64,
}

/// A recording that is being written.
pub struct Recording {
    options: RecordingOptions,
    file: McapFile,
    /// First time in the current file, ns; 0 if it is empty.
    first_ns: u64,
    last_ns: u64,
    older: VecDeque<Segment>,
    number: u64,
    removed: u64,
    messages: u64,
    channels: Vec<Channel>,
    texts: Vec<AttachedText>,
    full: bool,
}

impl Recording {
    /// Creates the first file.
    ///
    /// # Errors
    /// Fails if the file exists or cannot be written.
    pub fn create(options: RecordingOptions) -> Result<Recording, RecordingError> {
        let path = match options.when_full {
            WhenFull::Stop => options.path.clone(),
            WhenFull::RemoveOldest => segment_path(&options.path, 1),
        };
        Ok(Recording {
            file: McapFile::create(&path, options.replace)?,
            options,
            first_ns: 0,
            last_ns: 0,
            older: VecDeque::new(),
            number: 1,
            removed: 0,
            messages: 0,
            channels: Vec::new(),
            texts: Vec::new(),
            full: false,
        })
    }

    /// Returns the file that is being written.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.file.path()
    }

    fn put(
        &mut self,
        channel: ChannelId,
        time_ns: u64,
        message: &[u8],
    ) -> Result<(), RecordingError> {
        let Some(channel) = self.channels.get_mut(channel.index()) else {
            return Ok(());
        };
        let number = match channel.number {
            Some(number) => number,
            None => {
                let number = self.file.add_channel(&channel.info)?;
                channel.number = Some(number);
                number
            }
        };
        self.file
            .write(number, channel.sequence, time_ns, message)?;
        channel.sequence = channel.sequence.wrapping_add(1);
        if self.first_ns == 0 {
            self.first_ns = time_ns;
        }
        self.last_ns = self.last_ns.max(time_ns);
        self.messages += 1;
        Ok(())
    }

    /// Finishes the current file, begins the next one, and removes the oldest if there are too many.
    fn next_segment(&mut self, time_ns: u64) -> Result<(), RecordingError> {
        self.number += 1;
        let path = segment_path(&self.options.path, self.number);
        let next = McapFile::create(&path, self.options.replace)?;
        let finished = std::mem::replace(&mut self.file, next);
        let path = finished.path().to_owned();
        let bytes = finished.finish()?;
        let first_ns = std::mem::take(&mut self.first_ns);
        self.older.push_back(Segment {
            path,
            bytes,
            first_ns,
        });
        while self.older.len() as u64 >= SEGMENTS {
            if let Some(oldest) = self.older.pop_front() {
                // One that somebody has moved away is gone all the same.
                let _ = fs::remove_file(oldest.path);
                self.removed += 1;
            }
        }
        for text in &self.texts {
            self.file.attach(text, time_ns)?;
        }
        for channel in &mut self.channels {
            channel.number = None;
        }
        for index in 0..self.channels.len() {
            let kept = self.channels.get(index).and_then(|one| one.kept.clone());
            if let Some(kept) = kept {
                self.put(ChannelId::new(index), time_ns, &kept)?;
            }
        }
        Ok(())
    }

    /// Makes everything readable that was written; call it once a second.
    ///
    /// # Errors
    /// As [`Recording::write`].
    pub fn flush(&mut self) -> Result<(), RecordingError> {
        if self.full {
            return Ok(());
        }
        self.file.flush()
    }

    /// Returns what has been written so far.
    #[must_use]
    pub fn summary(&self) -> RecordingSummary {
        let older = self.older.iter();
        let first_ns = self.older.front().map_or(self.first_ns, |one| one.first_ns);
        RecordingSummary {
            files: older
                .clone()
                .map(|one| one.path.clone())
                .chain([self.file.path().to_owned()])
                .collect(),
            bytes: older.map(|one| one.bytes).sum::<u64>() + self.file.length(),
            messages: self.messages,
            removed: self.removed,
            span_ns: [first_ns, self.last_ns],
        }
    }

    /// Writes the index of the last file.
    ///
    /// # Errors
    /// As [`Recording::write`].
    pub fn finish(self) -> Result<RecordingSummary, RecordingError> {
        let mut summary = self.summary();
        let older: u64 = self.older.iter().map(|one| one.bytes).sum();
        summary.bytes = older + self.file.finish()?;
        Ok(summary)
    }
}

impl MessageSink for Recording {
    fn channel(&mut self, wanted: ChannelInfo) -> ChannelId {
        let known = self.channels.iter().position(|one| one.wanted == wanted);
        if let Some(known) = known {
            return ChannelId::new(known);
        }
        let mut info = wanted.clone();
        let mut number = 2;
        let taken = |info: &ChannelInfo| {
            let mut others = self.channels.iter().map(|one| &one.info);
            others.any(|other| other.topic == info.topic && other.schema != info.schema)
        };
        while taken(&info) {
            info.topic = format!("{}_{number}", wanted.topic);
            number += 1;
        }
        self.channels.push(Channel {
            wanted,
            info,
            number: None,
            sequence: 0,
            kept: None,
        });
        ChannelId::new(self.channels.len() - 1)
    }

    fn attach(&mut self, text: AttachedText, time_ns: u64) -> Result<(), RecordingError> {
        if self.full || self.texts.contains(&text) {
            return Ok(());
        }
        self.file.attach(&text, time_ns)?;
        self.texts.push(text);
        Ok(())
    }

    fn write(
        &mut self,
        channel: ChannelId,
        time_ns: u64,
        message: &[u8],
    ) -> Result<RecordingState, RecordingError> {
        if self.full {
            return Ok(RecordingState::Full);
        }
        let length = self.file.length() + message.len() as u64;
        match self.options.when_full {
            WhenFull::Stop if length > self.options.bytes_max => {
                self.full = true;
                return Ok(RecordingState::Full);
            }
            WhenFull::RemoveOldest if length > self.options.bytes_max / SEGMENTS => {
                self.next_segment(time_ns)?;
            }
            _ => {}
        }
        self.put(channel, time_ns, message)?;
        Ok(RecordingState::Open)
    }

    fn write_kept(
        &mut self,
        channel: ChannelId,
        time_ns: u64,
        message: &[u8],
    ) -> Result<RecordingState, RecordingError> {
        if let Some(channel) = self.channels.get_mut(channel.index()) {
            channel.kept = Some(message.to_vec());
        }
        self.write(channel, time_ns, message)
    }
}

/// `out.mcap` becomes `out-0001.mcap`.
fn segment_path(path: &Path, number: u64) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let extension = path.extension().unwrap_or("mcap".as_ref());
    path.with_file_name(format!(
        "{stem}-{number:04}.{}",
        extension.to_string_lossy()
    ))
}
