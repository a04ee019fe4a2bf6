//! Reads JSON and the forms of YAML in which nets and configurations are usually written, several times as fast as the
//! general parser; declines every other text, also every broken one, which the general parser then reads. What it
//! reads has the same tree and the same positions. Never used on the real-time thread.
//!
//! Declined are, for example: tabs and carriage returns outside of comments and quotes, values of several lines, keys
//! without a value, escapes other than those of `\" \\ \/ \n \t`, anchors, tags, and several documents.

use std::borrow::Cow;

use granit_parser::ScalarStyle;

use super::tree::TreeBuilder;
use crate::diagnostic::Span;

/// Longest key that is read here, bytes; YAML allows 1024 characters.
const KEY_MAX: usize = 1000;

/// Reads a text into a tree, or declines it.
pub(super) fn read(text: &str) -> Option<TreeBuilder<'_>> {
    if !has_common_characters(text) {
        return None;
    }
    // Escapes that are read here are printable, too.
    let builder = match text.is_ascii() {
        true => TreeBuilder::of_printable(text),
        false => TreeBuilder::new(text),
    };
    let mut reader = Reader {
        text,
        bytes: text.as_bytes(),
        at: 0,
        line: 0,
        parent: None,
        builder,
    };
    reader.document()?;
    Some(reader.builder)
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

/// By byte: whether it may end a scalar without quotes.
const MAY_END: [bool; 256] = {
    let (mut table, ends, mut at) = ([false; 256], b"\n:#,[]{}", 0);
    while at < ends.len() {
        table[ends[at] as usize] = true;
        at += 1;
    }
    table
};

/// A scalar, and whether it is in quotes.
struct Scalar<'a> {
    text: Cow<'a, str>,
    style: ScalarStyle,
    span: Span,
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
    builder: TreeBuilder<'a>,
}

impl<'a> Reader<'a> {
    fn document(&mut self) -> Option<()> {
        self.skip_to_token();
        match self.peek()? {
            b'{' | b'[' => self.flow()?,
            _ => self.block(self.column())?,
        }
        self.skip_to_token();
        self.peek().is_none().then_some(())
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

    /// Reads a list or mapping that begins here, at a column of its own.
    fn block(&mut self, column: usize) -> Option<()> {
        let outer = self.parent.replace(column);
        if self.is_item() {
            // A list at the column of its key begins, for the general parser, at its first element.
            let mut start = self.at;
            if outer == Some(column) {
                start += 1 + self.bytes[self.at + 1..]
                    .iter()
                    .take_while(|byte| **byte == b' ')
                    .count();
            }
            self.block_list(column, start)?;
        } else {
            let key = self.scalar(false)?;
            self.block_map(column, key)?;
        }
        self.parent = outer;
        Some(())
    }

    fn block_list(&mut self, column: usize, start: usize) -> Option<()> {
        self.builder.open_list(Span::new(start, start)).ok()?;
        while self.is_item() && self.column() == column {
            self.at += 1;
            self.skip_spaces();
            self.item()?;
            self.skip_to_token();
            if self.peek().is_some() && self.column() > column {
                return None;
            }
        }
        self.builder.close(self.here()).ok()
    }

    fn item(&mut self) -> Option<()> {
        match self.peek()? {
            b'{' | b'[' => {
                self.flow()?;
                return self.end_line();
            }
            b'\n' | b'#' => return None,
            _ if self.is_item() => return self.block(self.column()),
            _ => {}
        }
        let column = self.column();
        let scalar = self.scalar(false)?;
        if self.peek() == Some(b':') {
            let outer = self.parent.replace(column);
            self.block_map(column, scalar)?;
            self.parent = outer;
            return Some(());
        }
        self.value(scalar)
    }

    /// Reads a mapping whose first key has been read.
    fn block_map(&mut self, column: usize, first: Scalar<'a>) -> Option<()> {
        let start = first.span.start;
        self.builder.open_map(Span::new(start, start)).ok()?;
        let mut key = first;
        loop {
            self.key(key)?;
            self.map_value(column)?;
            self.skip_to_token();
            match self.peek() {
                Some(_) if self.column() == column && !self.is_item() => {
                    key = self.scalar(false)?
                }
                Some(_) if self.column() >= column => return None,
                _ => break,
            }
        }
        self.builder.close(self.here()).ok()
    }

    /// Takes a key and the colon behind it.
    fn key(&mut self, key: Scalar<'a>) -> Option<()> {
        if self.peek() != Some(b':') || key.span.end - key.span.start > KEY_MAX {
            return None;
        }
        self.at += 1;
        self.put(key)
    }

    fn map_value(&mut self, column: usize) -> Option<()> {
        match self.peek()? {
            b' ' => self.skip_spaces(),
            b'\n' => {}
            _ => return None,
        }
        match self.peek()? {
            b'{' | b'[' => {
                self.flow()?;
                self.end_line()
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
    fn value(&mut self, scalar: Scalar<'a>) -> Option<()> {
        self.end_line()?;
        self.skip_to_token();
        if self.peek().is_some() && self.parent.is_none_or(|parent| self.column() > parent) {
            return None;
        }
        self.put(scalar)
    }

    fn put(&mut self, scalar: Scalar<'a>) -> Option<()> {
        self.builder
            .scalar(scalar.text, scalar.style, scalar.span)
            .ok()
    }

    /// An empty span at the next byte.
    fn here(&self) -> Span {
        Span::new(self.at, self.at)
    }

    /// As [`Reader::skip_to_token`], in brackets: what follows a line feed is indented more than the block around it.
    fn skip_in_flow(&mut self) -> Option<()> {
        let line = self.line;
        self.skip_to_token();
        let is_indented = self.parent.is_none_or(|parent| self.column() > parent);
        (self.line == line || is_indented).then_some(())
    }

    /// Reads a list or mapping in brackets.
    fn flow(&mut self) -> Option<()> {
        let is_map = self.peek() == Some(b'{');
        let end = if is_map { b'}' } else { b']' };
        let span = Span::new(self.at, self.at + 1);
        self.at += 1;
        if is_map {
            self.builder.open_map(span).ok()?;
        } else {
            self.builder.open_list(span).ok()?;
        }
        self.skip_in_flow()?;
        while self.peek()? != end {
            if is_map {
                let key = self.scalar(true)?;
                let is_plain = key.style == ScalarStyle::Plain;
                self.key(key)?;
                if is_plain && !matches!(self.peek()?, b' ' | b'\n') {
                    return None;
                }
                self.skip_in_flow()?;
            }
            self.flow_value()?;
            self.skip_in_flow()?;
            match self.peek()? {
                b',' => {
                    self.at += 1;
                    self.skip_in_flow()?;
                    if self.peek()? == end {
                        return None;
                    }
                }
                byte if byte == end => {}
                _ => return None,
            }
        }
        self.at += 1;
        self.builder.close(Span::new(self.at - 1, self.at)).ok()
    }

    fn flow_value(&mut self) -> Option<()> {
        match self.peek()? {
            b'{' | b'[' => self.flow(),
            _ => {
                let scalar = self.scalar(true)?;
                if self.peek() == Some(b':') {
                    return None;
                }
                self.put(scalar)
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
            let rest = self.bytes.get(self.at..).unwrap_or_default();
            let ordinary = rest.iter().position(|byte| MAY_END[usize::from(*byte)]);
            self.at += ordinary.unwrap_or(rest.len());
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
        let text = self.text[start..self.at].trim_end_matches(' ');
        let end = start + text.len();
        // Behind spaces there is a comment or the end of the line; a colon there ends no key.
        if end < self.at && self.peek() == Some(b':') {
            return None;
        }
        self.at = end;
        Some(Scalar {
            text: Cow::Borrowed(text),
            style: ScalarStyle::Plain,
            span: Span::new(start, end),
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
        Some(self.quoted(start, text, ScalarStyle::SingleQuoted))
    }

    fn double_quoted(&mut self) -> Option<Scalar<'a>> {
        let start = self.at;
        self.at += 1;
        let mut text = Cow::Borrowed("");
        let mut copied = self.at;
        loop {
            match self.peek()? {
                b'\n' => return None,
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
                _ => self.at += 1,
            }
        }
        let rest = &self.text[copied..self.at];
        if text.is_empty() {
            text = Cow::Borrowed(rest);
        } else {
            text.to_mut().push_str(rest);
        }
        Some(self.quoted(start, text, ScalarStyle::DoubleQuoted))
    }

    /// Takes the quote at the end.
    fn quoted(&mut self, start: usize, text: Cow<'a, str>, style: ScalarStyle) -> Scalar<'a> {
        self.at += 1;
        let span = Span::new(start, self.at);
        Scalar { text, style, span }
    }
}

#[cfg(test)]
mod tests;
