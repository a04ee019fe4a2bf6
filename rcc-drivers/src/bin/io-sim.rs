//! `io-sim`: a simulated I/O station that speaks Modbus TCP.
//! The main thread reads the command line and waits for the end; see `rcc_drivers::sim::io`.

#![deny(clippy::print_stdout, clippy::print_stderr)]

use clap::Parser;
use rcc_drivers::sim::io::{options::Options, program};
use std::process::ExitCode;

fn main() -> ExitCode {
    rcc_process::begin();
    let options = Options::parse();
    let result = program::run(&options, rcc_process::say);
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            rcc_process::remark(&format!("io-sim: {error}"));
            ExitCode::FAILURE
        }
    }
}
