//! `start NAME…`: evaluated from the next cycle on; with `--after-stopping` others end between the same two cycles.

use rcc_loader::server::api::{Done, Switched};

use crate::context::Context;
use crate::failure::Failure;
use crate::follow;
use crate::table::grouped;

/// Which nets.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Id, name of the net (then the newest of that name), or name#id; several start in the same cycle, all or none.
    #[arg(required = true, value_name = "NAME")]
    names: Vec<String>,
    /// End these between the same two cycles; an arm goes on without a gap. If that cannot be, nothing changes.
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    after_stopping: Vec<String>,
}

/// Does it.
///
/// # Errors
/// Not reachable, or refused.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let client = context.client()?;
    if let ([name], []) = (&arguments.names[..], &arguments.after_stopping[..]) {
        let done: Done = follow::operate(&client, name, "start")?;
        context.print(&done, began);
        return Ok(());
    }
    let switched = follow::switch(&client, &arguments.after_stopping, &arguments.names)?;
    context.print(&switched, |switched: &Switched| {
        let stopped = switched.stopped.iter().map(|done| {
            let last = grouped(done.cycle.saturating_sub(1));
            format!("{}#{}  stopped  after cycle {last}", done.net, done.id)
        });
        let lines: Vec<String> = stopped.chain(switched.started.iter().map(began)).collect();
        lines.join("\n")
    });
    Ok(())
}

fn began(done: &Done) -> String {
    format!(
        "{}#{}  running  at cycle {}",
        done.net,
        done.id,
        grouped(done.cycle)
    )
}
