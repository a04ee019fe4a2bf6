//! The standard layout of a tree as text: on one line if it fits, else one entry per line in aligned columns, with each
//! comment at its entry. Used by writers and by `rcc-cli fmt`, never on the real-time thread.

mod writer;

use super::{Node, Value, scalar};

pub use writer::render;

/// Maximum length of a line, characters; trailing comments do not count.
pub const WIDTH: usize = 120;

/// A tree to be laid out.
#[derive(Clone, Debug, PartialEq)]
pub enum Tree {
    /// A number, boolean or null, in its final notation.
    Plain(String),
    /// A text.
    Text(String),
    /// A list; its entries have no keys.
    List(TreeBlock),
    /// A mapping.
    Map(TreeBlock),
}

/// The entries of a list or mapping.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TreeBlock {
    /// The entries.
    pub entries: Vec<TreeEntry>,
    /// Comments after the last entry.
    pub tail: Vec<CommentLine>,
    /// Forces one entry per line even if all fit on one line.
    pub open: bool,
    /// Aligns adjacent one-line mappings in the same column.
    pub aligned: bool,
}

/// An entry with the comments around it.
#[derive(Clone, Debug, PartialEq)]
pub struct TreeEntry {
    /// The key; empty in a list.
    pub key: String,
    /// The value.
    pub value: Tree,
    /// Comments on separate lines before it.
    pub before: Vec<CommentLine>,
    /// True if an empty line precedes the entry.
    pub blank: bool,
    /// Comment between the key and a value that begins on the next line, with its `#`.
    pub head: Option<String>,
    /// Trailing comment on the same line, with its `#`.
    pub after: Option<String>,
}

/// A comment on a separate line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CommentLine {
    /// The comment with its `#`.
    pub text: String,
    /// True if an empty line precedes it.
    pub blank: bool,
}

impl TreeEntry {
    /// Creates an entry without comments.
    #[must_use]
    pub fn new(key: impl Into<String>, value: Tree) -> TreeEntry {
        TreeEntry {
            key: key.into(),
            value,
            before: Vec::new(),
            blank: false,
            head: None,
            after: None,
        }
    }

    /// Returns the comment that trails the entry or its key.
    fn behind(&self) -> Option<&String> {
        self.after.as_ref().or(self.head.as_ref())
    }

    fn has_notes(&self) -> bool {
        !self.before.is_empty()
            || self.head.is_some()
            || self.after.is_some()
            || self.value.has_notes()
    }
}

impl TreeBlock {
    /// Creates a block without comments.
    #[must_use]
    pub fn new(entries: Vec<TreeEntry>) -> TreeBlock {
        TreeBlock {
            entries,
            ..TreeBlock::default()
        }
    }
}

impl Tree {
    /// Creates a mapping without comments.
    pub fn map(entries: impl IntoIterator<Item = (String, Tree)>) -> Tree {
        let entries = entries.into_iter();
        Tree::Map(TreeBlock::new(
            entries
                .map(|(key, value)| TreeEntry::new(key, value))
                .collect(),
        ))
    }

    /// Creates a list without comments.
    pub fn list(values: impl IntoIterator<Item = Tree>) -> Tree {
        let values = values.into_iter();
        Tree::List(TreeBlock::new(
            values.map(|value| TreeEntry::new("", value)).collect(),
        ))
    }

    /// Converts a parsed value to its standard notation.
    #[must_use]
    pub fn of(node: &Node) -> Tree {
        match &node.value {
            Value::Null => Tree::Plain("null".to_string()),
            Value::Bool(value) => Tree::Plain(value.to_string()),
            Value::Int(value) => Tree::Plain(value.to_string()),
            Value::Real(value) => Tree::Plain(scalar::real(*value)),
            Value::Text(text) => Tree::Text(text.to_string()),
            Value::List(nodes) => Tree::list(nodes.iter().map(Tree::of)),
            Value::Map(entries) => Tree::map(
                entries
                    .iter()
                    .map(|entry| (entry.key.name.to_string(), Tree::of(&entry.value))),
            ),
        }
    }

    /// Returns the entries of a list or mapping.
    #[must_use]
    pub fn block(&self) -> Option<&TreeBlock> {
        match self {
            Tree::List(block) | Tree::Map(block) => Some(block),
            _ => None,
        }
    }

    /// Returns the entries of a list or mapping.
    pub fn block_mut(&mut self) -> Option<&mut TreeBlock> {
        match self {
            Tree::List(block) | Tree::Map(block) => Some(block),
            _ => None,
        }
    }

    fn has_notes(&self) -> bool {
        self.block().is_some_and(|block| {
            !block.tail.is_empty() || block.entries.iter().any(TreeEntry::has_notes)
        })
    }

    /// Returns the tree on one line of at most `room` characters, if it fits and nothing in it requires several lines.
    #[must_use]
    pub fn on_one_line(&self, room: usize) -> Option<String> {
        let mut line = String::new();
        (self.flow(&mut line, room) && line.chars().count() <= room).then_some(line)
    }

    /// Like [`Tree::on_one_line`], for a value outside of all brackets.
    fn on_its_line(&self, room: usize) -> Option<String> {
        match self {
            Tree::Text(text) => {
                Some(scalar::line(text).into_owned()).filter(|line| line.chars().count() <= room)
            }
            other => other.on_one_line(room),
        }
    }

    /// Appends the tree in flow notation; returns false as soon as it cannot fit on one line of `room` characters.
    fn flow(&self, line: &mut String, room: usize) -> bool {
        // A character takes one to four bytes.
        if line.len() > room.saturating_mul(4) {
            return false;
        }
        let (block, [open, close]) = match self {
            Tree::Plain(text) => {
                line.push_str(text);
                return true;
            }
            Tree::Text(text) => {
                line.push_str(&scalar::text(text));
                return true;
            }
            Tree::List(block) => (block, ['[', ']']),
            Tree::Map(block) => (block, ['{', '}']),
        };
        if (block.open && !block.entries.is_empty()) || !block.tail.is_empty() {
            return false;
        }
        line.push(open);
        for (index, entry) in block.entries.iter().enumerate() {
            if !entry.before.is_empty() || entry.head.is_some() || entry.after.is_some() {
                return false;
            }
            if index > 0 {
                line.push_str(", ");
            }
            if open == '{' {
                line.push_str(&scalar::key(&entry.key));
                line.push_str(": ");
            }
            if !entry.value.flow(line, room) {
                return false;
            }
        }
        line.push(close);
        true
    }

    /// Returns the tree as JSON on one line.
    #[must_use]
    pub fn to_json(&self) -> String {
        let mut text = String::new();
        self.json(&mut text);
        text
    }

    fn json(&self, text: &mut String) {
        let (block, [open, close]) = match self {
            Tree::Plain(plain) => return text.push_str(plain),
            Tree::Text(value) => return text.push_str(&scalar::json(value)),
            Tree::List(block) => (block, ['[', ']']),
            Tree::Map(block) => (block, ['{', '}']),
        };
        text.push(open);
        for (index, entry) in block.entries.iter().enumerate() {
            if index > 0 {
                text.push_str(", ");
            }
            if open == '{' {
                text.push_str(&scalar::json(&entry.key));
                text.push_str(": ");
            }
            entry.value.json(text);
        }
        text.push(close);
    }
}
