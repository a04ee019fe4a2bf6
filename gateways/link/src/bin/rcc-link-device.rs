//! `rcc-link-device`: the program of a device whose inputs are topics of another cell.

use std::process::ExitCode;

use rcc_link::device::{DEVICE_PROGRAM, LinkDevice, REASONS};

fn main() -> ExitCode {
    rcc_driver_kit::program::<LinkDevice>(DEVICE_PROGRAM, REASONS)
}
