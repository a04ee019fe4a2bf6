//! Everything that a driver is made with: the [`driver::Driver`] trait, the host around it, its program, and the conformance
//! suite. The drivers of RCC are made with it, and so is any driver in a repository of its own; `docs/drivers.md` begins
//! there.
//!
//! ```no_run
//! # use std::{process::ExitCode, time::Duration};
//! # use rcc_driver_kit::driver::{Driver, DriverError, Exchange, Inputs, LinkError, Outputs};
//! # struct Lamp;
//! # impl Driver for Lamp {
//! #     fn open(_: &rcc_driver_kit::rcc_config::DeviceConfig) -> Result<Self, DriverError> { Ok(Lamp) }
//! #     fn receive(&mut self, _: Duration, _: &mut Inputs) -> Result<Exchange, LinkError> { Err(LinkError::Silent) }
//! #     fn send(&mut self, _: &Outputs) -> Result<(), LinkError> { Ok(()) }
//! #     fn release(&mut self) {}
//! # }
//! fn main() -> ExitCode {
//!     rcc_driver_kit::program::<Lamp>("lamp", &[(100, "the lamp does not answer: check its supply")])
//! }
//! ```
//!
//! A program that was built against another layout of shared memory is refused by the executor, with both versions.

#![cfg_attr(
    not(any(test, feature = "conformance")),
    deny(clippy::print_stdout, clippy::print_stderr)
)]

pub use {rcc_config, rcc_core, serde_json, tracing};

#[cfg(any(test, feature = "conformance"))]
pub mod conformance;
pub mod driver;
pub mod host;
pub mod listen;
pub mod priority;
pub mod program;
pub mod proxy;

use std::process::ExitCode;

use driver::{Driver, DriverEntry};
use host::reason::Reason;

/// Is the whole program of one driver: reads its arguments, and hosts the driver until it is asked to stop.
/// `reasons` are the driver's reason numbers, from 100.
#[must_use]
pub fn program<D: Driver + 'static>(name: &'static str, reasons: &'static [Reason]) -> ExitCode {
    program::main(name, &[DriverEntry::new::<D>(name, reasons)])
}
