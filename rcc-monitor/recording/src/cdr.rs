//! CDR, the encoding of ROS 2 messages: plain little-endian CDR (OMG DDSI-RTPS 2.5, 10.5), each number aligned to its size,
//! counted from after the four bytes of the encapsulation header. Pure.

/// Encapsulation header: CDR, little-endian, no options.
const HEADER: [u8; 4] = [0, 1, 0, 0];

/// Writes one message.
#[derive(Clone, Debug)]
pub struct CdrWriter {
    bytes: Vec<u8>,
}

impl Default for CdrWriter {
    fn default() -> CdrWriter {
        CdrWriter::new()
    }
}

impl CdrWriter {
    /// Begins a message.
    #[must_use]
    pub fn new() -> CdrWriter {
        CdrWriter {
            bytes: HEADER.to_vec(),
        }
    }

    /// Begins the next message in the same memory.
    pub fn clear(&mut self) {
        self.bytes.truncate(HEADER.len());
    }

    /// Returns the message so far.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Adds zeros up to the next multiple of `size`, a power of two.
    fn align(&mut self, size: usize) {
        let length = self.bytes.len() - HEADER.len();
        self.bytes
            .resize(HEADER.len() + length.next_multiple_of(size), 0);
    }

    /// Adds a byte, or a `bool` as 0 or 1.
    pub fn u8(&mut self, value: u8) {
        self.bytes.push(value);
    }

    /// Adds a `uint32`.
    pub fn u32(&mut self, value: u32) {
        self.align(4);
        self.bytes.extend(value.to_le_bytes());
    }

    /// Adds an `int32`.
    pub fn i32(&mut self, value: i32) {
        self.u32(value.cast_unsigned());
    }

    /// Adds a `uint64`.
    pub fn u64(&mut self, value: u64) {
        self.align(8);
        self.bytes.extend(value.to_le_bytes());
    }

    /// Adds an `int64`.
    pub fn i64(&mut self, value: i64) {
        self.u64(value.cast_unsigned());
    }

    /// Adds a `float64`.
    pub fn f64(&mut self, value: f64) {
        self.u64(value.to_bits());
    }

    /// Adds each number; an array of fixed length has no length in the message.
    pub fn f64s(&mut self, values: &[f64]) {
        for value in values {
            self.f64(*value);
        }
    }

    /// Adds a `string`: its length with the closing zero, its bytes, and the zero. A zero inside ends it.
    pub fn string(&mut self, text: &str) {
        let text = text.split('\0').next().unwrap_or_default();
        self.length(text.len() + 1);
        self.bytes.extend(text.as_bytes());
        self.bytes.push(0);
    }

    /// Adds the length of a sequence.
    pub fn length(&mut self, length: usize) {
        self.u32(u32::try_from(length).unwrap_or(u32::MAX));
    }
}

/// Reads one message; every function returns `None` where the message ends too early.
#[derive(Clone, Debug)]
pub struct CdrReader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> CdrReader<'a> {
    /// Begins to read; `None` unless the message has the header of little-endian CDR.
    #[must_use]
    pub fn new(message: &'a [u8]) -> Option<CdrReader<'a>> {
        let bytes = message.strip_prefix(&HEADER)?;
        Some(CdrReader { bytes, at: 0 })
    }

    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let start = self.at.next_multiple_of(N);
        let taken = self.bytes.get(start..start.checked_add(N)?)?;
        self.at = start + N;
        taken.try_into().ok()
    }

    /// Reads a byte or a `bool`.
    pub fn u8(&mut self) -> Option<u8> {
        self.take().map(u8::from_le_bytes)
    }

    /// Reads a `uint32`.
    pub fn u32(&mut self) -> Option<u32> {
        self.take().map(u32::from_le_bytes)
    }

    /// Reads a `uint64`.
    pub fn u64(&mut self) -> Option<u64> {
        self.take().map(u64::from_le_bytes)
    }

    /// Reads a `float64`.
    pub fn f64(&mut self) -> Option<f64> {
        self.u64().map(f64::from_bits)
    }

    /// Reads a `string`.
    pub fn string(&mut self) -> Option<String> {
        let length = self.u32()? as usize;
        let text = self.bytes.get(self.at..self.at.checked_add(length)?)?;
        self.at += length;
        let text = text.strip_suffix(&[0]).unwrap_or(text);
        Some(String::from_utf8_lossy(text).into_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_aligned_to_their_size_after_the_header() {
        let mut out = CdrWriter::new();
        out.u8(7);
        out.f64(1.0);
        out.string("ab");
        out.u32(9);
        let mut want = vec![0, 1, 0, 0, 7, 0, 0, 0, 0, 0, 0, 0];
        want.extend(1.0_f64.to_le_bytes());
        want.extend([3, 0, 0, 0, b'a', b'b', 0, 0, 9, 0, 0, 0]);
        assert_eq!(out.bytes(), want);
    }

    #[test]
    fn what_is_written_is_read_again() {
        let mut out = CdrWriter::new();
        out.u8(1);
        out.i64(-5);
        out.string("grün");
        out.f64s(&[0.5, f64::NAN]);
        let mut read = CdrReader::new(out.bytes()).expect("a header");
        assert_eq!((read.u8(), read.u64()), (Some(1), Some(-5_i64 as u64)));
        assert_eq!(read.string().as_deref(), Some("grün"));
        assert_eq!(read.f64(), Some(0.5));
        assert!(read.f64().is_some_and(f64::is_nan));
        assert_eq!(read.u8(), None);
    }

    #[test]
    fn a_string_that_claims_to_be_longer_than_the_message_is_refused() {
        let mut out = CdrWriter::new();
        out.u32(u32::MAX);
        let mut read = CdrReader::new(out.bytes()).expect("a header");
        assert_eq!(read.string(), None);
        assert!(CdrReader::new(&[0, 0, 0, 0]).is_none());
    }
}
