//! `cancel NAME [--wait]`: asks a net to end in its own way, and tells how it did.

use std::time::Instant;

use rcc_loader::server::api::CommandView;
use rcc_loader::server::codes::{self, RequestedEnd};

use super::NetName;
use crate::context::Context;
use crate::failure::Failure;
use crate::follow;

/// Which net.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    #[command(flatten)]
    named: NetName,
    /// Wait until it is over, or the given time.
    #[arg(long, value_name = "TIME", num_args = 0..=1, default_missing_value = "30s", value_parser = super::duration)]
    wait: Option<std::time::Duration>,
}

/// Does it.
///
/// # Errors
/// Not reachable, refused, not over in time, or ended by a fault or an abort.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let client = context.client()?;
    let begun = Instant::now();
    let done = follow::operate(&client, &arguments.named.name, "cancel")?;
    let Some(patience) = arguments.wait else {
        context.print(&done, |done| format!("{}#{}  canceling", done.net, done.id));
        return Ok(());
    };
    loop {
        let command = follow::brief(&client, &done.id.to_string())?;
        if follow::is_over(&command) {
            context.print(&command, |command: &CommandView| {
                let (title, state) = (follow::title(command), follow::state_words(command));
                let passed = begun.elapsed().as_secs_f64();
                let first = match command.reason.as_deref() {
                    Some("finished") => ", before it could be canceled",
                    _ => "",
                };
                format!("{title}  {state}  after {passed:.2} s{first}")
            });
            return follow::judge(&command, RequestedEnd::Cancel);
        }
        if begun.elapsed() > patience {
            let title = follow::title(&command);
            return Err(Failure::new(
                codes::LOADER_SILENT,
                format!("{title} is still {} after {patience:?}", command.state),
                format!("allow more time, or end it at once with `rcc-cli abort {title}`"),
            ));
        }
        std::thread::sleep(follow::POLL);
    }
}
