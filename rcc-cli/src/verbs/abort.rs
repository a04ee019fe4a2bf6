//! `abort NAME`: ends a net at once; the drivers bring its devices to rest.

use rcc_loader::server::api::Done;

use super::NetName;
use crate::context::Context;
use crate::failure::Failure;
use crate::follow;
use crate::table::grouped;

/// Which net.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    #[command(flatten)]
    named: NetName,
}

/// Does it.
///
/// # Errors
/// Not reachable, or refused.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
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
