//! `rcc-ethercat`: hosts the driver `ethercat` for one device of a cell, see [`rcc_driver_kit::program`].

#![deny(clippy::print_stdout, clippy::print_stderr)]

use std::process::ExitCode;

use rcc_driver_kit::driver::DriverEntry;
use rcc_ethercat::driver::{Ethercat, NAME, REASONS};

fn main() -> ExitCode {
    let drivers = [DriverEntry::new::<Ethercat>(NAME, REASONS)];
    rcc_driver_kit::program::main("rcc-ethercat", &drivers)
}
