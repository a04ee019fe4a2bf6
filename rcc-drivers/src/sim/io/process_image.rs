//! The process image of the simulated I/O station, and the Modbus requests that read and write it.
//! Pure; run by the server's thread under a lock that is never held for long.

use serde::Serialize;
use std::str::FromStr;
use tokio_modbus::{ExceptionCode, Request, Response};

/// Number of points of each kind.
pub const POINTS: usize = 64;

/// An output that is looped back to an input of the same type; addresses from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PointLoopback {
    /// Coil to discrete input.
    Bit {
        /// Address of the coil.
        coil: usize,
        /// Address of the discrete input.
        discrete: usize,
    },
    /// Holding register to input register.
    Word {
        /// Address of the holding register.
        holding: usize,
        /// Address of the input register.
        input: usize,
    },
}

/// An invalid loopback.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("invalid loopback `{0}`: write coil:N=discrete:N or holding:N=input:N with N from 0 to 63")]
pub struct LoopbackError(pub String);

impl FromStr for PointLoopback {
    type Err = LoopbackError;

    fn from_str(text: &str) -> Result<Self, LoopbackError> {
        let point = |part: &'_ str| -> Option<(String, usize)> {
            let (kind, address) = part.trim().split_once(':')?;
            let address = address.parse().ok().filter(|&address| address < POINTS)?;
            Some((kind.to_owned(), address))
        };
        let wire = text.split_once('=').and_then(|(from, to)| {
            let ((from, output), (to, input)) = (point(from)?, point(to)?);
            match (from.as_str(), to.as_str()) {
                ("coil", "discrete") => Some(Self::Bit {
                    coil: output,
                    discrete: input,
                }),
                ("holding", "input") => Some(Self::Word {
                    holding: output,
                    input,
                }),
                _ => None,
            }
        });
        wire.ok_or_else(|| LoopbackError(text.to_owned()))
    }
}

/// All points of the station and the request counters; addresses from 0.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ProcessImage {
    /// Digital outputs.
    pub coils: Vec<bool>,
    /// Digital inputs.
    pub discrete: Vec<bool>,
    /// Analog outputs.
    pub holding: Vec<u16>,
    /// Analog inputs.
    pub input: Vec<u16>,
    /// Requests since the start.
    pub requests: u64,
    /// Requests that wrote.
    pub writes: u64,
    /// Requests that were refused.
    pub refused: u64,
    #[serde(skip)]
    wires: Vec<PointLoopback>,
}

impl ProcessImage {
    /// A station with all points at 0.
    pub fn new(wires: Vec<PointLoopback>) -> Self {
        Self {
            coils: vec![false; POINTS],
            discrete: vec![false; POINTS],
            holding: vec![0; POINTS],
            input: vec![0; POINTS],
            requests: 0,
            writes: 0,
            refused: 0,
            wires,
        }
    }

    /// Executes a Modbus request completely or not at all.
    ///
    /// # Errors
    /// Returns `IllegalFunction` for functions that a simple I/O station does not support, and `IllegalDataAddress` for
    /// points that do not exist.
    pub fn answer(&mut self, request: &Request<'_>) -> Result<Response, ExceptionCode> {
        self.requests += 1;
        let answer = self.serve(request);
        self.refused += u64::from(answer.is_err());
        answer
    }

    fn serve(&mut self, request: &Request<'_>) -> Result<Response, ExceptionCode> {
        match request {
            Request::ReadCoils(first, count) => {
                Ok(Response::ReadCoils(read(&self.coils, *first, *count)?))
            }
            Request::ReadDiscreteInputs(first, count) => Ok(Response::ReadDiscreteInputs(read(
                &self.discrete,
                *first,
                *count,
            )?)),
            Request::ReadHoldingRegisters(first, count) => Ok(Response::ReadHoldingRegisters(
                read(&self.holding, *first, *count)?,
            )),
            Request::ReadInputRegisters(first, count) => Ok(Response::ReadInputRegisters(read(
                &self.input,
                *first,
                *count,
            )?)),
            Request::WriteSingleCoil(address, value) => {
                self.write_coils(*address, &[*value])?;
                Ok(Response::WriteSingleCoil(*address, *value))
            }
            Request::WriteMultipleCoils(first, values) => {
                self.write_coils(*first, values)?;
                Ok(Response::WriteMultipleCoils(*first, values.len() as u16))
            }
            Request::WriteSingleRegister(address, value) => {
                self.write_holding(*address, &[*value])?;
                Ok(Response::WriteSingleRegister(*address, *value))
            }
            Request::WriteMultipleRegisters(first, values) => {
                self.write_holding(*first, values)?;
                Ok(Response::WriteMultipleRegisters(
                    *first,
                    values.len() as u16,
                ))
            }
            Request::MaskWriteRegister(address, and, or) => {
                let [register] = read(&self.holding, *address, 1)?[..] else {
                    return Err(ExceptionCode::IllegalDataAddress);
                };
                self.write_holding(*address, &[(register & and) | (or & !and)])?;
                Ok(Response::MaskWriteRegister(*address, *and, *or))
            }
            // The standard writes before it reads: V1.1b3, section 6.17.
            Request::ReadWriteMultipleRegisters(first, count, written, values) => {
                read(&self.holding, *first, *count)?;
                self.write_holding(*written, values)?;
                Ok(Response::ReadWriteMultipleRegisters(read(
                    &self.holding,
                    *first,
                    *count,
                )?))
            }
            _ => Err(ExceptionCode::IllegalFunction),
        }
    }

    fn write_coils(&mut self, first: u16, values: &[bool]) -> Result<(), ExceptionCode> {
        write(&mut self.coils, first, values)?;
        self.apply_loopbacks();
        Ok(())
    }

    fn write_holding(&mut self, first: u16, values: &[u16]) -> Result<(), ExceptionCode> {
        write(&mut self.holding, first, values)?;
        self.apply_loopbacks();
        Ok(())
    }

    /// After a write, copies each looped-back output to its input.
    fn apply_loopbacks(&mut self) {
        self.writes += 1;
        for wire in &self.wires {
            match *wire {
                PointLoopback::Bit { coil, discrete } => self.discrete[discrete] = self.coils[coil],
                PointLoopback::Word { holding, input } => self.input[input] = self.holding[holding],
            }
        }
    }
}

fn read<T: Copy>(points: &[T], first: u16, count: u16) -> Result<Vec<T>, ExceptionCode> {
    if count == 0 {
        return Err(ExceptionCode::IllegalDataValue);
    }
    let (first, count) = (usize::from(first), usize::from(count));
    points
        .get(first..first + count)
        .map(<[T]>::to_vec)
        .ok_or(ExceptionCode::IllegalDataAddress)
}

fn write<T: Copy>(points: &mut [T], first: u16, values: &[T]) -> Result<(), ExceptionCode> {
    let first = usize::from(first);
    let range = points
        .get_mut(first..first + values.len())
        .ok_or(ExceptionCode::IllegalDataAddress)?;
    range.copy_from_slice(values);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_can_be_read_and_reaches_wired_inputs() {
        let wires = ["coil:0=discrete:5", "holding:63=input:0"].map(|wire| wire.parse().unwrap());
        let mut image = ProcessImage::new(wires.to_vec());
        image.answer(&Request::WriteSingleCoil(0, true)).unwrap();
        image
            .answer(&Request::WriteMultipleRegisters(62, vec![7, 8].into()))
            .unwrap();
        assert_eq!(
            image.answer(&Request::ReadCoils(0, 2)),
            Ok(Response::ReadCoils(vec![true, false]))
        );
        assert_eq!(
            image.answer(&Request::ReadDiscreteInputs(5, 1)),
            Ok(Response::ReadDiscreteInputs(vec![true]))
        );
        assert_eq!(
            image.answer(&Request::ReadInputRegisters(0, 1)),
            Ok(Response::ReadInputRegisters(vec![8]))
        );
        assert_eq!((image.requests, image.writes, image.refused), (5, 2, 0));
    }

    #[test]
    fn a_masked_write_changes_only_the_bits_outside_of_the_and_mask() {
        let mut image = ProcessImage::new(Vec::new());
        image.holding[4] = 0x12;
        image
            .answer(&Request::MaskWriteRegister(4, 0xF2, 0x25))
            .unwrap();
        // The example of MODBUS Application Protocol V1.1b3, section 6.16.
        assert_eq!(image.holding[4], 0x17);
    }

    #[test]
    fn function_23_writes_before_it_reads_and_does_neither_beyond_the_last_point() {
        let mut image = ProcessImage::new(Vec::new());
        let both = |first, written| {
            Request::ReadWriteMultipleRegisters(first, 3, written, vec![7, 8].into())
        };
        assert_eq!(
            image.answer(&both(3, 4)),
            Ok(Response::ReadWriteMultipleRegisters(vec![0, 7, 8]))
        );
        for request in [both(POINTS as u16 - 1, 10), both(0, POINTS as u16 - 1)] {
            let refused = image.answer(&request);
            assert_eq!(refused, Err(ExceptionCode::IllegalDataAddress));
        }
        assert_eq!((image.holding[10], image.writes), (0, 1));
    }

    #[test]
    fn a_request_beyond_the_last_point_is_refused_and_changes_nothing() {
        let mut image = ProcessImage::new(Vec::new());
        let before = image.coils.clone();
        let beyond = Request::WriteMultipleCoils(63, vec![true, true].into());
        assert_eq!(
            image.answer(&beyond),
            Err(ExceptionCode::IllegalDataAddress)
        );
        assert_eq!(image.coils, before);
        assert_eq!(
            image.answer(&Request::ReadInputRegisters(65_535, 2)),
            Err(ExceptionCode::IllegalDataAddress)
        );
        assert_eq!(
            image.answer(&Request::ReadCoils(0, 0)),
            Err(ExceptionCode::IllegalDataValue)
        );
        assert_eq!(
            image.answer(&Request::ReportServerId),
            Err(ExceptionCode::IllegalFunction)
        );
        assert_eq!(image.refused, 4);
    }

    #[test]
    fn a_wire_between_different_types_or_beyond_the_last_point_is_refused() {
        for text in [
            "coil:0=input:0",
            "coil:64=discrete:0",
            "coil:0",
            "discrete:0=coil:0",
            "holding:0=input:-1",
        ] {
            assert_eq!(
                text.parse::<PointLoopback>(),
                Err(LoopbackError(text.to_owned()))
            );
        }
    }
}
