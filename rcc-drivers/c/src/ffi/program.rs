//! `rcc_driver_main`: the whole program of a driver whose table is written in C. Run by the main thread.
#![allow(unsafe_code)]

use std::ffi::c_int;
use std::sync::OnceLock;

use rcc_driver_kit::driver::DriverEntry;

use super::Description;
use super::raw::RawDriver;
use crate::c_driver::{CDriver, DriverTable};

/// Exit code of a program whose table cannot be used, as for a wrong configuration: starting it again does not help.
const UNUSABLE: c_int = 78;

/// The table that `rcc_driver_main` was called with.
static MAIN: OnceLock<Description> = OnceLock::new();

/// The driver of [`MAIN`].
#[derive(Debug)]
enum MainTable {}

impl DriverTable for MainTable {
    fn description() -> Option<&'static Description> {
        MAIN.get()
    }
}

/// `rcc_driver_main`: the whole program of a driver.
///
/// # Safety
/// `driver` is NULL, or points to an `rcc_driver` that, with all that it points to, is constant and lives as long as the
/// program.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn rcc_driver_main(driver: *const RawDriver) -> c_int {
    // SAFETY: as the caller promises.
    let table = match unsafe { Description::read(driver) } {
        Ok(table) => MAIN.get_or_init(|| table),
        Err(error) => {
            eprintln!("{error}");
            return UNUSABLE;
        }
    };
    // As Rust's own programs begin: a peer that closes its end is an error of that write, not the end of the process.
    // SAFETY: no handler is installed, and no other thread runs yet.
    unsafe { libc::signal(libc::SIGPIPE, libc::SIG_IGN) };
    let entry = DriverEntry::new::<CDriver<MainTable>>(table.name, table.reasons);
    let ended = rcc_driver_kit::program::main(table.name, &[entry]);
    // The number of an ExitCode cannot be read, but compared.
    let number = (0..=u8::MAX).find(|number| std::process::ExitCode::from(*number) == ended);
    c_int::from(number.unwrap_or(1))
}
