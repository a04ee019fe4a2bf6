//! The loader of the cell, as its clients reach it.

use std::time::Duration;

use rcc_client::{LoaderClient, RequestError};

/// Time limit of a request to the loader.
pub const TIMEOUT: Duration = Duration::from_secs(5);

/// Returns a client of the loader of a cell, which need not run.
///
/// # Errors
/// Fails if the system refuses an event queue.
pub fn loader(cell: &str) -> Result<LoaderClient, RequestError> {
    LoaderClient::local(cell, TIMEOUT)
}
