//! `unload NAME`: unloads a net that is not active.

use rcc_api::bodies::Done;

use super::NetName;
use crate::client::segment;
use crate::context::Context;
use crate::failure::Failure;

/// Arguments of `unload`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    #[command(flatten)]
    named: NetName,
}

/// Runs the verb.
///
/// # Errors
/// Fails if the loader cannot be reached or refuses.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let path = format!("/commands/{}", segment(&arguments.named.name));
    let done: Done = context.client()?.delete(&path)?;
    context.print(&done, |done| format!("{}#{}  unloaded", done.net, done.id));
    Ok(())
}
