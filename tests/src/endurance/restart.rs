//! Restarts the drivers, and all processes, after they were killed. The thread that owns a process does so at the beginning
//! of a round, and others do it for that thread while it waits for the end of all rounds.

use super::field::{ARM, Field, IO, held};
use crate::cell_fixture::ExecutorBoards;
use crate::process::Process;

/// Starts the driver of a device if it was killed.
pub fn driver(field: &Field<'_>, driver: &mut Process, watch: &ExecutorBoards, device: usize) {
    if driver.ended().is_some() {
        let pid = driver.start(field.place);
        field.clean();
        field.await_driver(watch, device, pid);
    }
}

/// Starts every process that was killed together with another one.
pub fn all(field: &Field<'_>) {
    let watch = field.place.watch();
    field.restart_loader(&mut held(&field.loader));
    driver(field, &mut held(&field.io_driver), &watch, IO);
    driver(field, &mut held(&field.arm_driver), &watch, ARM);
}
