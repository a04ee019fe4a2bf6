//! Writes a tree: what does not fit on one line gets one entry per line. Used by writers and by `rcc-cli fmt`, never on
//! the real-time thread.

use super::super::scalar;
use super::{CommentLine, Tree, TreeBlock, TreeEntry, WIDTH};

/// Indentation per level, spaces.
const STEP: usize = 2;

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
