//! Parses a text into a tree that keeps comments and empty lines, each attached to an entry. Used by `rcc-cli fmt`,
//! never on the real-time thread.

use super::layout::{CommentLine, Tree, TreeBlock, TreeEntry};
use super::{Node, Value, number};
use crate::diagnostic::Span;

/// A comment and its position.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Comment {
    /// Its text with the `#`, without trailing spaces.
    pub text: String,
    /// Position.
    pub span: Span,
    /// True if only white space precedes it on its line.
    own_line: bool,
    /// Column from the beginning of the line, characters.
    column: usize,
}

/// Returns all comments of a text with the tree `root`, in order.
///
/// # Errors
/// Returns the position of a token that is neither a value nor a comment and would be lost.
pub fn comments(text: &str, root: &Node) -> Result<Vec<Comment>, Span> {
    let mut scalars = Vec::new();
    scalar_spans(root, &mut scalars);
    scalars.push(Span::new(text.len(), text.len()));
    let mut found = Vec::new();
    let mut from = 0;
    for span in scalars {
        gap(text, from, span.start, &mut found)?;
        from = from.max(span.end);
    }
    Ok(found)
}

/// Collects the positions of all keys and scalars, in the order of the text.
fn scalar_spans(node: &Node, spans: &mut Vec<Span>) {
    match &node.value {
        Value::List(nodes) => nodes.iter().for_each(|node| scalar_spans(node, spans)),
        Value::Map(entries) => {
            for entry in entries {
                spans.push(entry.key.span);
                scalar_spans(&entry.value, spans);
            }
        }
        _ if node.span.end > node.span.start => spans.push(node.span),
        _ => {}
    }
}

/// Collects the comments between two scalars.
fn gap(text: &str, from: usize, to: usize, found: &mut Vec<Comment>) -> Result<(), Span> {
    let mut at = from;
    while at < to {
        let rest = text.get(at..to).unwrap_or_default();
        let Some(c) = rest.chars().next() else { break };
        if c == '#' {
            let length = rest.find('\n').unwrap_or(rest.len());
            let start = line_start(text, at);
            let before = text.get(start..at).unwrap_or_default();
            found.push(Comment {
                text: rest.get(..length).unwrap_or(rest).trim_end().to_string(),
                span: Span::new(at, at + length),
                own_line: before.trim().is_empty(),
                column: before.chars().count(),
            });
            at += length;
        } else if c.is_whitespace() || ",:[]{}-?\u{feff}".contains(c) {
            at += c.len_utf8();
        } else if matches!(c, '|' | '>') {
            // Header of a block scalar, possibly with indentation and chomping indicators.
            let header = rest
                .bytes()
                .take_while(|byte| b"|>+-0123456789".contains(byte));
            at += header.count();
        } else {
            return Err(Span::new(at, at + c.len_utf8()));
        }
    }
    Ok(())
}

fn line_start(text: &str, at: usize) -> usize {
    let before = text.get(..at).unwrap_or_default();
    before.rfind('\n').map_or(0, |end| end + 1)
}

/// Returns the text with the tree `root` as a tree with its comments and empty lines.
///
/// # Errors
/// Returns the position of something that cannot be preserved.
pub fn read(text: &str, root: &Node) -> Result<Tree, Span> {
    let comments = comments(text, root)?;
    let mut reader = CommentReader {
        text,
        comments: &comments,
        next: 0,
    };
    let mut tree = reader.tree(root);
    while let Some(comment) = reader.before(usize::MAX) {
        let placed = if comment.own_line {
            reader.at_the_end(&mut tree, root, comment, None)
        } else {
            reader.behind(&mut tree, root, comment)
        };
        if !placed {
            let note = reader.note(comment);
            tree.block_mut().ok_or(comment.span)?.tail.push(note);
        }
    }
    Ok(tree)
}

struct CommentReader<'a> {
    text: &'a str,
    comments: &'a [Comment],
    /// Index of the first comment that has not been attached yet.
    next: usize,
}

impl<'a> CommentReader<'a> {
    /// Takes the next comment if it begins before `place`.
    fn before(&mut self, place: usize) -> Option<&'a Comment> {
        let comment = self
            .comments
            .get(self.next)
            .filter(|comment| comment.span.start < place)?;
        self.next += 1;
        Some(comment)
    }

    fn note(&self, comment: &Comment) -> CommentLine {
        CommentLine {
            text: comment.text.clone(),
            blank: comment.own_line && self.follows_empty_line(comment.span.start),
        }
    }

    /// Returns true if the line above `place` is empty.
    fn follows_empty_line(&self, place: usize) -> bool {
        let start = line_start(self.text, place);
        let Some(end) = start.checked_sub(1) else {
            return false;
        };
        let above = line_start(self.text, end);
        self.text
            .get(above..end)
            .is_some_and(|line| line.trim().is_empty())
    }

    fn is_block(&self, node: &Node) -> bool {
        let container = matches!(node.value, Value::List(_) | Value::Map(_));
        let rest = self.text.get(node.span.start..).unwrap_or_default();
        container && !rest.starts_with(['[', '{'])
    }

    fn column(&self, node: &Node) -> usize {
        let start = line_start(self.text, node.span.start);
        self.text
            .get(start..node.span.start)
            .unwrap_or_default()
            .chars()
            .count()
    }

    fn tree(&mut self, node: &Node) -> Tree {
        let slice = self
            .text
            .get(node.span.start..node.span.end)
            .unwrap_or_default();
        match &node.value {
            // Keep the original notation if it parses to the same value.
            value @ (Value::Int(_) | Value::Real(_)) if number(slice).as_ref() == Some(value) => {
                Tree::Plain(slice.to_string())
            }
            Value::List(nodes) => {
                let children: Vec<_> = nodes.iter().map(|node| (None, node)).collect();
                Tree::List(self.block(node, &children))
            }
            Value::Map(entries) => {
                let children: Vec<_> = entries
                    .iter()
                    .map(|entry| (Some(&entry.key), &entry.value))
                    .collect();
                Tree::Map(self.block(node, &children))
            }
            _ => Tree::of(node),
        }
    }

    fn block(&mut self, node: &Node, children: &[(Option<&super::Key>, &Node)]) -> TreeBlock {
        let mut block = TreeBlock::default();
        let is_block = self.is_block(node);
        let column = is_block.then(|| self.column(node));
        let mut end = node.span.start;
        for (index, (key, value)) in children.iter().enumerate() {
            let start = match key {
                Some(key) => key.span.start,
                None if is_block => self.dash(end, value.span.start),
                None => value.span.start,
            };
            let mut entry = TreeEntry::new(
                key.map(|key| key.name.clone()).unwrap_or_default(),
                Tree::Plain(String::new()),
            );
            let previous = index
                .checked_sub(1)
                .and_then(|index| children.get(index))
                .map(|(_, node)| *node);
            while let Some(comment) = self.before(start) {
                self.between(comment, &mut block, previous, &mut entry, column);
            }
            let line = line_start(self.text, start);
            let first_on_line = self
                .text
                .get(line..start)
                .is_some_and(|before| before.trim().is_empty());
            entry.blank = first_on_line && self.follows_empty_line(start);
            while let Some(comment) = self.before(value.span.start) {
                match (&entry.head, comment.own_line) {
                    (None, false) => entry.head = Some(comment.text.clone()),
                    // It precedes the first entry of the value, which attaches it.
                    _ if self.is_block(value) => {
                        self.next -= 1;
                        break;
                    }
                    _ => entry.before.push(self.note(comment)),
                }
            }
            entry.value = self.tree(value);
            end = value.span.end.max(start);
            block.entries.push(entry);
        }
        if !is_block {
            let last = children.last().map(|(_, node)| *node);
            while let Some(comment) = self.before(node.span.end) {
                let mut nobody = TreeEntry::new("", Tree::Plain(String::new()));
                self.between(comment, &mut block, last, &mut nobody, column);
                block.tail.append(&mut nobody.before);
                block
                    .tail
                    .extend(nobody.head.map(|text| CommentLine { text, blank: false }));
            }
        }
        block
    }

    /// Attaches a comment between two entries; the earlier one is the last of `block`.
    fn between(
        &self,
        comment: &Comment,
        block: &mut TreeBlock,
        previous: Option<&Node>,
        entry: &mut TreeEntry,
        column: Option<usize>,
    ) {
        if let (Some(last), Some(previous)) = (block.entries.last_mut(), previous) {
            let placed = if comment.own_line {
                self.at_the_end(&mut last.value, previous, comment, column)
            } else if self.is_block(previous) {
                self.behind(&mut last.value, previous, comment)
            } else {
                put_behind(last, comment)
            };
            if placed {
                return;
            }
        }
        entry.before.push(self.note(comment));
    }

    /// Attaches a comment after the last entry inside a block, on the same line; returns false if there already is one.
    fn behind(&self, tree: &mut Tree, node: &Node, comment: &Comment) -> bool {
        let (Some(entry), Some(last)) = (
            tree.block_mut().and_then(|block| block.entries.last_mut()),
            last(node),
        ) else {
            return false;
        };
        if self.is_block(last) {
            self.behind(&mut entry.value, last, comment)
        } else {
            put_behind(entry, comment)
        }
    }

    /// Attaches a comment below the last entry of the innermost block that is indented more than `outer` and at most as
    /// far as the comment.
    fn at_the_end(
        &self,
        tree: &mut Tree,
        node: &Node,
        comment: &Comment,
        outer: Option<usize>,
    ) -> bool {
        let column = self.column(node);
        if !self.is_block(node)
            || column > comment.column
            || outer.is_some_and(|outer| column <= outer)
        {
            return false;
        }
        let Some(block) = tree.block_mut() else {
            return false;
        };
        if let (Some(entry), Some(last)) = (block.entries.last_mut(), last(node))
            && self.at_the_end(&mut entry.value, last, comment, Some(column))
        {
            return true;
        }
        block.tail.push(self.note(comment));
        true
    }

    /// Returns the position of the `-` of the next entry, before its value.
    fn dash(&self, from: usize, to: usize) -> usize {
        let mut at = from;
        while at < to {
            let comment = self
                .comments
                .iter()
                .find(|comment| comment.span.start == at);
            if let Some(comment) = comment {
                at = comment.span.end;
            } else if self.text.as_bytes().get(at) == Some(&b'-') {
                return at;
            } else {
                at += 1;
            }
        }
        to
    }
}

fn put_behind(entry: &mut TreeEntry, comment: &Comment) -> bool {
    let free = entry.after.is_none();
    if free {
        entry.after = Some(comment.text.clone());
    }
    free
}

/// Returns the value of the last entry.
fn last(node: &Node) -> Option<&Node> {
    match &node.value {
        Value::List(nodes) => nodes.last(),
        Value::Map(entries) => entries.last().map(|entry| &entry.value),
        _ => None,
    }
}

/// Returns true if two trees have the same content, regardless of positions.
#[must_use]
pub fn same(a: &Node, b: &Node) -> bool {
    match (&a.value, &b.value) {
        (Value::Real(a), Value::Real(b)) => a.to_bits() == b.to_bits(),
        (Value::List(a), Value::List(b)) => {
            a.len() == b.len() && a.iter().zip(b).all(|(a, b)| same(a, b))
        }
        (Value::Map(a), Value::Map(b)) => {
            let equal = |(a, b): (&super::Entry, &super::Entry)| {
                a.key.name == b.key.name && same(&a.value, &b.value)
            };
            a.len() == b.len() && a.iter().zip(b).all(equal)
        }
        (a, b) => a == b,
    }
}
