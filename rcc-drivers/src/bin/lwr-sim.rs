//! `lwr-sim`: the controller's side of a KUKA LWR 4+, over FRI 1.0 on UDP.
//! The main thread reads the command line and waits for the end; see `rcc_drivers::sim::lwr`.

use clap::Parser;
use rcc_core::printable::Printable;
use rcc_drivers::sim::lwr::{options::Options, program};
use std::io::Write;
use std::process::ExitCode;

fn main() -> ExitCode {
    rcc_process::log();
    let options = Options::parse();
    let result = program::run(&options, |line| {
        // whoever started it may not care to read; that is no reason to end
        let _ = writeln!(std::io::stdout(), "{line}");
    });
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("lwr-sim: {}", Printable(&error.to_string()));
            ExitCode::from(if matches!(error, program::RunError::Option(_)) {
                2
            } else {
                1
            })
        }
    }
}
