//! `rcc-driver`: hosts one of RCC's own drivers for one device of a cell, see [`rcc_driver_kit::program`].

#![deny(clippy::print_stdout, clippy::print_stderr)]

use std::process::ExitCode;

fn main() -> ExitCode {
    rcc_driver_kit::program::main("rcc-driver", rcc_drivers::drivers::DRIVERS)
}
