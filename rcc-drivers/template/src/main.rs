//! `line-io`: a driver's whole program.

use std::process::ExitCode;

mod line_io;

fn main() -> ExitCode {
    rcc_driver_kit::program::<line_io::LineIo>("line-io", line_io::REASONS)
}
