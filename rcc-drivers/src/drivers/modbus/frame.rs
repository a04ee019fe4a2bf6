//! Requests and responses of Modbus TCP as bytes (MODBUS Application Protocol V1.1b3; Messaging on TCP/IP V1.0b).
//! Pure, without heap allocation; used by the host's thread in each exchange.
//!
//! Own code rather than the client of `tokio-modbus`, which closes the connection when a response is late, allocates
//! for each transaction, and waits in steps of 1 ms.

use thiserror::Error;

use super::address::Table;

#[cfg(test)]
mod tests;

/// Longest message, including its header of 7 bytes.
pub const MESSAGE_MAX: usize = 260;
/// Size of the header: transaction, protocol, length and unit.
const HEADER: usize = 7;
/// Capacity of the receive buffer: one message and the start of further ones.
const KEPT_MAX: usize = 4 * MESSAGE_MAX;

/// A request; addresses start at 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModbusRequest<'a> {
    /// Functions 1 to 4.
    Read {
        /// Table to read from.
        table: Table,
        /// First point.
        first: u16,
        /// Number of points.
        count: u16,
    },
    /// Function 5 for one coil, 15 for several.
    WriteCoils {
        /// First coil.
        first: u16,
        /// Values.
        values: &'a [bool],
    },
    /// Function 6 for one register, 16 for several.
    WriteRegisters {
        /// First register.
        first: u16,
        /// Values.
        values: &'a [u16],
    },
    /// Function 22: changes the bits of `mask` in a register.
    Mask {
        /// Address of the register.
        address: u16,
        /// Bits to change.
        mask: u16,
        /// New values of these bits.
        values: u16,
    },
}

/// The response that a request requires.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExpectedResponse {
    /// This number of bits.
    Bits(u16),
    /// This number of registers.
    Registers(u16),
    /// An echo of these bytes.
    Echo {
        /// The expected bytes.
        bytes: [u8; 6],
        /// Number of bytes to compare.
        length: usize,
    },
}

/// A request as bytes.
#[derive(Clone, Copy, Debug)]
pub struct EncodedRequest {
    bytes: [u8; MESSAGE_MAX],
    length: usize,
    /// The response that it requires.
    pub expected: ExpectedResponse,
}

impl EncodedRequest {
    /// An empty request.
    pub const NONE: EncodedRequest = EncodedRequest {
        bytes: [0; MESSAGE_MAX],
        length: 0,
        expected: ExpectedResponse::Bits(0),
    };

    /// Encodes a request; returns `None` if it is longer than a message may be.
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

    /// Gives the request another transaction number.
    pub fn renumber(&mut self, transaction: u16) {
        self.bytes[..2].copy_from_slice(&transaction.to_be_bytes());
    }

    /// Returns the transaction number.
    #[must_use]
    pub fn transaction(&self) -> u16 {
        u16::from_be_bytes([self.bytes[0], self.bytes[1]])
    }

    /// Returns the function code.
    #[must_use]
    pub fn function(&self) -> u8 {
        self.bytes[HEADER]
    }

    /// Returns the bytes to send.
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

    /// Requires an echo of the first `length` bytes after the function code.
    fn echo(&self, length: usize) -> ExpectedResponse {
        let mut bytes = [0; 6];
        bytes[..length].copy_from_slice(&self.bytes[HEADER + 1..HEADER + 1 + length]);
        ExpectedResponse::Echo { bytes, length }
    }
}

/// Why received bytes are not a valid response.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum FrameError {
    /// The protocol identifier is not 0.
    #[error("protocol identifier {0}, expected 0")]
    Protocol(u16),
    /// An invalid length field.
    #[error("invalid message length of {0} bytes")]
    Length(u16),
    /// The function code does not match the request with this transaction number.
    #[error("a response of function {have} to a request of function {want}")]
    Function {
        /// Function code of the request.
        want: u8,
        /// Function code of the response.
        have: u8,
    },
    /// The response has the wrong size.
    #[error("{have} bytes of data, expected {want} for function {function}")]
    Size {
        /// Function code.
        function: u8,
        /// Expected number of bytes.
        want: usize,
        /// Received number of bytes.
        have: usize,
    },
    /// The confirmation does not echo the request; holds the function code.
    #[error("function {0} confirms a write that was not requested")]
    Echo(u8),
}

/// The response to a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Response<'a> {
    /// Success, with the requested data.
    Data(&'a [u8]),
    /// An exception with its code.
    Exception(u8),
}

/// One complete message as received.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReceivedFrame<'a> {
    /// Transaction number.
    pub transaction: u16,
    /// Unit that answers.
    pub unit: u8,
    /// Function code and data; at least 1 byte.
    body: &'a [u8],
}

impl<'a> ReceivedFrame<'a> {
    /// Interprets the frame as the response to `message`.
    ///
    /// # Errors
    /// Returns an error if it is not a valid response to that request.
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

/// Returns bit `index` of the data of functions 1 and 2; false beyond its end.
#[must_use]
pub fn bit(data: &[u8], index: usize) -> bool {
    data.get(index / 8)
        .is_some_and(|byte| byte >> (index % 8) & 1 == 1)
}

/// Returns register `index` of the data of functions 3 and 4; 0 beyond its end.
#[must_use]
pub fn register(data: &[u8], index: usize) -> u16 {
    match data.get(2 * index..2 * index + 2) {
        Some([high, low]) => u16::from_be_bytes([*high, *low]),
        _ => 0,
    }
}

/// Received bytes that have not been processed yet.
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
    /// Returns the free space for further bytes; empty only while a complete message is in the buffer.
    pub fn room(&mut self) -> &mut [u8] {
        &mut self.bytes[self.length..]
    }

    /// Appends the first `count` bytes of [`ReceiveBuffer::room`].
    pub fn filled(&mut self, count: usize) {
        self.length = (self.length + count).min(KEPT_MAX);
    }

    /// Returns the first complete message and its length, to be passed to [`ReceiveBuffer::forget`] afterwards.
    ///
    /// # Errors
    /// Returns an error if the bytes are not Modbus TCP; all further bytes are then invalid too.
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

    /// Removes the first bytes.
    pub fn forget(&mut self, count: usize) {
        let count = count.min(self.length);
        self.bytes.copy_within(count..self.length, 0);
        self.length -= count;
    }

    /// Removes all bytes.
    pub fn clear(&mut self) {
        self.length = 0;
    }
}
