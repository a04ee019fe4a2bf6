//! A reader for the texts of messages and conditions, with the expected syntax and its position in errors. Pure functions.

/// A text that is not a message or a condition.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected {wanted} at character {at}")]
pub struct SyntaxError {
    /// Name of the expected syntax.
    pub wanted: &'static str,
    /// Byte offset, from 0.
    pub at: usize,
}

/// A text and the position of the reader.
pub(crate) struct TextReader<'t> {
    /// The text.
    pub text: &'t str,
    /// Byte offset of the next byte.
    pub at: usize,
}

impl<'t> TextReader<'t> {
    /// Creates a reader at the start of a text.
    pub fn new(text: &'t str) -> TextReader<'t> {
        TextReader { text, at: 0 }
    }

    /// Returns the next byte.
    pub fn peek(&self) -> Option<u8> {
        self.text.as_bytes().get(self.at).copied()
    }

    /// Returns the error for the next byte.
    pub fn wanted(&self, wanted: &'static str) -> SyntaxError {
        SyntaxError {
            wanted,
            at: self.at,
        }
    }

    /// Skips blanks.
    pub fn blanks(&mut self) {
        while self.peek().is_some_and(|byte| byte.is_ascii_whitespace()) {
            self.at += 1;
        }
    }

    /// Skips blanks, and this byte if it is there; returns whether it was.
    pub fn take(&mut self, byte: u8) -> bool {
        self.blanks();
        let is_there = self.peek() == Some(byte);
        self.at += usize::from(is_there);
        is_there
    }

    /// Skips blanks and this byte.
    ///
    /// # Errors
    /// Fails if it is not there.
    pub fn expect(&mut self, byte: u8, wanted: &'static str) -> Result<(), SyntaxError> {
        match self.take(byte) {
            true => Ok(()),
            false => Err(self.wanted(wanted)),
        }
    }

    /// Returns the bytes for which `holds`.
    pub fn while_byte(&mut self, holds: impl Fn(u8) -> bool) -> &'t str {
        let begin = self.at;
        while self.peek().is_some_and(&holds) {
            self.at += 1;
        }
        self.text.get(begin..self.at).unwrap_or_default()
    }
}
