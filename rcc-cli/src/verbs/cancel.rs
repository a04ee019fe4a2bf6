//! `cancel NAME [--wait]`: asks a net to end in its own way, and reports how it ended, as text and as the exit code.

use std::time::Instant;

use rcc_api::bodies::CommandView;
use rcc_api::codes::{self, RequestedEnd};
use rcc_process::priority::raise_stop_thread;

use super::NetName;
use crate::context::Context;
use crate::failure::Failure;
use crate::follow::{self, CommandPoll};

/// Arguments of `cancel`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    #[command(flatten)]
    named: NetName,
    /// Wait until the net has ended, or for the given time; ends with 8 if it was canceled, 0 if it finished first
    #[arg(long, value_name = "TIME", num_args = 0..=1, default_missing_value = "30s", value_parser = super::duration)]
    wait: Option<std::time::Duration>,
}

/// Runs the verb.
///
/// # Errors
/// Fails if the loader cannot be reached or refuses; with `--wait` also if the net does not end in time, and with the
/// exit code of every end but `finished`.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    raise_stop_thread();
    let client = context.client()?;
    let started = Instant::now();
    let done = follow::operate(&client, &arguments.named.name, "cancel")?;
    let Some(patience) = arguments.wait else {
        context.print(&done, |done| format!("{}#{}  canceling", done.net, done.id));
        return Ok(());
    };
    let title = format!("{}#{}", done.net, done.id);
    let (mut poll, mut state) = (CommandPoll::new(done.id), "canceling".to_owned());
    loop {
        // Also after somebody unloaded it, which `rcc-cli run` does as soon as its net has ended.
        if let Some(command) = poll.state(&client)? {
            if follow::is_over(&command) {
                context.print(&command, |command: &CommandView| {
                    let state = follow::state_text(command);
                    let passed = started.elapsed().as_secs_f64();
                    let first = match command.reason.as_deref() {
                        Some("finished") => ", before it could be canceled",
                        _ => "",
                    };
                    format!("{title}  {state}  after {passed:.2} s{first}")
                });
                return follow::exit_result(&command, RequestedEnd::Finish);
            }
            state = command.state;
        }
        if started.elapsed() > patience {
            return Err(Failure::new(
                codes::LOADER_SILENT,
                format!("{title} is still {state} after {patience:?}"),
                format!("allow more time, or end it at once with `rcc-cli abort {title}`"),
            ));
        }
        std::thread::sleep(follow::POLL_INTERVAL);
    }
}
