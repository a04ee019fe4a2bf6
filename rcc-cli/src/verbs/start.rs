//! `start NAME…`: starts nets at the next cycle; with `--after-stopping`, ends others between the same two cycles.

use rcc_api::bodies::{Done, Switched};

use crate::context::Context;
use crate::failure::Failure;
use crate::follow;
use crate::table::grouped;

/// Arguments of `start`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Nets: id, name (the newest with that name), or name#id; several start in the same cycle, all or none
    #[arg(required = true, value_name = "NAME")]
    names: Vec<String>,
    /// End these nets between the same two cycles, so that an arm continues without a gap; if that fails, nothing
    /// changes
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    after_stopping: Vec<String>,
}

/// Runs the verb.
///
/// # Errors
/// Fails if the loader cannot be reached or refuses.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let client = context.client()?;
    if let ([name], []) = (&arguments.names[..], &arguments.after_stopping[..]) {
        let done: Done = follow::operate(&client, name, "start")?;
        context.print(&done, started_line);
        return Ok(());
    }
    let switched = follow::switch(&client, &arguments.after_stopping, &arguments.names)?;
    context.print(&switched, |switched: &Switched| {
        let stopped = switched.stopped.iter().map(|done| {
            let last = grouped(done.cycle.saturating_sub(1));
            format!("{}#{}  stopped  after cycle {last}", done.net, done.id)
        });
        let lines: Vec<String> = stopped
            .chain(switched.started.iter().map(started_line))
            .collect();
        lines.join("\n")
    });
    Ok(())
}

fn started_line(done: &Done) -> String {
    format!(
        "{}#{}  running  at cycle {}",
        done.net,
        done.id,
        grouped(done.cycle)
    )
}
