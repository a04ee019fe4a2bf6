//! The texts attached to a recording: in segments each is repeated only where a message needs it, and forgotten with its
//! net, so that texts never fill a recording without end. Run by the thread that writes.

use std::collections::BTreeSet;
use std::hash::{DefaultHasher, Hash, Hasher};

use crate::file::{AttachedText, McapFile, RecordingError};

/// The texts of a recording.
pub(crate) struct RecordingTexts {
    /// Greatest size of all texts in one segment, bytes; `None` if there are no segments.
    bytes_max: Option<u64>,
    /// Their size in the current segment, bytes.
    bytes: u64,
    /// Hashes of the texts in a recording without segments: it never needs their content again.
    written: BTreeSet<u64>,
    /// Texts that a later segment may need.
    kept: Vec<KeptText>,
}

struct KeptText {
    text: AttachedText,
    /// It is in the current segment.
    is_attached: bool,
}

impl RecordingTexts {
    /// No texts; `bytes_max` is the room for them in one segment.
    pub fn new(bytes_max: Option<u64>) -> RecordingTexts {
        RecordingTexts {
            bytes_max,
            bytes: 0,
            written: BTreeSet::new(),
            kept: Vec::new(),
        }
    }

    /// Returns the number of bytes that a text adds to a recording without segments.
    pub fn length_of(&self, text: &AttachedText) -> u64 {
        match self.written.contains(&hash_of(text)) {
            true => 0,
            false => text.text.len() as u64,
        }
    }

    /// Attaches a text that is not there yet. Without room in this segment it is attached to a later one.
    pub fn add(
        &mut self,
        text: AttachedText,
        file: &mut McapFile,
        time_ns: u64,
    ) -> Result<(), RecordingError> {
        if self.bytes_max.is_none() {
            return match self.written.insert(hash_of(&text)) {
                true => file.attach(&text, time_ns),
                false => Ok(()),
            };
        }
        let name = text.name.clone();
        if !self.kept.iter().any(|one| one.text == text) {
            // Another text of the same name, such as that of the cell, is out of date.
            self.kept.retain(|one| one.text.name != text.name);
            self.kept.push(KeptText {
                text,
                is_attached: false,
            });
        }
        self.attach_where(|text| text.name == name, file, time_ns)
    }

    /// Attaches the text of the net with this hash: a message of it follows.
    pub fn attach_net(
        &mut self,
        hash: &str,
        file: &mut McapFile,
        time_ns: u64,
    ) -> Result<(), RecordingError> {
        self.attach_where(|text| net_hash(text) == Some(hash), file, time_ns)
    }

    /// Begins a segment with the texts that are not those of nets. A net's text is kept as long as the last segment had
    /// it, or the net has a channel.
    pub fn next_segment(
        &mut self,
        file: &mut McapFile,
        time_ns: u64,
        has_channel: impl Fn(&str) -> bool,
    ) -> Result<(), RecordingError> {
        self.kept
            .retain(|one| one.is_attached || net_hash(&one.text).is_none_or(&has_channel));
        for one in &mut self.kept {
            one.is_attached = false;
        }
        self.bytes = 0;
        self.attach_where(|text| net_hash(text).is_none(), file, time_ns)
    }

    /// Attaches those of the texts for which there is room.
    fn attach_where(
        &mut self,
        is_wanted: impl Fn(&AttachedText) -> bool,
        file: &mut McapFile,
        time_ns: u64,
    ) -> Result<(), RecordingError> {
        let room = self.bytes_max.unwrap_or(u64::MAX);
        for one in &mut self.kept {
            let bytes = self.bytes + one.text.text.len() as u64;
            if one.is_attached || bytes > room || !is_wanted(&one.text) {
                continue;
            }
            file.attach(&one.text, time_ns)?;
            (one.is_attached, self.bytes) = (true, bytes);
        }
        Ok(())
    }
}

/// Returns the hash in the name `NET-HASH.yaml` of the text of a net.
fn net_hash(text: &AttachedText) -> Option<&str> {
    let (_, hash) = text.name.strip_suffix(".yaml")?.rsplit_once('-')?;
    let is_hash = hash.len() == 16 && hash.bytes().all(|byte| byte.is_ascii_hexdigit());
    is_hash.then_some(hash)
}

fn hash_of(text: &AttachedText) -> u64 {
    let mut hasher = DefaultHasher::new();
    (&text.name, &text.media_type, &text.text).hash(&mut hasher);
    hasher.finish()
}
