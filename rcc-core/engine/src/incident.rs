//! Incident files: a frozen recording with everything that replay needs, so that it can be replayed on another machine
//! without the cell. Written by a helper thread of the executor, read by `rcc-cli incidents` and `replay`.
//!
//! A file is a sequence of 64-bit words, little-endian: the magic number, the length of the head in bytes, the head
//! (JSON, padded with spaces), the command files of the nets (as the loader wrote them, padded with zeros), the
//! devices, the plans with their start conditions, the records of the ring ([`crate::record::entry`]), and a checksum
//! over all words ([`WordChecksum`]).

mod word_format;

use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::Path;

use rcc_core::frame::DeviceModel;
use rcc_core::message::MAGIC;
use rcc_core::primitives;
use rcc_protocol::events::hex_digits;
use serde::{Deserialize, Serialize};

use crate::hash::WordChecksum;
use crate::net::NetOrigin;
use crate::record::entry;
use crate::record::ring::RecordRing;
use word_format::{DamagedFile, WordReader};

/// File name extension of incident files.
pub const EXTENSION: &str = "rcc-incident";
/// Magic number: the first word of an incident file.
const MARK: u64 = u64::from_le_bytes(*b"RCC-incd");
/// Version of the file format.
pub const FORMAT: u32 = 9;
/// Greatest length of the head, bytes.
const HEAD_MAX: u64 = 4 << 20;
/// Greatest length of a command file, bytes; longer ones are left out.
pub const COMMAND_FILE_MAX: usize = 16 << 20;
/// Greatest length of a file that is read, bytes.
const FILE_MAX: u64 = 3 << 30;

/// Summary of an incident, readable without the rest of the file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct IncidentHead {
    /// [`FORMAT`].
    pub format: u32,
    /// Version of the executor.
    pub build: String,
    /// Version of the layout of data in shared memory.
    pub layout: String,
    /// Fingerprint of the catalogue, 16 hexadecimal digits.
    pub catalogue: String,
    /// Fingerprint of the devices' configuration, 16 hexadecimal digits.
    pub configuration: String,
    /// Name of the cell.
    pub cell: String,
    /// Path of the cell's configuration file.
    pub config: String,
    /// Incarnation of the executor, 16 hexadecimal digits.
    pub executor: String,
    /// Base period, ns.
    pub period_ns: u64,
    /// Names of the devices, in order of their index.
    pub devices: Vec<String>,
    /// `fault`, `late`, `request` or `trigger`.
    pub reason: String,
    /// Id of the net that ended with the fault, if the reason is one.
    pub net: Option<u64>,
    /// The fault in words, without names, if the reason is one.
    pub fault: Option<String>,
    /// The condition that became true, if the reason is a trigger.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub condition: Option<String>,
    /// Cycle in which the recording was triggered.
    pub cycle: u64,
    /// Wall-clock time of the trigger, UTC.
    pub time: String,
    /// Number of further triggers in this recording.
    pub others: u64,
    /// First recorded cycle.
    pub first_cycle: u64,
    /// Last recorded cycle.
    pub last_cycle: u64,
    /// Ids of nets that were evaluated and whose plan is in the file.
    pub nets: Vec<u64>,
    /// Ids of nets that were evaluated and whose plan was no longer available when the file was written.
    pub without_plan: Vec<u64>,
    /// Command files: id and length in bytes.
    pub files: Vec<(u64, u64)>,
}

/// Why a file cannot be read as an incident.
#[derive(Debug, thiserror::Error)]
pub enum IncidentError {
    /// The operating system reports an error.
    #[error("cannot read the file: {0}")]
    Read(#[from] io::Error),
    /// Not an incident file.
    #[error("not an incident file")]
    NotAnIncident,
    /// Longer than any incident file; the length in bytes.
    #[error("{0} bytes: too long for an incident file")]
    TooLarge(u64),
    /// Another version of format or layout.
    #[error("written by {build} (format {format}, layout {layout}): replay it with that build")]
    Other {
        /// The build that wrote it.
        build: String,
        /// Its version of the format.
        format: u32,
        /// Its version of the layout.
        layout: String,
    },
    /// Plans for another catalogue of primitives or other time laws.
    #[error(
        "its nets use another catalogue of primitives or other time laws ({theirs}; this build has {ours}): replay it with the build that wrote it, {build}"
    )]
    OtherCatalogue {
        /// Fingerprint in the file.
        theirs: String,
        /// Fingerprint of this build.
        ours: String,
        /// The build that wrote it.
        build: String,
    },
    /// The checksum is wrong.
    #[error("wrong checksum: the file is damaged or was not copied completely")]
    Checksum,
    /// A part of it is invalid.
    #[error(transparent)]
    Damaged(#[from] DamagedFile),
}

/// The content of a file, except its head.
#[derive(Clone, Copy, Debug)]
pub struct IncidentParts<'a> {
    /// Command files by id, as the loader wrote them.
    pub files: &'a [(u64, &'a [u8])],
    /// The devices.
    pub models: &'a [DeviceModel],
    /// The nets by id.
    pub nets: &'a [(u64, &'a NetOrigin)],
    /// The recording.
    pub ring: &'a RecordRing,
}

/// An incident, read completely.
#[derive(Debug)]
pub struct Incident {
    /// Its head.
    pub head: IncidentHead,
    /// Command files by id.
    pub files: BTreeMap<u64, Vec<u8>>,
    /// The devices.
    pub models: Vec<DeviceModel>,
    /// The nets by id.
    pub nets: BTreeMap<u64, NetOrigin>,
    /// The records, as words.
    pub records: Vec<u64>,
    /// Fingerprint of the devices' configuration.
    pub configuration: u64,
}

/// Summary of the content of a ring.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RingOverview {
    /// Ids of the nets that were evaluated.
    pub nets: BTreeSet<u64>,
    /// First cycle; 0: none.
    pub first_cycle: u64,
    /// Last cycle; 0: none.
    pub last_cycle: u64,
}

/// Scans a ring that is no longer written.
pub fn overview(ring: &RecordRing) -> RingOverview {
    let [first, second] = ring.newest();
    let word = |at: usize| match first.get(at) {
        Some(word) => Some(*word),
        None => second.get(at - first.len()).copied(),
    };
    let (mut at, mut found) = (0, RingOverview::default());
    while let Some(head) = word(at) {
        let about = word(at + 1).unwrap_or(0);
        if entry::is_cycle(head) {
            found.last_cycle = about;
            if found.first_cycle == 0 {
                found.first_cycle = about;
            }
        } else if entry::is_of_net(head) {
            found.nets.insert(about);
        }
        at += 1 + (head >> 32) as usize;
    }
    found
}

/// The layout of this build, as in [`IncidentHead::layout`].
pub fn layout() -> String {
    String::from_utf8_lossy(&MAGIC.to_le_bytes()).into_owned()
}

/// Writes words and updates the checksum.
struct ChecksumWriter<W: Write> {
    out: BufWriter<W>,
    sum: WordChecksum,
}

impl<W: Write> ChecksumWriter<W> {
    fn words(&mut self, words: &[u64]) -> io::Result<()> {
        for word in words {
            self.sum.take(*word);
            self.out.write_all(&word.to_le_bytes())?;
        }
        Ok(())
    }

    /// Writes bytes, padded to whole words.
    fn bytes(&mut self, bytes: &[u8], filling: u8) -> io::Result<()> {
        for chunk in bytes.chunks(8) {
            let mut word = [filling; 8];
            for (place, byte) in word.iter_mut().zip(chunk) {
                *place = *byte;
            }
            self.words(&[u64::from_le_bytes(word)])?;
        }
        Ok(())
    }
}

/// Writes an incident; `head.files` and `head.nets` are set from `parts`.
///
/// # Errors
/// Returns the error of the output.
pub fn write(out: impl Write, mut head: IncidentHead, parts: &IncidentParts<'_>) -> io::Result<()> {
    head.files = parts
        .files
        .iter()
        .map(|(id, file)| (*id, file.len() as u64))
        .collect();
    head.nets = parts.nets.iter().map(|(id, _)| *id).collect();
    let mut out = ChecksumWriter {
        out: BufWriter::with_capacity(1 << 16, out),
        sum: WordChecksum::default(),
    };
    let text = serde_json::to_vec(&head)?;
    out.words(&[MARK, text.len() as u64])?;
    out.bytes(&text, b' ')?;
    for (_, file) in parts.files {
        out.bytes(file, 0)?;
    }
    out.words(&word_format::of_models(parts.models))?;
    for (_, origin) in parts.nets {
        out.words(&word_format::of_origin(origin))?;
    }
    let [first, second] = parts.ring.newest();
    out.words(&[(first.len() + second.len()) as u64])?;
    out.words(first)?;
    out.words(second)?;
    let sum = out.sum.end();
    out.words(&[sum])?;
    out.out.flush()
}

/// Reads the head of a file, and the command file of the net that triggered it, if there is one.
///
/// # Errors
/// Returns [`IncidentError`] if the file cannot be read or is not an incident.
pub fn read_head(path: &Path) -> Result<(IncidentHead, Option<Vec<u8>>), IncidentError> {
    let mut file = rcc_os::file::open(path)?;
    let mut start = [0; 16];
    file.read_exact(&mut start)
        .map_err(|_| IncidentError::NotAnIncident)?;
    let [mark, length] = bytemuck::cast::<_, [u64; 2]>(start).map(u64::from_le);
    if mark != MARK || length > HEAD_MAX {
        return Err(IncidentError::NotAnIncident);
    }
    let mut text = vec![0; length as usize];
    file.read_exact(&mut text)?;
    let head = parse_head(&text)?;
    let mut place = 16 + length.div_ceil(8) * 8;
    for (id, bytes) in &head.files {
        if head.net == Some(*id) && *bytes <= COMMAND_FILE_MAX as u64 {
            let mut command = vec![0; *bytes as usize];
            file.seek(SeekFrom::Start(place))?;
            file.read_exact(&mut command)?;
            return Ok((head, Some(command)));
        }
        place = place.saturating_add(bytes.div_ceil(8).saturating_mul(8));
    }
    Ok((head, None))
}

fn parse_head(text: &[u8]) -> Result<IncidentHead, IncidentError> {
    let head: IncidentHead = serde_json::from_slice(text).map_err(|_| DamagedFile("the head"))?;
    if head.format == FORMAT {
        return Ok(head);
    }
    let IncidentHead {
        build,
        format,
        layout,
        ..
    } = head;
    Err(IncidentError::Other {
        build,
        format,
        layout,
    })
}

impl Incident {
    /// Reads a complete file.
    ///
    /// # Errors
    /// Returns [`IncidentError`] if the file cannot be read, is not an incident, is damaged, or has nets that this
    /// build cannot evaluate.
    pub fn read(path: &Path) -> Result<Incident, IncidentError> {
        let mut file = rcc_os::file::open(path)?;
        let size = file.metadata()?.len();
        if size > FILE_MAX {
            return Err(IncidentError::TooLarge(size));
        }
        let mut words = vec![0; (size / 8) as usize];
        file.read_exact(bytemuck::cast_slice_mut(&mut words))?;
        for word in &mut words {
            *word = u64::from_le(*word);
        }
        if size % 8 != 0 && words.first() == Some(&MARK) {
            return Err(IncidentError::Checksum);
        }
        Incident::parse(&words)
    }

    /// Parses the words of a file.
    ///
    /// # Errors
    /// As [`Incident::read`].
    pub fn parse(all: &[u64]) -> Result<Incident, IncidentError> {
        let Some((sum, body)) = all.split_last() else {
            return Err(IncidentError::NotAnIncident);
        };
        if body.first() != Some(&MARK) {
            return Err(IncidentError::NotAnIncident);
        }
        let mut summed = WordChecksum::default();
        body.iter().for_each(|word| summed.take(*word));
        if summed.end() != *sum {
            return Err(IncidentError::Checksum);
        }
        let mut words = WordReader(body);
        let [_, length] = words.some("the head")?;
        let head = parse_head(&bytes(&mut words, length, "the head")?)?;
        let (theirs, ours) = (
            head.catalogue.clone(),
            hex_digits(primitives::fingerprint()),
        );
        let build = head.build.clone();
        if head.layout != layout() {
            let (format, layout) = (head.format, head.layout);
            return Err(IncidentError::Other {
                build,
                format,
                layout,
            });
        }
        if theirs != ours {
            return Err(IncidentError::OtherCatalogue {
                theirs,
                ours,
                build,
            });
        }
        let configuration = u64::from_str_radix(&head.configuration, 16);
        let configuration = configuration.map_err(|_| DamagedFile("the configuration's number"))?;
        let files = head.files.iter().map(|(id, length)| {
            let file = bytes(&mut words, *length, "a command file")?;
            Ok((*id, file))
        });
        let files = files.collect::<Result<_, DamagedFile>>()?;
        let models = word_format::models(&mut words)?;
        let nets = head
            .nets
            .iter()
            .map(|id| Ok((*id, word_format::origin(&mut words)?)));
        let nets = nets.collect::<Result<_, DamagedFile>>()?;
        let records = words.list("the records")?.to_vec();
        Ok(Incident {
            head,
            files,
            models,
            nets,
            records,
            configuration,
        })
    }
}

fn bytes(
    words: &mut WordReader<'_>,
    length: u64,
    what: &'static str,
) -> Result<Vec<u8>, DamagedFile> {
    let length = usize::try_from(length).map_err(|_| DamagedFile(what))?;
    let taken = words.take(length.div_ceil(8), what)?;
    let bytes = taken.iter().flat_map(|word| word.to_le_bytes());
    Ok(bytes.take(length).collect())
}
