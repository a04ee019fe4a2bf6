//! `line-arm`: a driver's whole program.

use std::process::ExitCode;

use line_drivers::line_arm::{LineArm, REASONS};

fn main() -> ExitCode {
    rcc_driver_kit::program::<LineArm>("line-arm", REASONS)
}
