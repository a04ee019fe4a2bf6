//! RequestLimits and answers of Modbus TCP as bytes (MODBUS Application Protocol V1.1b3; Messaging on TCP/IP V1.0b).
//! Pure and without heap; used by the host's thread in each exchange.
//!
//! Own code rather than the client of `tokio-modbus`, which ends the connection at an answer that comes late, allocates
//! for each transaction, and waits in steps of 1 ms.

use thiserror::Error;

use super::address::Table;

#[cfg(test)]
mod tests;

/// Longest message, with its header of 7 bytes.
pub const MESSAGE_MAX: usize = 260;
/// Length of transaction, protocol, length and unit.
const HEADER: usize = 7;
/// Bytes that are kept of what came: a whole message, and the beginning of others.
const KEPT_MAX: usize = 4 * MESSAGE_MAX;

/// What a request asks for; addresses count from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModbusRequest<'a> {
    /// Functions 1 to 4.
    Read {
        /// From which table.
        table: Table,
        /// First point.
        first: u16,
        /// NumberType of points.
        count: u16,
    },
    /// Function 5 for one, 15 for more.
    WriteCoils {
        /// First coil.
        first: u16,
        /// Values.
        values: &'a [bool],
    },
    /// Function 6 for one, 16 for more.
    WriteRegisters {
        /// First register.
        first: u16,
        /// Values.
        values: &'a [u16],
    },
    /// Function 22: changes the bits of `mask` in a register.
    Mask {
        /// The register.
        address: u16,
        /// Bits that change.
        mask: u16,
        /// Their new values.
        values: u16,
    },
}

/// What the answer to a request must be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExpectedResponse {
    /// So many bits.
    Bits(u16),
    /// So many registers.
    Registers(u16),
    /// These bytes again.
    Echo {
        /// The bytes.
        bytes: [u8; 6],
        /// How many count.
        length: usize,
    },
}

/// A message that is on its way out.
#[derive(Clone, Copy, Debug)]
pub struct EncodedRequest {
    bytes: [u8; MESSAGE_MAX],
    length: usize,
    /// What must come back.
    pub expected: ExpectedResponse,
}

impl EncodedRequest {
    /// Nothing.
    pub const NONE: EncodedRequest = EncodedRequest {
        bytes: [0; MESSAGE_MAX],
        length: 0,
        expected: ExpectedResponse::Bits(0),
    };

    /// A request; `None` if it is longer than a message may be.
    #[must_use]
    pub fn new(transaction: u16, unit: u8, request: &ModbusRequest<'_>) -> Option<EncodedRequest> {
        let mut message = EncodedRequest {
            length: HEADER,
            ..EncodedRequest::NONE
        };
        message.bytes[6] = unit;
        message.expected = message.body(request)?;
        message.renumber(transaction);
        let length = u16::try_from(message.length - 6).ok()?;
        message.bytes[4..6].copy_from_slice(&length.to_be_bytes());
        Some(message)
    }

    /// The same request as another transaction.
    pub fn renumber(&mut self, transaction: u16) {
        self.bytes[..2].copy_from_slice(&transaction.to_be_bytes());
    }

    /// NumberType of the transaction.
    #[must_use]
    pub fn transaction(&self) -> u16 {
        u16::from_be_bytes([self.bytes[0], self.bytes[1]])
    }

    /// The function that is asked for.
    #[must_use]
    pub fn function(&self) -> u8 {
        self.bytes[HEADER]
    }

    /// What goes over the wire.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.bytes[..self.length]
    }

    fn body(&mut self, request: &ModbusRequest<'_>) -> Option<ExpectedResponse> {
        match *request {
            ModbusRequest::Read {
                table,
                first,
                count,
            } => {
                let function = match table {
                    Table::Coil => 1,
                    Table::Discrete => 2,
                    Table::Holding => 3,
                    Table::Input => 4,
                };
                self.put(&[function])?;
                self.put_words(&[first, count])?;
                Some(if table.is_bits() {
                    ExpectedResponse::Bits(count)
                } else {
                    ExpectedResponse::Registers(count)
                })
            }
            ModbusRequest::WriteCoils {
                first,
                values: [on],
            } => {
                self.put(&[5])?;
                self.put_words(&[first, if *on { 0xFF00 } else { 0 }])?;
                Some(self.echo(4))
            }
            ModbusRequest::WriteCoils { first, values } => {
                self.put(&[15])?;
                self.put_words(&[first, u16::try_from(values.len()).ok()?])?;
                let echo = self.echo(4);
                self.put(&[u8::try_from(values.len().div_ceil(8)).ok()?])?;
                for bits in values.chunks(8) {
                    let byte = bits
                        .iter()
                        .rev()
                        .fold(0, |byte, on| byte << 1 | u8::from(*on));
                    self.put(&[byte])?;
                }
                Some(echo)
            }
            ModbusRequest::WriteRegisters {
                first,
                values: [value],
            } => {
                self.put(&[6])?;
                self.put_words(&[first, *value])?;
                Some(self.echo(4))
            }
            ModbusRequest::WriteRegisters { first, values } => {
                self.put(&[16])?;
                self.put_words(&[first, u16::try_from(values.len()).ok()?])?;
                let echo = self.echo(4);
                self.put(&[u8::try_from(2 * values.len()).ok()?])?;
                self.put_words(values)?;
                Some(echo)
            }
            ModbusRequest::Mask {
                address,
                mask,
                values,
            } => {
                self.put(&[22])?;
                self.put_words(&[address, !mask, values & mask])?;
                Some(self.echo(6))
            }
        }
    }

    fn put(&mut self, bytes: &[u8]) -> Option<()> {
        let end = self.length + bytes.len();
        self.bytes.get_mut(self.length..end)?.copy_from_slice(bytes);
        self.length = end;
        Some(())
    }

    fn put_words(&mut self, words: &[u16]) -> Option<()> {
        words
            .iter()
            .try_for_each(|word| self.put(&word.to_be_bytes()))
    }

    /// The first `length` bytes behind the function come back.
    fn echo(&self, length: usize) -> ExpectedResponse {
        let mut bytes = [0; 6];
        bytes[..length].copy_from_slice(&self.bytes[HEADER + 1..HEADER + 1 + length]);
        ExpectedResponse::Echo { bytes, length }
    }
}

/// Why what came is no answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum FrameError {
    /// Another protocol.
    #[error("protocol number {0} instead of 0")]
    Protocol(u16),
    /// A length that no message has.
    #[error("a message of {0} bytes, which none has")]
    Length(u16),
    /// An answer to something else, under the number of this transaction.
    #[error("an answer of function {have} to function {want}")]
    Function {
        /// What was asked.
        want: u8,
        /// What came.
        have: u8,
    },
    /// More or fewer bytes than were asked for.
    #[error("{have} bytes of data where function {function} has {want}")]
    Size {
        /// The function.
        function: u8,
        /// What was asked.
        want: usize,
        /// What came.
        have: usize,
    },
    /// The confirmation names something else than was written.
    #[error("function {0} confirms another write than the one that was asked for")]
    Echo(u8),
}

/// The answer to a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Response<'a> {
    /// Done, with the data that was asked for.
    Data(&'a [u8]),
    /// Refused, with the number that says why.
    Exception(u8),
}

/// One whole message as it came.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReceivedFrame<'a> {
    /// NumberType of the transaction.
    pub transaction: u16,
    /// Who answers.
    pub unit: u8,
    /// Function and data; at least 1 byte.
    body: &'a [u8],
}

impl<'a> ReceivedFrame<'a> {
    /// What it says to `message`.
    ///
    /// # Errors
    /// It is no answer to that.
    pub fn answer(&self, message: &EncodedRequest) -> Result<Response<'a>, FrameError> {
        let function = message.function();
        let (have, data) = self.body.split_first().ok_or(FrameError::Length(1))?;
        if *have == function | 0x80 {
            return match data {
                [code] => Ok(Response::Exception(*code)),
                _ => Err(FrameError::Size {
                    function,
                    want: 1,
                    have: data.len(),
                }),
            };
        }
        if *have != function {
            return Err(FrameError::Function {
                want: function,
                have: *have,
            });
        }
        let want = match message.expected {
            ExpectedResponse::Bits(count) => usize::from(count).div_ceil(8),
            ExpectedResponse::Registers(count) => 2 * usize::from(count),
            ExpectedResponse::Echo { bytes, length } => {
                return match data == &bytes[..length] {
                    true => Ok(Response::Data(&[])),
                    false => Err(FrameError::Echo(function)),
                };
            }
        };
        match data.split_first() {
            Some((count, data)) if usize::from(*count) == want && data.len() == want => {
                Ok(Response::Data(data))
            }
            _ => Err(FrameError::Size {
                function,
                want,
                have: data.len().saturating_sub(1),
            }),
        }
    }
}

/// Bit `index` of the data of functions 1 and 2; false beyond its end.
#[must_use]
pub fn bit(data: &[u8], index: usize) -> bool {
    data.get(index / 8)
        .is_some_and(|byte| byte >> (index % 8) & 1 == 1)
}

/// Register `index` of the data of functions 3 and 4; 0 beyond its end.
#[must_use]
pub fn register(data: &[u8], index: usize) -> u16 {
    match data.get(2 * index..2 * index + 2) {
        Some([high, low]) => u16::from_be_bytes([*high, *low]),
        _ => 0,
    }
}

/// What came and has not been looked at.
#[derive(Clone, Debug)]
pub struct ReceiveBuffer {
    bytes: [u8; KEPT_MAX],
    length: usize,
}

impl Default for ReceiveBuffer {
    fn default() -> Self {
        Self {
            bytes: [0; KEPT_MAX],
            length: 0,
        }
    }
}

impl ReceiveBuffer {
    /// Where the next bytes go; empty only while a whole message waits in it.
    pub fn room(&mut self) -> &mut [u8] {
        &mut self.bytes[self.length..]
    }

    /// So many bytes have been put into [`ReceiveBuffer::room`].
    pub fn filled(&mut self, count: usize) {
        self.length = (self.length + count).min(KEPT_MAX);
    }

    /// The first whole message; `take` is the length to give to [`ReceiveBuffer::forget`] afterwards.
    ///
    /// # Errors
    /// What came is not Modbus TCP, and nothing that follows can be understood.
    pub fn first(&self) -> Result<Option<(ReceivedFrame<'_>, usize)>, FrameError> {
        let bytes = &self.bytes[..self.length];
        let Some(header) = bytes.first_chunk::<HEADER>() else {
            return Ok(None);
        };
        let word = |place: usize| u16::from_be_bytes([header[place], header[place + 1]]);
        if word(2) != 0 {
            return Err(FrameError::Protocol(word(2)));
        }
        let length = word(4);
        let end = usize::from(length) + 6;
        if length < 2 || end > MESSAGE_MAX {
            return Err(FrameError::Length(length));
        }
        Ok(bytes.get(HEADER..end).map(|body| {
            let incoming = ReceivedFrame {
                transaction: word(0),
                unit: header[6],
                body,
            };
            (incoming, end)
        }))
    }

    /// Drops the first bytes.
    pub fn forget(&mut self, count: usize) {
        let count = count.min(self.length);
        self.bytes.copy_within(count..self.length, 0);
        self.length -= count;
    }

    /// Drops everything.
    pub fn clear(&mut self) {
        self.length = 0;
    }
}
