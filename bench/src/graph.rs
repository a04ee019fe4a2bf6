//! A benchmark graph as its file says it: nodes, sinks and expected results. Knows nothing of nets, so that a build step
//! can use it to write the same graph as code. Any thread.

use std::collections::BTreeMap;

use serde::Deserialize;

/// The kinds of graphs.
pub const MIXES: [&str; 3] = ["scalar", "mat", "full"];
/// The numbers of nodes.
pub const SIZES: [usize; 4] = [50, 500, 2000, 10_000];
/// The word that stands for a null number or transform in hashes.
pub const NULL_WORD: u64 = 0x7ff8_0000_0000_1eaf;

/// A graph.
#[derive(Clone, Debug, Deserialize)]
pub struct Graph {
    /// One of [`MIXES`].
    pub mix: String,
    /// In the order of evaluation; the place of a node is its id.
    pub nodes: Vec<GraphNode>,
    /// The nodes that nobody reads, in the order of the hash.
    pub sinks: Vec<usize>,
    /// By cycle, counted from 1.
    pub expected: BTreeMap<u64, ExpectedResults>,
}

/// What a cycle must come to.
#[derive(Clone, Debug, Deserialize)]
pub struct ExpectedResults {
    /// Hash of the sinks, hexadecimal.
    pub sinks_hash: String,
    /// Results of some nodes; `None` is null.
    pub values: BTreeMap<usize, Option<NodeValue>>,
}

/// A result.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum NodeValue {
    /// Of a condition.
    Bool(bool),
    /// Of a node that counts.
    Int(i64),
    /// Of a node that computes.
    Real(f64),
    /// A transform, row-major.
    Transform([f64; 16]),
}

/// A node.
#[derive(Clone, Debug, Deserialize)]
pub struct GraphNode {
    /// What it does.
    pub op: Op,
    /// What it reads.
    #[serde(rename = "in")]
    pub inputs: Vec<NodeInput>,
    /// Its constants.
    pub params: Vec<NodeValue>,
}

/// What feeds an input.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(from = "(Kind, Value)")]
pub enum NodeInput {
    /// The output of a node.
    Node(usize),
    /// A constant.
    Constant(NodeValue),
    /// An external number.
    Real(usize),
    /// An external truth value.
    Bool(usize),
}

/// The letter of a source in a file.
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

/// The operations; `graphs/README.md` says what they do.
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
    /// Reads a file.
    ///
    /// # Errors
    /// It is no graph.
    pub fn read(text: &str) -> Result<Graph, serde_json::Error> {
        serde_json::from_str(text)
    }

    /// The graph of a mix and size of this package.
    ///
    /// # Errors
    /// There is none, or its file was damaged.
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

/// Why there is no graph.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// The file cannot be read.
    #[error("{path}: {source}; graphs are {MIXES:?} of {SIZES:?} nodes")]
    File {
        /// The file.
        path: String,
        /// Why.
        source: std::io::Error,
    },
    /// The file is no graph.
    #[error("{path} is no graph: {source}")]
    Content {
        /// The file.
        path: String,
        /// Why.
        source: serde_json::Error,
    },
}

/// External number `k` in a cycle, counted from 1.
#[must_use]
#[allow(clippy::cast_precision_loss)] // Below 1000.
pub fn external_real(cycle: u64, k: usize) -> f64 {
    ((cycle * (2 * k as u64 + 3)) % 1000) as f64 / 500.0 - 1.0
}

/// External truth value `k` in a cycle.
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

    /// The hash, as files write it.
    #[must_use]
    pub fn hex(self) -> String {
        format!("{:016x}", self.0)
    }
}
