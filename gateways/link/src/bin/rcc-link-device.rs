//! `rcc-link-device`: the program of a device whose inputs are topics of another cell.

use std::process::ExitCode;

use rcc_config::link::LINK_DEVICE;
use rcc_link::device::{LinkDevice, REASONS};

fn main() -> ExitCode {
    rcc_driver_kit::program::<LinkDevice>(LINK_DEVICE, REASONS)
}
