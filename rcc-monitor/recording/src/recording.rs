//! A recording: channels, attached texts and messages, in one file or in segments of which the oldest are removed. Run by
//! the thread that writes.

use std::collections::VecDeque;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use crate::file::{AttachedText, ChannelInfo, McapFile, RecordingError};
use crate::sink::{ChannelId, MessageSink, RecordingState};
use crate::texts::RecordingTexts;

/// Number of segments that a recording without end consists of.
pub const SEGMENTS: u64 = 8;
/// Key of the metadata of a net's channels with the hash of its text, which ends the name of the attached text.
pub const NET_HASH: &str = "net_hash";

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
    /// Its user will not write to it any more.
    is_released: bool,
}

impl Channel {
    /// Returns the hash of the net whose values it has.
    fn net_hash(&self) -> Option<&str> {
        self.wanted.metadata.get(NET_HASH).map(String::as_str)
    }
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
    /// `None` for one that was dropped; the place is used again.
    channels: Vec<Option<Channel>>,
    texts: RecordingTexts,
    full: bool,
}

impl Recording {
    /// Creates the first file.
    ///
    /// # Errors
    /// Fails if the file, or any segment of an earlier recording of this name, exists, or if it cannot be written.
    pub fn create(options: RecordingOptions) -> Result<Recording, RecordingError> {
        let path = match options.when_full {
            WhenFull::Stop => options.path.clone(),
            WhenFull::RemoveOldest => segment_path(&options.path, 1),
        };
        // A later segment must not be the first to find one, hours from now.
        let is_new = options.when_full == WhenFull::RemoveOldest && !options.replace;
        if let Some(path) = existing_segment(&options.path).filter(|_| is_new) {
            let words = "a segment of an earlier recording exists";
            let source = io::Error::new(io::ErrorKind::AlreadyExists, words);
            return Err(RecordingError { path, source });
        }
        let texts_max = match options.when_full {
            WhenFull::Stop => None,
            WhenFull::RemoveOldest => Some(options.bytes_max / SEGMENTS / 2),
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
            texts: RecordingTexts::new(texts_max),
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
        let Some(Some(channel)) = self.channels.get_mut(channel.index()) else {
            return Ok(());
        };
        let number = match channel.number {
            Some(number) => number,
            None => {
                if let Some(hash) = channel.net_hash() {
                    self.texts.attach_net(hash, &mut self.file, time_ns)?;
                }
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
        for place in &mut self.channels {
            // One that is asked for again is added again.
            place.take_if(|channel| channel.is_released && channel.number.is_none());
            if let Some(channel) = place {
                channel.number = None;
            }
        }
        let channels = &self.channels;
        let has_channel = |hash: &str| {
            let mut channels = channels.iter().flatten();
            channels.any(|one| one.net_hash() == Some(hash))
        };
        self.texts
            .next_segment(&mut self.file, time_ns, has_channel)?;
        for index in 0..self.channels.len() {
            let channel = self.channels.get(index).and_then(Option::as_ref);
            let kept = channel.and_then(|one| one.kept.clone());
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
        let mut places = self.channels.iter_mut().enumerate();
        let known = places.find_map(|(place, one)| {
            let known = one.as_mut().filter(|one| one.wanted == wanted)?;
            known.is_released = false;
            Some(place)
        });
        if let Some(known) = known {
            return ChannelId::new(known);
        }
        let mut info = wanted.clone();
        let mut number = 2;
        let taken = |info: &ChannelInfo| {
            let mut others = self.channels.iter().flatten().map(|one| &one.info);
            others.any(|other| other.topic == info.topic && other.schema != info.schema)
        };
        while taken(&info) {
            info.topic = format!("{}_{number}", wanted.topic);
            number += 1;
        }
        let channel = Some(Channel {
            wanted,
            info,
            number: None,
            sequence: 0,
            kept: None,
            is_released: false,
        });
        let mut free = self.channels.iter_mut().enumerate();
        match free.find(|(_, place)| place.is_none()) {
            Some((index, place)) => {
                *place = channel;
                ChannelId::new(index)
            }
            None => {
                self.channels.push(channel);
                ChannelId::new(self.channels.len() - 1)
            }
        }
    }

    fn release(&mut self, channels: &[ChannelId]) {
        for channel in channels {
            if let Some(Some(channel)) = self.channels.get_mut(channel.index()) {
                channel.is_released = true;
            }
        }
    }

    fn attach(&mut self, text: AttachedText, time_ns: u64) -> Result<(), RecordingError> {
        if self.full {
            return Ok(());
        }
        let length = self.file.length() + self.texts.length_of(&text);
        if self.options.when_full == WhenFull::Stop && length > self.options.bytes_max {
            self.full = true;
            return Ok(());
        }
        self.texts.add(text, &mut self.file, time_ns)
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
        if let Some(Some(channel)) = self.channels.get_mut(channel.index()) {
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

/// Returns an existing file whose name is that of a segment.
fn existing_segment(path: &Path) -> Option<PathBuf> {
    let folder = match path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    };
    // A folder that cannot be read is the error of the file that is created in it.
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut found: Vec<PathBuf> = entries
        .filter_map(|entry| {
            let name = entry.file_name();
            let stem = Path::new(&name).file_stem()?.to_str()?;
            let (_, number) = stem.rsplit_once('-')?;
            let segment = segment_path(path, number.parse().ok()?);
            (segment.file_name() == Some(&name)).then_some(segment)
        })
        .collect();
    found.sort();
    found.into_iter().next()
}
