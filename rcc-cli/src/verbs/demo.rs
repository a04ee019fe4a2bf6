//! `demo`: the paper's figures on a simulated robot, verified from data.

use crate::context::Context;
use crate::failure::Failure;

/// Nothing more to say.
#[derive(clap::Args, Debug)]
pub struct Arguments {}

/// Does it.
///
/// # Errors
/// The cell does not come up, or something that was measured is not as it must be.
pub fn run(context: &Context, _arguments: Arguments) -> Result<(), Failure> {
    crate::demo::run(context)
}
