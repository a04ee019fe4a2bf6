//! A benchmark graph as read from its file: nodes, sinks and expected results. It does not depend on nets, so that a
//! build script can translate the same graph to code. Any thread.

use std::collections::BTreeMap;

use serde::Deserialize;

/// The mixes of operations.
pub const MIXES: [&str; 3] = ["scalar", "mat", "full"];
/// The numbers of nodes.
pub const SIZES: [usize; 4] = [50, 500, 2000, 10_000];
/// The word that represents a null number or transform in hashes.
pub const NULL_WORD: u64 = 0x7ff8_0000_0000_1eaf;

/// A graph.
#[derive(Clone, Debug, Deserialize)]
pub struct Graph {
    /// One of [`MIXES`].
    pub mix: String,
    /// The nodes in the order of evaluation; a node's index is its id.
    pub nodes: Vec<GraphNode>,
    /// The nodes without a reader, in the order of the hash.
    pub sinks: Vec<usize>,
    /// Expected results by cycle, counted from 1.
    pub expected: BTreeMap<u64, ExpectedResults>,
}

/// The expected results of a cycle.
#[derive(Clone, Debug, Deserialize)]
pub struct ExpectedResults {
    /// Hash of the sinks, hexadecimal.
    pub sinks_hash: String,
    /// Results of some nodes by index; `None` is null.
    pub values: BTreeMap<usize, Option<NodeValue>>,
}

/// The result of a node.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum NodeValue {
    /// A truth value.
    Bool(bool),
    /// An integer.
    Int(i64),
    /// A real number.
    Real(f64),
    /// A transform, row-major.
    Transform([f64; 16]),
}

/// A node.
#[derive(Clone, Debug, Deserialize)]
pub struct GraphNode {
    /// Operation.
    pub op: Op,
    /// Sources of its inputs.
    #[serde(rename = "in")]
    pub inputs: Vec<NodeInput>,
    /// Constants.
    pub params: Vec<NodeValue>,
}

/// The source of an input.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(from = "(SourceKind, NodeValue)")]
pub enum NodeInput {
    /// The output of a node.
    Node(usize),
    /// A constant.
    Constant(NodeValue),
    /// An external number, by index.
    Real(usize),
    /// An external truth value, by index.
    Bool(usize),
}

/// The letter of a source in the file.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "lowercase")]
enum SourceKind {
    N,
    K,
    U,
    V,
}

impl From<(SourceKind, NodeValue)> for NodeInput {
    fn from((kind, value): (SourceKind, NodeValue)) -> NodeInput {
        let index = match value {
            NodeValue::Int(index) => usize::try_from(index).unwrap_or(usize::MAX),
            _ => usize::MAX,
        };
        match kind {
            SourceKind::N => NodeInput::Node(index),
            SourceKind::K => NodeInput::Constant(value),
            SourceKind::U => NodeInput::Real(index),
            SourceKind::V => NodeInput::Bool(index),
        }
    }
}

/// The operations; `graphs/README.md` defines them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
#[allow(missing_docs)] // One table, not twice.
pub enum Op {
    Add,
    Sub,
    Mul,
    Min,
    Max,
    Abs,
    Neg,
    Sqrt,
    Div,
    Limit,
    Select,
    Lowpass,
    Delay,
    I2r,
    Mget,
    Nullif,
    Dflt,
    Gt,
    Lt,
    And,
    Or,
    Not,
    Xor,
    Edge,
    Isnull,
    Igt,
    Iadd,
    Iand,
    Count,
    Mkframe,
    Mmul,
    Minv,
}

impl Graph {
    /// Parses the text of a graph.
    ///
    /// # Errors
    /// Returns an error if the text is not a graph.
    pub fn read(text: &str) -> Result<Graph, serde_json::Error> {
        serde_json::from_str(text)
    }

    /// Loads the graph of a mix and size from this package.
    ///
    /// # Errors
    /// Returns an error if there is no such graph or its file is damaged.
    pub fn load(mix: &str, size: usize) -> Result<Graph, LoadError> {
        let path = format!("{}/graphs/{mix}_{size}.json", env!("CARGO_MANIFEST_DIR"));
        let text = std::fs::read_to_string(&path);
        let text = text.map_err(|source| LoadError::File {
            path: path.clone(),
            source,
        })?;
        Graph::read(&text).map_err(|source| LoadError::Content { path, source })
    }
}

/// The reason why a graph cannot be loaded.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// The file cannot be read.
    #[error("{path}: {source}; graphs are {MIXES:?} of {SIZES:?} nodes")]
    File {
        /// The file.
        path: String,
        /// The cause.
        source: std::io::Error,
    },
    /// The file is not a graph.
    #[error("{path} is not a graph: {source}")]
    Content {
        /// The file.
        path: String,
        /// The cause.
        source: serde_json::Error,
    },
}

/// Returns external number `k` in a cycle, counted from 1.
#[must_use]
#[allow(clippy::cast_precision_loss)] // Below 1000.
pub fn external_real(cycle: u64, k: usize) -> f64 {
    ((cycle * (2 * k as u64 + 3)) % 1000) as f64 / 500.0 - 1.0
}

/// Returns external truth value `k` in a cycle, counted from 1.
#[must_use]
pub fn external_bool(cycle: u64, k: usize) -> bool {
    cycle >> k & 1 == 1
}

/// FNV-1a over 64-bit words.
#[derive(Clone, Copy, Debug)]
pub struct SinkHash(u64);

impl Default for SinkHash {
    fn default() -> SinkHash {
        SinkHash(0xcbf2_9ce4_8422_2325)
    }
}

impl SinkHash {
    /// Adds a word.
    pub fn word(&mut self, word: u64) {
        self.0 = (self.0 ^ word).wrapping_mul(0x100_0000_01b3);
    }

    /// Adds a number that may be null.
    pub fn real(&mut self, value: f64) {
        self.word(if value.is_nan() {
            NULL_WORD
        } else {
            value.to_bits()
        });
    }

    /// Returns the hash in hexadecimal, as the files contain it.
    #[must_use]
    pub fn hex(self) -> String {
        format!("{:016x}", self.0)
    }
}
