//! The standard layout of a tree as text: on one line if it fits, else one entry per line in aligned columns, with each
//! comment at its entry. Used by writers and by `rcc-cli fmt`, never on the real-time thread.

use super::{Node, Value, scalar};

/// Maximum length of a line, characters; trailing comments do not count.
pub const WIDTH: usize = 120;
/// Indentation per level, spaces.
const STEP: usize = 2;

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
            Value::Text(text) => Tree::Text(text.clone()),
            Value::List(nodes) => Tree::list(nodes.iter().map(Tree::of)),
            Value::Map(entries) => Tree::map(
                entries
                    .iter()
                    .map(|entry| (entry.key.name.clone(), Tree::of(&entry.value))),
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

/// Lays out a whole document.
#[must_use]
pub fn render(tree: &Tree) -> String {
    let mut writer = LayoutWriter {
        text: String::new(),
    };
    match tree {
        Tree::Map(block) if !block.entries.is_empty() => writer.map(block, 0),
        Tree::List(block) if !block.entries.is_empty() => writer.list(block, 0),
        other => {
            writer.text = other.on_one_line(usize::MAX).unwrap_or_default();
            writer.text.push('\n');
            writer.notes(other.block().map_or(&[], |block| &block.tail), 0);
        }
    }
    writer.text
}

/// A formatted entry of a mapping.
enum EntryLine {
    /// On one line: key, value, and whether it takes part in column alignment.
    Short {
        key: String,
        value: String,
        column: bool,
    },
    /// On several lines.
    Long,
}

struct LayoutWriter {
    text: String,
}

impl LayoutWriter {
    fn indent(&mut self, depth: usize) {
        self.text.extend(std::iter::repeat_n(' ', depth));
    }

    fn notes(&mut self, notes: &[CommentLine], depth: usize) {
        for note in notes {
            self.blank_if(note.blank);
            self.indent(depth);
            self.text.push_str(&note.text);
            self.text.push('\n');
        }
    }

    fn blank_if(&mut self, blank: bool) {
        if blank && !self.text.is_empty() {
            self.text.push('\n');
        }
    }

    /// Writes the comment lines before an entry, and its head comment if a trailing comment takes its place.
    fn before(&mut self, entry: &TreeEntry, depth: usize) {
        self.notes(&entry.before, depth);
        self.blank_if(entry.blank);
        if let (Some(head), Some(_)) = (&entry.head, &entry.after) {
            self.indent(depth);
            self.text.push_str(head);
            self.text.push('\n');
        }
    }

    fn map(&mut self, block: &TreeBlock, depth: usize) {
        let lines: Vec<EntryLine> = block
            .entries
            .iter()
            .map(|entry| short(entry, block, depth))
            .collect();
        let columns = columns(&block.entries, &lines, depth);
        let comments = comment_columns(&block.entries, &lines, &columns);
        for (index, (entry, line)) in block.entries.iter().zip(&lines).enumerate() {
            match line {
                EntryLine::Long => {
                    self.before(entry, depth);
                    self.indent(depth);
                    self.text.push_str(&scalar::key(&entry.key));
                    self.text.push(':');
                    self.long(entry, depth);
                }
                EntryLine::Short { key, value, .. } => {
                    self.before(entry, depth);
                    self.indent(depth);
                    let start = self.text.len();
                    self.text.push_str(key);
                    self.text.push(':');
                    let written = key.chars().count() + 1;
                    let column = columns.get(index).copied().unwrap_or(0).max(written + 1);
                    self.indent(column - written);
                    self.text.push_str(value);
                    if let Some(comment) = entry.behind() {
                        let written = self.text[start..].chars().count();
                        let column = comments.get(index).copied().unwrap_or(0).max(written + 2);
                        self.indent(column - written);
                        self.text.push_str(comment);
                    }
                    self.text.push('\n');
                }
            }
        }
        self.notes(&block.tail, depth);
    }

    /// Writes a value that does not fit on its line; the text so far ends with the `:` of its key or the `-`.
    fn long(&mut self, entry: &TreeEntry, depth: usize) {
        match &entry.value {
            Tree::Text(text) => self.long_text(entry, text, depth),
            Tree::List(block) if is_filled(block) => {
                self.fill(block, depth);
                self.comment(entry.behind());
            }
            Tree::List(block) | Tree::Map(block) => {
                self.comment(entry.behind());
                match &entry.value {
                    Tree::List(_) => self.list(block, depth + STEP),
                    _ => self.map(block, depth + STEP),
                }
            }
            Tree::Plain(text) => {
                self.text.push(' ');
                self.text.push_str(text);
                self.comment(entry.behind());
            }
        }
    }

    /// Ends the line, with a comment if given.
    fn comment(&mut self, comment: Option<&String>) {
        if let Some(comment) = comment {
            self.text.push_str("  ");
            self.text.push_str(comment);
        }
        self.text.push('\n');
    }

    /// Writes a text of several lines, or one that is too long for a line.
    fn long_text(&mut self, entry: &TreeEntry, text: &str, depth: usize) {
        let comment = entry.behind();
        let Some(style) = TextStyle::of(text) else {
            self.text.push(' ');
            self.text.push_str(&scalar::line(text));
            return self.comment(comment);
        };
        self.text.push_str(match style {
            TextStyle::Folded => " >-",
            TextStyle::Lines { ended: true } => " |",
            TextStyle::Lines { ended: false } => " |-",
        });
        self.comment(comment);
        match style {
            TextStyle::Lines { .. } => {
                for line in text.lines() {
                    if !line.is_empty() {
                        self.indent(depth + STEP);
                    }
                    self.text.push_str(line);
                    self.text.push('\n');
                }
            }
            TextStyle::Folded => {
                self.words(text.split(' ').map(str::to_string), depth + STEP, "");
                self.text.push('\n');
            }
        }
    }

    /// Writes words separated by spaces, on as many lines as needed.
    fn words(&mut self, words: impl Iterator<Item = String>, depth: usize, open: &str) {
        let mut column = if open.is_empty() {
            self.indent(depth);
            depth
        } else {
            let line = self.text.rsplit('\n').next().unwrap_or_default();
            let column = line.chars().count() + open.chars().count();
            self.text.push_str(open);
            column
        };
        let mut first = true;
        for word in words {
            let length = word.chars().count();
            if !first && column + 1 + length > WIDTH {
                self.text.push('\n');
                self.indent(depth);
                column = depth;
            } else if !first {
                self.text.push(' ');
                column += 1;
            }
            self.text.push_str(&word);
            column += length;
            first = false;
        }
    }

    /// Writes a list of scalars in brackets on several lines.
    fn fill(&mut self, block: &TreeBlock, depth: usize) {
        let last = block.entries.len().saturating_sub(1);
        let words = block.entries.iter().enumerate().map(|(index, entry)| {
            let mut word = entry.value.on_one_line(usize::MAX).unwrap_or_default();
            word.push(if index == last { ']' } else { ',' });
            word
        });
        self.words(words, depth + STEP, " [");
    }

    fn list(&mut self, block: &TreeBlock, depth: usize) {
        for entry in &block.entries {
            let room = WIDTH.saturating_sub(depth + 2);
            let line = entry
                .value
                .on_its_line(room)
                .or_else(|| unbreakable(&entry.value));
            self.before(entry, depth);
            self.indent(depth);
            self.text.push('-');
            match (line, &entry.value) {
                (Some(line), _) => {
                    self.text.push(' ');
                    self.text.push_str(&line);
                    self.comment(entry.behind());
                }
                (None, Tree::Map(inner)) if starts_on_the_dash(entry, inner) => {
                    // Write the map at its final indentation, then replace the first indentation by the space after the
                    // dash.
                    let start = self.text.len();
                    self.map(inner, depth + STEP);
                    self.text.replace_range(start..start + depth + STEP, " ");
                }
                (None, _) => self.long(entry, depth),
            }
        }
        self.notes(&block.tail, depth);
    }
}

fn starts_on_the_dash(entry: &TreeEntry, inner: &TreeBlock) -> bool {
    let first = inner.entries.first();
    entry.head.is_none()
        && entry.after.is_none()
        && first.is_some_and(|first| {
            let demoted = first.head.is_some() && first.after.is_some();
            first.before.is_empty() && !first.blank && !demoted
        })
}

/// Notation of a long text.
#[derive(Clone, Copy)]
enum TextStyle {
    /// One paragraph, wrapped at spaces (`>-`).
    Folded,
    /// Line by line, with or without a line end after the last one (`|`, `|-`).
    Lines { ended: bool },
}

impl TextStyle {
    /// Returns `None` if the text would not read back identically; it is then quoted.
    fn of(text: &str) -> Option<TextStyle> {
        let line_is_good = |line: &str| {
            line.chars().all(scalar::is_printed)
                && !line.starts_with(char::is_whitespace)
                && !line.ends_with(char::is_whitespace)
        };
        if !text.lines().all(line_is_good) || text.is_empty() || text.contains('\r') {
            return None;
        }
        if !text.contains('\n') {
            return (!text.contains("  ")).then_some(TextStyle::Folded);
        }
        let ended = text.ends_with('\n');
        let empty_edge = text.starts_with('\n') || text.ends_with("\n\n");
        (!empty_edge).then_some(TextStyle::Lines { ended })
    }
}

/// Returns true for a list that is wrapped like words: scalars without comments.
fn is_filled(block: &TreeBlock) -> bool {
    let scalar = |entry: &TreeEntry| entry.value.block().is_none() && !entry.has_notes();
    block.tail.is_empty() && !block.entries.is_empty() && block.entries.iter().all(scalar)
}

/// Returns an indivisible value on one line, however long that is.
fn unbreakable(value: &Tree) -> Option<String> {
    let divides = match value {
        Tree::Plain(_) => false,
        Tree::Text(text) => TextStyle::of(text).is_some(),
        Tree::List(block) | Tree::Map(block) => !block.entries.is_empty() || !block.tail.is_empty(),
    };
    if divides {
        None
    } else {
        value.on_its_line(usize::MAX)
    }
}

fn short(entry: &TreeEntry, block: &TreeBlock, depth: usize) -> EntryLine {
    let key = scalar::key(&entry.key).into_owned();
    let room = WIDTH.saturating_sub(depth + key.chars().count() + 2);
    let one_line = match &entry.value {
        // A text of several lines keeps its lines.
        Tree::Text(text) if text.contains('\n') => None,
        value => value.on_its_line(room),
    };
    match one_line.or_else(|| unbreakable(&entry.value)) {
        Some(value) => EntryLine::Short {
            key,
            value,
            column: block.aligned && matches!(entry.value, Tree::Map(_)),
        },
        None => EntryLine::Long,
    }
}

/// Returns the column of each entry's value, counted from its key; 0 if it is not aligned.
fn columns(entries: &[TreeEntry], lines: &[EntryLine], depth: usize) -> Vec<usize> {
    let mut columns = vec![0; lines.len()];
    let mut from = 0;
    while from < lines.len() {
        let run = lines[from..].iter().zip(&entries[from..]).enumerate();
        let run = run.take_while(|(index, (line, entry))| {
            let parted = *index > 0 && (entry.blank || entry.before.iter().any(|note| note.blank));
            matches!(line, EntryLine::Short { column: true, .. }) && !parted
        });
        let length = run.count();
        let (mut widest_key, mut widest_value) = (0, 0);
        for line in &lines[from..from + length] {
            if let EntryLine::Short { key, value, .. } = line {
                widest_key = widest_key.max(key.chars().count() + 2);
                widest_value = widest_value.max(value.chars().count());
            }
        }
        if depth + widest_key + widest_value <= WIDTH {
            columns[from..from + length].fill(widest_key);
        }
        from += length.max(1);
    }
    columns
}

/// Returns the column of each entry's trailing comment, counted from its key; adjacent comments are aligned.
fn comment_columns(entries: &[TreeEntry], lines: &[EntryLine], columns: &[usize]) -> Vec<usize> {
    let width = |index: usize| match (&lines[index], &entries[index]) {
        (EntryLine::Short { key, value, .. }, entry)
            if entry.after.is_some() || entry.head.is_some() =>
        {
            Some(columns[index].max(key.chars().count() + 2) + value.chars().count() + 2)
        }
        _ => None,
    };
    let mut result = vec![0; lines.len()];
    let mut from = 0;
    while from < lines.len() {
        let mut to = from;
        let mut widest = 0;
        while let Some(width) = (to < lines.len()).then(|| width(to)).flatten() {
            let entry = &entries[to];
            if to > from && (entry.blank || !entry.before.is_empty()) {
                break;
            }
            widest = widest.max(width);
            to += 1;
        }
        result[from..to].fill(widest);
        from = to.max(from + 1);
    }
    result
}
