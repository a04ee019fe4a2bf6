//! `lwr-sim`: a simulated controller (KRC) of a KUKA LWR 4+ that speaks FRI 1.0 over UDP.
//! The main thread reads the command line and waits for the end; see `rcc_drivers::sim::lwr`.

#![deny(clippy::print_stdout, clippy::print_stderr)]

use clap::Parser;
use rcc_drivers::sim::lwr::{options::Options, program};
use std::process::ExitCode;

fn main() -> ExitCode {
    rcc_process::begin();
    let options = Options::parse();
    let result = program::run(&options, rcc_process::say);
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            rcc_process::remark(&format!("lwr-sim: {error}"));
            ExitCode::from(if matches!(error, program::RunError::Option(_)) {
                2
            } else {
                1
            })
        }
    }
}
