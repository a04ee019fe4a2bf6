//! Settings of the flight recorder and of the state folder: recorded time, memory, and what is kept; by default 10 s,
//! 64 MB of memory, and at most 16 incident files and 200 MB in the user's state folder. Read at start-up.

use std::path::{Path, PathBuf};

use rcc_core::unit::Unit;

use crate::codes;
use crate::reader::{ConfigReader, Fields, QuantityRange, error};
use crate::yaml::{Entry, Node, Value};

pub(crate) const KEYS: [&str; 5] = ["seconds", "memory", "files", "folder", "keep"];
const SECONDS: [f64; 2] = [1.0, 600.0];
const MEMORY_MB: [u64; 2] = [1, 4096];
const KEEP_MB: [u64; 2] = [1, 1 << 20];
const FILES: [i64; 2] = [1, 1000];
const MB: u64 = 1 << 20;

/// Settings of the flight recorder of a cell.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecorderConfig {
    /// Maximum time that is kept before an incident, ns.
    pub span_ns: u64,
    /// Locked memory, bytes; 0: nothing is recorded. One half records while the other is written to a file.
    pub memory: usize,
    /// Maximum number of incident files; the oldest is removed.
    pub files: usize,
    /// Folder of event log, incident files and logs, with one folder for each cell in it; `None`: the state folder of
    /// the user.
    pub folder: Option<PathBuf>,
    /// Maximum size of all of them, bytes; the oldest are removed. By default 200 MB, or `memory` if that is more; never
    /// less than `memory`.
    pub keep: u64,
}

impl Default for RecorderConfig {
    fn default() -> Self {
        RecorderConfig {
            span_ns: 10_000_000_000,
            memory: 64 << 20,
            files: 16,
            folder: None,
            keep: 200 * MB,
        }
    }
}

/// Reads the key `recorder` of a cell; relative paths start at `base`.
pub(crate) fn read(
    reader: &mut ConfigReader,
    cell: &Fields<'_>,
    base: &Path,
) -> Option<RecorderConfig> {
    let mut recorder = RecorderConfig::default();
    let Some(Entry { key, value }) = cell.entry("recorder") else {
        return Some(recorder);
    };
    let fields = reader.fields(value, key.span, "the recorder", &KEYS)?;
    // Read all keys before returning, so that all faults are reported together.
    let mut valid = true;
    if let Some(node) = fields.get("seconds") {
        let [least, most] = SECONDS;
        let wanted = QuantityRange {
            unit: Unit::ONE,
            least,
            most,
        };
        let seconds = reader.quantity(node, "seconds", wanted);
        valid &= seconds.is_some();
        recorder.span_ns = seconds.map_or(0, |seconds| (seconds * 1e9).round() as u64);
    }
    if let Some(node) = fields.get("memory") {
        let memory = size(reader, node, "memory", MEMORY_MB);
        valid &= memory.is_some();
        recorder.memory = memory
            .and_then(|memory| memory.try_into().ok())
            .unwrap_or(0);
    }
    if let Some(node) = fields.get("files") {
        let [least, most] = FILES;
        let files = reader.integer(node, "files", least, most);
        valid &= files.is_some();
        recorder.files = files.map_or(0, |files| usize::try_from(files).unwrap_or(0));
    }
    if let Some(node) = fields.get("folder") {
        let folder = reader.text(node, "folder");
        valid &= folder.is_some();
        recorder.folder = folder.map(|folder| base.join(folder));
    }
    let memory = recorder.memory as u64;
    match fields.get("keep") {
        None => recorder.keep = recorder.keep.max(memory),
        Some(node) => match size(reader, node, "keep", KEEP_MB) {
            Some(keep) if keep < memory => {
                let message = format!(
                    "keep is {} MB, but must be at least `memory`, {} MB: an incident file may have half of that",
                    keep / MB,
                    memory / MB
                );
                reader.report(error(codes::OUT_OF_RANGE, node.span, message));
                valid = false;
            }
            keep => {
                valid &= keep.is_some();
                recorder.keep = keep.unwrap_or(recorder.keep);
            }
        },
    }
    valid.then_some(recorder)
}

/// Reads a size in bytes from `64 MB` or `2 GB`. `memory` may be 0.
fn size(
    reader: &mut ConfigReader,
    node: &Node,
    name: &str,
    [least, most]: [u64; 2],
) -> Option<u64> {
    let number = match &node.value {
        Value::Text(text) => [("MB", 1), ("GB", 1024)].iter().find_map(|(unit, factor)| {
            let number = text.strip_suffix(unit)?.trim_end().parse::<u64>().ok()?;
            number.checked_mul(*factor)
        }),
        Value::Int(0) => Some(0),
        _ => None,
    };
    let Some(number) = number else {
        reader.wrong_type(node, name, "whole megabytes or gigabytes (`64 MB`, `2 GB`)");
        return None;
    };
    let none = name == "memory";
    if !((least..=most).contains(&number) || none && number == 0) {
        let or_none = if none { ", or 0 MB for none" } else { "" };
        let message =
            format!("{name} is {number} MB, but must be from {least} MB to {most} MB{or_none}");
        reader.report(error(codes::OUT_OF_RANGE, node.span, message));
        return None;
    }
    number.checked_mul(MB)
}
