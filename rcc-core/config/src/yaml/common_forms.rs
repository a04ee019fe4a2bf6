//! Reads JSON and the forms of YAML in which nets and configurations are usually written, several times as fast as the
//! general parser; declines every other text, also every broken one, which the general parser then reads. What it
//! reads has the same tree and the same positions. Never used on the real-time thread.
//!
//! Declined are, for example: tabs and carriage returns outside of comments and quotes, values of several lines, keys
//! without a value, keys given twice, escapes other than those of `\" \\ \/ \n \t`, unprintable characters,
//! anchors, tags, and several documents.

use std::borrow::Cow;

use foldhash::HashSet;

use super::tree::is_new;
use super::{DEPTH_MAX, Entry, Key, Node, ShortText, Value, plain, unprintable};
use crate::diagnostic::Span;

/// Longest key that is read here, bytes; YAML allows 1024 characters.
const KEY_MAX: usize = 1000;

/// Reads a text into a tree, or declines it.
pub(super) fn read(text: &str) -> Option<Node> {
    if !has_common_characters(text) {
        return None;
    }
    let mut reader = Reader {
        text,
        bytes: text.as_bytes(),
        at: 0,
        line: 0,
        parent: None,
        is_ascii: text.is_ascii(),
        depth: 0,
        nodes: Vec::new(),
        entries: Vec::new(),
    };
    reader.document()
}

/// Whether each character is a line feed or printable, and none has a special meaning at the end of a line.
fn has_common_characters(text: &str) -> bool {
    // Without a branch for each byte, so that several are compared at a time.
    let is_common = |byte: &u8| (*byte >= b' ') & (*byte != 0x7f) | (*byte == b'\n');
    let mut blocks = text.as_bytes().chunks(256);
    if !blocks.all(|block| block.iter().fold(true, |all, byte| all & is_common(byte))) {
        return false;
    }
    text.is_ascii() || text.chars().all(|character| {
        !matches!(character, '\u{80}'..='\u{a0}' | '\u{2000}'..='\u{200f}' | '\u{2028}'..='\u{202f}'
                | '\u{205f}'..='\u{206f}' | '\u{feff}' | '\u{fff0}'..='\u{ffff}')
    })
}

/// Returns a table by byte: whether it is one of these.
const fn bytes_of(ends: &[u8]) -> [bool; 256] {
    let (mut table, mut at) = ([false; 256], 0);
    while at < ends.len() {
        table[ends[at] as usize] = true;
        at += 1;
    }
    table
}

/// By byte: whether it may end a scalar without quotes.
const MAY_END: [bool; 256] = bytes_of(b"\n:#,[]{}");
/// By byte: whether it ends a run of characters in double quotes.
const ENDS_QUOTED: [bool; 256] = bytes_of(b"\n\"\\");

/// A scalar, and whether it is in quotes.
struct Scalar<'a> {
    text: Cow<'a, str>,
    is_plain: bool,
    span: Span,
}

/// A list or mapping that is being read: its elements or entries are those from `first` on.
struct Open {
    first: usize,
    /// First byte.
    start: usize,
}

struct Reader<'a> {
    text: &'a str,
    bytes: &'a [u8],
    /// The next byte.
    at: usize,
    /// First byte of the line.
    line: usize,
    /// Column of the innermost block collection; none at the root.
    parent: Option<usize>,
    /// The text is ASCII: no character is unprintable.
    is_ascii: bool,
    /// Number of open lists and mappings.
    depth: usize,
    /// Elements of all open lists: each gets its memory when its length is known.
    nodes: Vec<Node>,
    /// Entries of all open mappings.
    entries: Vec<Entry>,
}

impl<'a> Reader<'a> {
    fn document(&mut self) -> Option<Node> {
        self.skip_to_token();
        let root = match self.peek()? {
            b'{' | b'[' => self.flow()?,
            _ => self.block(self.column())?,
        };
        self.skip_to_token();
        self.peek().is_none().then_some(root)
    }

    fn peek(&self) -> Option<u8> {
        self.bytes.get(self.at).copied()
    }

    fn next(&self) -> Option<u8> {
        self.bytes.get(self.at + 1).copied()
    }

    fn column(&self) -> usize {
        self.at - self.line
    }

    fn skip_spaces(&mut self) {
        while self.peek() == Some(b' ') {
            self.at += 1;
        }
    }

    /// Skips the bytes up to the next one of a table.
    fn skip_until(&mut self, ends: &[bool; 256]) {
        let rest = self.bytes.get(self.at..).unwrap_or_default();
        let others = rest.iter().position(|byte| ends[usize::from(*byte)]);
        self.at += others.unwrap_or(rest.len());
    }

    /// Skips spaces, and a comment behind them, up to the end of the line; declines if anything else follows.
    fn end_line(&mut self) -> Option<()> {
        let from = self.at;
        self.skip_spaces();
        if self.peek() == Some(b'#') && self.at > from {
            self.skip_line();
        }
        matches!(self.peek(), None | Some(b'\n')).then_some(())
    }

    fn skip_line(&mut self) {
        let rest = &self.bytes[self.at..];
        self.at += rest
            .iter()
            .position(|byte| *byte == b'\n')
            .unwrap_or(rest.len());
    }

    /// Skips spaces, line feeds and comments.
    fn skip_to_token(&mut self) {
        loop {
            match self.peek() {
                Some(b' ') => self.at += 1,
                Some(b'\n') => {
                    self.at += 1;
                    self.line = self.at;
                }
                Some(b'#') if self.at == self.line || self.bytes[self.at - 1] == b' ' => {
                    self.skip_line()
                }
                _ => return,
            }
        }
    }

    /// Whether a list's `- ` is next.
    fn is_item(&self) -> bool {
        self.peek() == Some(b'-') && matches!(self.next(), Some(b' '))
    }

    /// Opens a list or mapping whose first element would have this index.
    fn open(&mut self, first: usize, start: usize) -> Option<Open> {
        self.depth += 1;
        (self.depth <= DEPTH_MAX).then_some(Open { first, start })
    }

    /// Closes a list; a block ends with its last element.
    fn close_list(&mut self, open: &Open, end: Option<usize>) -> Node {
        self.depth -= 1;
        let nodes = self.nodes.split_off(open.first);
        let last = nodes.last().map(|node| node.span.end);
        let end = end.or(last).unwrap_or(open.start);
        Node {
            value: Value::List(nodes),
            span: Span::new(open.start, end),
        }
    }

    /// Closes a mapping; a block ends with its last value.
    fn close_map(&mut self, open: &Open, end: Option<usize>) -> Node {
        self.depth -= 1;
        let entries = self.entries.split_off(open.first);
        let last = entries.last().map(|entry| entry.value.span.end);
        let end = end.or(last).unwrap_or(open.start);
        Node {
            value: Value::Map(entries),
            span: Span::new(open.start, end),
        }
    }

    /// Reads a list or mapping that begins here, at a column of its own.
    fn block(&mut self, column: usize) -> Option<Node> {
        let outer = self.parent.replace(column);
        let block = if self.is_item() {
            // A list at the column of its key begins, for the general parser, at its first element.
            let mut start = self.at;
            if outer == Some(column) {
                start += 1 + self.bytes[self.at + 1..]
                    .iter()
                    .take_while(|byte| **byte == b' ')
                    .count();
            }
            self.block_list(column, start)?
        } else {
            let key = self.scalar(false)?;
            self.block_map(column, key)?
        };
        self.parent = outer;
        Some(block)
    }

    fn block_list(&mut self, column: usize, start: usize) -> Option<Node> {
        let open = self.open(self.nodes.len(), start)?;
        while self.is_item() && self.column() == column {
            self.at += 1;
            self.skip_spaces();
            let item = self.item()?;
            self.nodes.push(item);
            self.skip_to_token();
            if self.peek().is_some() && self.column() > column {
                return None;
            }
        }
        Some(self.close_list(&open, None))
    }

    fn item(&mut self) -> Option<Node> {
        match self.peek()? {
            b'{' | b'[' => {
                let flow = self.flow()?;
                self.end_line()?;
                return Some(flow);
            }
            b'\n' | b'#' => return None,
            _ if self.is_item() => return self.block(self.column()),
            _ => {}
        }
        let column = self.column();
        let scalar = self.scalar(false)?;
        if self.peek() == Some(b':') {
            let outer = self.parent.replace(column);
            let map = self.block_map(column, scalar)?;
            self.parent = outer;
            return Some(map);
        }
        self.value(scalar)
    }

    /// Reads a mapping whose first key has been read.
    fn block_map(&mut self, column: usize, first: Scalar<'a>) -> Option<Node> {
        let open = self.open(self.entries.len(), first.span.start)?;
        let mut names = None;
        let mut key = first;
        loop {
            let name = self.key(key, &open, &mut names)?;
            let value = self.map_value(column)?;
            self.entries.push(Entry { key: name, value });
            self.skip_to_token();
            match self.peek() {
                Some(_) if self.column() == column && !self.is_item() => {
                    key = self.scalar(false)?
                }
                Some(_) if self.column() >= column => return None,
                _ => break,
            }
        }
        Some(self.close_map(&open, None))
    }

    /// Takes a key of an open mapping, and the colon behind it.
    fn key(
        &mut self,
        key: Scalar<'a>,
        map: &Open,
        names: &mut Option<Box<HashSet<ShortText>>>,
    ) -> Option<Key> {
        if self.peek() != Some(b':') || key.span.end - key.span.start > KEY_MAX {
            return None;
        }
        self.at += 1;
        let is_good =
            self.is_printable(&key) && is_new(&key.text, self.entries.get(map.first..)?, names);
        is_good.then(|| Key {
            name: ShortText::new(&key.text),
            span: key.span,
        })
    }

    fn map_value(&mut self, column: usize) -> Option<Node> {
        match self.peek()? {
            b' ' => self.skip_spaces(),
            b'\n' => {}
            _ => return None,
        }
        match self.peek()? {
            b'{' | b'[' => {
                let flow = self.flow()?;
                self.end_line()?;
                Some(flow)
            }
            b'\n' | b'#' => {
                self.skip_to_token();
                self.peek()?;
                let deeper = self.column() > column || self.column() == column && self.is_item();
                if deeper {
                    self.block(self.column())
                } else {
                    None
                }
            }
            _ if self.is_item() => None,
            _ => {
                let scalar = self.scalar(false)?;
                self.value(scalar)
            }
        }
    }

    /// Takes a scalar that ends its line, and is not continued in the next one.
    fn value(&mut self, scalar: Scalar<'a>) -> Option<Node> {
        self.end_line()?;
        self.skip_to_token();
        if self.peek().is_some() && self.parent.is_none_or(|parent| self.column() > parent) {
            return None;
        }
        self.node(scalar)
    }

    fn is_printable(&self, scalar: &Scalar<'a>) -> bool {
        // Escapes that are read here are printable, too.
        self.is_ascii || unprintable(&scalar.text, scalar.span).is_none()
    }

    fn node(&self, scalar: Scalar<'a>) -> Option<Node> {
        self.is_printable(&scalar).then(|| Node {
            value: match scalar.is_plain {
                true => plain(&scalar.text),
                false => Value::Text(ShortText::new(&scalar.text)),
            },
            span: scalar.span,
        })
    }

    /// As [`Reader::skip_to_token`], in brackets: what follows a line feed is indented more than the block around it.
    fn skip_in_flow(&mut self) -> Option<()> {
        let line = self.line;
        self.skip_to_token();
        let is_indented = self.parent.is_none_or(|parent| self.column() > parent);
        (self.line == line || is_indented).then_some(())
    }

    /// Reads a list or mapping in brackets.
    fn flow(&mut self) -> Option<Node> {
        match self.peek()? {
            b'{' => self.flow_map(),
            _ => self.flow_list(),
        }
    }

    fn flow_map(&mut self) -> Option<Node> {
        let open = self.open(self.entries.len(), self.at)?;
        let mut names = None;
        self.at += 1;
        self.skip_in_flow()?;
        while self.peek()? != b'}' {
            let key = self.scalar(true)?;
            let is_plain = key.is_plain;
            let key = self.key(key, &open, &mut names)?;
            if is_plain && !matches!(self.peek()?, b' ' | b'\n') {
                return None;
            }
            self.skip_in_flow()?;
            let value = self.flow_value()?;
            self.entries.push(Entry { key, value });
            self.end_element(b'}')?;
        }
        self.at += 1;
        Some(self.close_map(&open, Some(self.at)))
    }

    fn flow_list(&mut self) -> Option<Node> {
        let open = self.open(self.nodes.len(), self.at)?;
        self.at += 1;
        self.skip_in_flow()?;
        while self.peek()? != b']' {
            let element = self.flow_value()?;
            self.nodes.push(element);
            self.end_element(b']')?;
        }
        self.at += 1;
        Some(self.close_list(&open, Some(self.at)))
    }

    /// Skips the comma behind an element, unless the list or mapping ends with this byte.
    fn end_element(&mut self, end: u8) -> Option<()> {
        self.skip_in_flow()?;
        match self.peek()? {
            b',' => {
                self.at += 1;
                self.skip_in_flow()?;
                (self.peek()? != end).then_some(())
            }
            byte => (byte == end).then_some(()),
        }
    }

    fn flow_value(&mut self) -> Option<Node> {
        match self.peek()? {
            b'{' | b'[' => self.flow(),
            _ => {
                let scalar = self.scalar(true)?;
                if self.peek() == Some(b':') {
                    return None;
                }
                self.node(scalar)
            }
        }
    }

    fn scalar(&mut self, in_flow: bool) -> Option<Scalar<'a>> {
        match self.peek()? {
            b'"' => self.double_quoted(),
            b'\'' => self.single_quoted(),
            _ => self.plain(in_flow),
        }
    }

    /// Reads a scalar without quotes up to `: `, ` #`, the end of the line or, in brackets, one of `,[]{}`.
    fn plain(&mut self, in_flow: bool) -> Option<Scalar<'a>> {
        let start = self.at;
        match self.peek()? {
            b'-' if matches!(
                self.next(),
                None | Some(b' ' | b'\n' | b',' | b'[' | b']' | b'{' | b'}' | b'-')
            ) =>
            {
                return None;
            }
            b'.' if self.next() == Some(b'.') => return None,
            b',' | b'[' | b']' | b'{' | b'}' | b'?' | b':' | b'#' | b'&' | b'*' | b'!' | b'|'
            | b'>' | b'%' | b'@' | b'`' => return None,
            _ => {}
        }
        loop {
            self.skip_until(&MAY_END);
            match self.peek() {
                None | Some(b'\n') => break,
                Some(b':') => match self.next() {
                    None | Some(b' ' | b'\n') => break,
                    Some(b',' | b'[' | b']' | b'{' | b'}') if in_flow => return None,
                    _ => {}
                },
                Some(b'#') if self.bytes[self.at - 1] == b' ' => break,
                Some(b',' | b'[' | b']' | b'{' | b'}') if in_flow => break,
                _ => {}
            }
            self.at += 1;
        }
        let ended = self.at;
        while self.at > start && self.bytes[self.at - 1] == b' ' {
            self.at -= 1;
        }
        // Behind spaces there is a comment or the end of the line; a colon there ends no key.
        if self.at < ended && self.bytes.get(ended) == Some(&b':') {
            return None;
        }
        Some(Scalar {
            text: Cow::Borrowed(&self.text[start..self.at]),
            is_plain: true,
            span: Span::new(start, self.at),
        })
    }

    fn single_quoted(&mut self) -> Option<Scalar<'a>> {
        let start = self.at;
        self.at += 1;
        let mut doubled = false;
        loop {
            match self.peek()? {
                b'\n' => return None,
                b'\'' if self.next() == Some(b'\'') => {
                    doubled = true;
                    self.at += 2;
                }
                b'\'' => break,
                _ => self.at += 1,
            }
        }
        let inside = &self.text[start + 1..self.at];
        let text = if doubled {
            Cow::Owned(inside.replace("''", "'"))
        } else {
            Cow::Borrowed(inside)
        };
        Some(self.quoted(start, text))
    }

    fn double_quoted(&mut self) -> Option<Scalar<'a>> {
        let start = self.at;
        self.at += 1;
        let mut text = Cow::Borrowed("");
        let mut copied = self.at;
        loop {
            self.skip_until(&ENDS_QUOTED);
            match self.peek()? {
                b'"' => break,
                b'\\' => {
                    let text = text.to_mut();
                    text.push_str(&self.text[copied..self.at]);
                    text.push(match self.next()? {
                        b'n' => '\n',
                        b't' => '\t',
                        byte @ (b'"' | b'\\' | b'/') => char::from(byte),
                        _ => return None,
                    });
                    self.at += 2;
                    copied = self.at;
                }
                _ => return None,
            }
        }
        let rest = &self.text[copied..self.at];
        if text.is_empty() {
            text = Cow::Borrowed(rest);
        } else {
            text.to_mut().push_str(rest);
        }
        Some(self.quoted(start, text))
    }

    /// Takes the quote at the end.
    fn quoted(&mut self, start: usize, text: Cow<'a, str>) -> Scalar<'a> {
        self.at += 1;
        Scalar {
            text,
            is_plain: false,
            span: Span::new(start, self.at),
        }
    }
}

#[cfg(test)]
mod tests;
