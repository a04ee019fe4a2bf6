//! Reads a text byte by byte, and says what was expected where: common to messages and conditions. Pure functions.

/// What stands here is not what was expected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Unexpected {
    /// What would have been possible.
    pub wanted: &'static str,
    /// Byte offset, from 0.
    pub at: usize,
}

/// A text, and how far it has been read.
pub(crate) struct TextReader<'t> {
    /// The text.
    pub text: &'t str,
    /// Byte offset of what comes next.
    pub at: usize,
}

impl<'t> TextReader<'t> {
    /// Begins at the beginning.
    pub fn new(text: &'t str) -> TextReader<'t> {
        TextReader { text, at: 0 }
    }

    /// Returns the next byte.
    pub fn peek(&self) -> Option<u8> {
        self.text.as_bytes().get(self.at).copied()
    }

    /// Returns the error for what comes next.
    pub fn wanted(&self, wanted: &'static str) -> Unexpected {
        Unexpected {
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
    pub fn expect(&mut self, byte: u8, wanted: &'static str) -> Result<(), Unexpected> {
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
