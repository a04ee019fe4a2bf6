//! Settings of the flight recorder: recorded time, memory and incident files; by default 10 s, 64 MB and the runtime
//! folder. Read at start-up by the executor.

use std::path::{Path, PathBuf};

use rcc_core::unit::Unit;

use crate::codes;
use crate::reader::{ConfigReader, Fields, QuantityRange, error};
use crate::yaml::{Entry, Node, Value};

pub(crate) const KEYS: [&str; 4] = ["seconds", "memory", "files", "folder"];
const SECONDS: [f64; 2] = [1.0, 600.0];
const MEMORY_MB: [i64; 2] = [1, 4096];
const FILES: [i64; 2] = [1, 1000];
const MB: usize = 1 << 20;

/// Settings of the flight recorder of a cell.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecorderConfig {
    /// Maximum time that is kept before an incident, ns.
    pub span_ns: u64,
    /// Locked memory, bytes; 0: nothing is recorded. One half records while the other is written to a file.
    pub memory: usize,
    /// Maximum number of incident files; the oldest is removed.
    pub files: usize,
    /// Folder of the incident files; `None`: the runtime folder of the cell, which an orderly end removes.
    pub folder: Option<PathBuf>,
}

impl Default for RecorderConfig {
    fn default() -> Self {
        RecorderConfig {
            span_ns: 10_000_000_000,
            memory: 64 * MB,
            files: 16,
            folder: None,
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
        let memory = memory(reader, node);
        valid &= memory.is_some();
        recorder.memory = memory.unwrap_or(0);
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
    valid.then_some(recorder)
}

/// Reads `64 MB`, or `0 MB`.
fn memory(reader: &mut ConfigReader, node: &Node) -> Option<usize> {
    let number = match &node.value {
        Value::Text(text) => text.strip_suffix("MB").map(str::trim_end),
        Value::Int(0) => Some("0"),
        _ => None,
    };
    let Some(number) = number.and_then(|number| number.parse::<i64>().ok()) else {
        reader.wrong_type(node, "memory", "whole megabytes (`64 MB`)");
        return None;
    };
    let [least, most] = MEMORY_MB;
    if number != 0 && !(least..=most).contains(&number) {
        let message = format!(
            "memory is {number} MB, but must be from {least} MB to {most} MB, or 0 MB for none"
        );
        reader.report(error(codes::OUT_OF_RANGE, node.span, message));
        return None;
    }
    Some(usize::try_from(number).ok()? * MB)
}
