//! `line-io`: a driver's whole program.

use std::process::ExitCode;

use line_drivers::line_io::{LineIo, REASONS};

fn main() -> ExitCode {
    rcc_driver_kit::program::<LineIo>("line-io", REASONS)
}
