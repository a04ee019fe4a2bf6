//! Reads recordings again: the tables of nets and devices, with the true names of their columns. A file may come from
//! anywhere, may be torn, and may have channels of others, which are skipped. Runs in any thread.

use std::collections::HashMap;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek};
use std::path::Path;

use mcap::McapError;
use mcap::io::MessageReader;

use crate::table::{TableLayout, TableRow};

/// Beginning of the names of message types made by [`crate::table`].
const OURS: &str = "rcc/msg/";

/// A table of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReadTable {
    /// Topic.
    pub topic: String,
    /// Net or device.
    pub name: String,
    /// Its columns.
    pub columns: Vec<ReadColumn>,
    layout: TableLayout,
}

/// A column of a table that is read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReadColumn {
    /// True name, such as `ik.joints`.
    pub name: String,
    /// Type, such as `Real[7]`; empty if unknown.
    pub type_name: String,
    /// Unit, if it has one.
    pub unit: Option<String>,
    /// Number of elements.
    pub width: usize,
}

/// The reason why a file cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The operating system refuses.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// Not an MCAP file.
    #[error("not an MCAP file")]
    NotMcap,
    /// Compressed, which this build cannot read.
    #[error(
        "compressed by {0}: write it again without compression, `mcap compress --compression none`"
    )]
    Compressed(String),
}

/// How a file ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReadEnd {
    /// With its index.
    Complete,
    /// In the middle, as after the death of its recorder; everything before was read.
    Torn,
}

/// Reads all rows of the tables of a file, in its order; `row` gets the table, its index, the time (ns since 1970) and the
/// elements.
///
/// # Errors
/// Fails if the file cannot be read or is not MCAP.
pub fn read(
    path: &Path,
    mut row: impl FnMut(&ReadTable, usize, u64, &TableRow),
) -> Result<ReadEnd, ReadError> {
    let mut file = BufReader::with_capacity(1 << 16, File::open(path)?);
    let mut magic = Vec::new();
    (&mut file)
        .take(mcap::MAGIC.len() as u64)
        .read_to_end(&mut magic)?;
    if magic != mcap::MAGIC {
        return Err(ReadError::NotMcap);
    }
    file.rewind()?;
    let mut tables: Vec<ReadTable> = Vec::new();
    // By number of the channel; `None` is a channel of another kind.
    let mut known: HashMap<u16, Option<usize>> = HashMap::new();
    for message in MessageReader::new(file) {
        let message = match message {
            Ok(message) => message,
            Err(McapError::Io(error)) if error.kind() != io::ErrorKind::UnexpectedEof => {
                return Err(error.into());
            }
            Err(McapError::UnsupportedCompression(kind)) => {
                return Err(ReadError::Compressed(kind));
            }
            Err(_) => return Ok(ReadEnd::Torn),
        };
        let channel = &message.channel;
        let index = known.entry(channel.id).or_insert_with(|| {
            let table = table_of(channel)?;
            tables.push(table);
            Some(tables.len() - 1)
        });
        let Some((index, table)) = index.and_then(|index| Some((index, tables.get(index)?))) else {
            continue;
        };
        if let Some(found) = table.layout.decode(&message.data) {
            row(table, index, message.log_time, &found);
        }
    }
    Ok(ReadEnd::Complete)
}

fn table_of(channel: &mcap::Channel<'_>) -> Option<ReadTable> {
    let schema = channel.schema.as_ref()?;
    if !schema.name.starts_with(OURS) || channel.message_encoding != "cdr" {
        return None;
    }
    let layout = TableLayout::parse(std::str::from_utf8(&schema.data).ok()?)?;
    let about = |key: &str, field: &str| channel.metadata.get(&format!("{key}.{field}")).cloned();
    let columns = layout.fields().map(|(field, width)| ReadColumn {
        name: about("name", field).unwrap_or_else(|| field.to_owned()),
        type_name: about("type", field).unwrap_or_default(),
        unit: about("unit", field),
        width,
    });
    let name = channel
        .metadata
        .get("net")
        .or(channel.metadata.get("device"));
    Some(ReadTable {
        topic: channel.topic.clone(),
        name: name.cloned().unwrap_or_else(|| channel.topic.clone()),
        columns: columns.collect(),
        layout,
    })
}

impl ReadTable {
    /// Returns the full names of all elements: `line/ik.joints[2]`.
    #[must_use]
    pub fn elements(&self) -> Vec<String> {
        let names = self.columns.iter().flat_map(|column| {
            let name = format!("{}/{}", self.name, column.name);
            (0..column.width).map(move |element| match column.width {
                1 => name.clone(),
                _ => format!("{name}[{element}]"),
            })
        });
        names.collect()
    }
}
