//! One connection to a Modbus server: reads all inputs, writes the outputs that have changed.
//! Run by the host's thread inside the driver's runtime.

use std::future::Future;
use std::io;
use std::net::SocketAddr;
use std::time::Duration;

use rcc_core::message::{ANALOG_MAX, DIGITAL_MAX};
use thiserror::Error;
use tokio_modbus::client::{Context, Reader, Writer, tcp};
use tokio_modbus::{ExceptionCode, Slave};

use super::points::{Point, Points, Table, runs};
use crate::driver::{Inputs, Outputs};

/// Why a connection is given up.
#[derive(Debug, Error)]
pub enum LinkFault {
    /// There is none.
    #[error("the server is not reached: {0}")]
    Connect(io::Error),
    /// It broke.
    #[error("the connection broke: {0}")]
    Transport(tokio_modbus::Error),
    /// No answer.
    #[error("no answer within {} ms", timeout.as_millis())]
    Timeout {
        /// How long was waited.
        timeout: Duration,
    },
    /// The server says no.
    #[error("the server refuses {table:?} {address} and what follows: {code}")]
    Exception {
        /// Table of the first point.
        table: Table,
        /// Its address.
        address: u16,
        /// What the server said.
        code: ExceptionCode,
    },
}

/// The connection and what has been written on it.
pub struct Link {
    context: Context,
    coils: [Option<bool>; DIGITAL_MAX],
    registers: [Option<u16>; ANALOG_MAX],
}

impl std::fmt::Debug for Link {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str("Link")
    }
}

/// An output that is to be written.
struct Change<'a, T> {
    point: &'a Point,
    value: T,
}

impl<T> AsRef<Point> for Change<'_, T> {
    fn as_ref(&self) -> &Point {
        self.point
    }
}

impl Link {
    /// A new connection on which nothing has been written.
    pub async fn connect(
        server: SocketAddr,
        unit: u8,
        timeout: Duration,
    ) -> Result<Self, LinkFault> {
        let attempt = tcp::connect_slave(server, Slave(unit));
        let context = tokio::time::timeout(timeout, attempt)
            .await
            .map_err(|_| LinkFault::Timeout { timeout })?
            .map_err(LinkFault::Connect)?;
        Ok(Self {
            context,
            coils: [None; DIGITAL_MAX],
            registers: [None; ANALOG_MAX],
        })
    }

    /// Reads all inputs.
    pub async fn read(
        &mut self,
        points: &Points,
        timeout: Duration,
        inputs: &mut Inputs,
    ) -> Result<(), LinkFault> {
        for run in runs(&points.digital_inputs) {
            let (first, count) = (&run[0], run.len() as u16);
            let bits = match first.table {
                Table::Coil => {
                    let call = self.context.read_coils(first.address, count);
                    transaction(call, first, timeout).await?
                }
                _ => {
                    let call = self.context.read_discrete_inputs(first.address, count);
                    transaction(call, first, timeout).await?
                }
            };
            for (point, on) in run.iter().zip(bits) {
                let bit = 1_u64 << point.index;
                inputs.digital = (inputs.digital & !bit) | if on { bit } else { 0 };
                inputs.digital_known |= bit;
            }
        }
        for run in runs(&points.analog_inputs) {
            let (first, count) = (&run[0], run.len() as u16);
            let registers = match first.table {
                Table::Holding => {
                    let call = self.context.read_holding_registers(first.address, count);
                    transaction(call, first, timeout).await?
                }
                _ => {
                    let call = self.context.read_input_registers(first.address, count);
                    transaction(call, first, timeout).await?
                }
            };
            for (point, register) in run.iter().zip(registers) {
                if let Some(place) = inputs.analog.get_mut(point.index) {
                    *place = point.value(register);
                }
            }
        }
        Ok(())
    }

    /// Writes the outputs that have a value which this connection has not written last.
    pub async fn write(
        &mut self,
        points: &Points,
        timeout: Duration,
        outputs: &Outputs,
    ) -> Result<(), LinkFault> {
        let coils: Vec<Change<'_, bool>> = points
            .digital_outputs
            .iter()
            .filter(|point| outputs.digital_set >> point.index & 1 == 1)
            .map(|point| Change {
                point,
                value: outputs.digital >> point.index & 1 == 1,
            })
            .filter(|change| self.coils[change.point.index] != Some(change.value))
            .collect();
        for run in runs(&coils) {
            let first = run[0].point;
            let values: Vec<bool> = run.iter().map(|change| change.value).collect();
            match values[..] {
                [value] => {
                    let call = self.context.write_single_coil(first.address, value);
                    transaction(call, first, timeout).await?;
                }
                _ => {
                    let call = self.context.write_multiple_coils(first.address, &values);
                    transaction(call, first, timeout).await?;
                }
            }
            for change in run {
                self.coils[change.point.index] = Some(change.value);
            }
        }
        self.write_registers(points, timeout, outputs).await
    }

    async fn write_registers(
        &mut self,
        points: &Points,
        timeout: Duration,
        outputs: &Outputs,
    ) -> Result<(), LinkFault> {
        let registers: Vec<Change<'_, u16>> = points
            .analog_outputs
            .iter()
            .filter_map(|point| {
                // Without a value it is NaN, which no register holds.
                let value = point.register(*outputs.analog.get(point.index)?)?;
                Some(Change { point, value })
            })
            .filter(|change| self.registers[change.point.index] != Some(change.value))
            .collect();
        for run in runs(&registers) {
            let first = run[0].point;
            let values: Vec<u16> = run.iter().map(|change| change.value).collect();
            match values[..] {
                [value] => {
                    let call = self.context.write_single_register(first.address, value);
                    transaction(call, first, timeout).await?;
                }
                _ => {
                    let call = self
                        .context
                        .write_multiple_registers(first.address, &values);
                    transaction(call, first, timeout).await?;
                }
            }
            for change in run {
                self.registers[change.point.index] = Some(change.value);
            }
        }
        Ok(())
    }
}

async fn transaction<T>(
    call: impl Future<Output = tokio_modbus::Result<T>>,
    first: &Point,
    timeout: Duration,
) -> Result<T, LinkFault> {
    match tokio::time::timeout(timeout, call).await {
        Err(_) => Err(LinkFault::Timeout { timeout }),
        Ok(Err(error)) => Err(LinkFault::Transport(error)),
        Ok(Ok(Err(code))) => Err(LinkFault::Exception {
            table: first.table,
            address: first.address,
            code,
        }),
        Ok(Ok(Ok(value))) => Ok(value),
    }
}
