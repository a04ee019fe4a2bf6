//! `abort NAME`: ends a net at once; the drivers bring its devices to rest.

use rcc_api::bodies::Done;
use rcc_process::priority::raise_stop_thread;

use super::NetName;
use crate::context::Context;
use crate::failure::Failure;
use crate::follow;
use crate::table::grouped;

/// Arguments of `abort`.
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
    raise_stop_thread();
    let client = context.client()?;
    let done: Done = follow::operate(&client, &arguments.named.name, "abort")?;
    context.print(&done, |done| {
        format!(
            "{}#{}  aborted  at cycle {}",
            done.net,
            done.id,
            grouped(done.cycle)
        )
    });
    Ok(())
}
