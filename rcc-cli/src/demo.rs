//! The demo.
use crate::context::Context;
use crate::failure::Failure;
/// Runs it.
///
/// # Errors
/// Not yet.
pub fn run(_context: &Context) -> Result<(), Failure> {
    Ok(())
}
