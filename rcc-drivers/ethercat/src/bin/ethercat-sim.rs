//! `ethercat-sim`: a simulated line of EtherCAT terminals.
//! The main thread reads the command line and waits for the end; see `rcc_ethercat::sim`.

#![deny(clippy::print_stdout, clippy::print_stderr)]

use std::process::ExitCode;

use clap::Parser;
use rcc_ethercat::sim::{options::Options, program};

fn main() -> ExitCode {
    rcc_process::begin();
    let options = Options::parse();
    match program::run(&options, rcc_process::say) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            rcc_process::remark(&format!("ethercat-sim: {error}"));
            ExitCode::FAILURE
        }
    }
}
