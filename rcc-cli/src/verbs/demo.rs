//! `demo`: runs the paper's figures on a simulated robot and verifies the recorded data.

use crate::context::Context;
use crate::failure::Failure;

/// Arguments of `demo`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Serve the dashboard too, open it in the desktop's browser if there is one, and keep the cell until Ctrl-C
    #[arg(long)]
    open: bool,
}

/// Runs the verb.
///
/// # Errors
/// Fails if the cell does not start or a check does not hold.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    crate::demo::run(context, arguments.open)
}
