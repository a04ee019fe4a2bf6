//! `wait NAME…`: waits until nets have ended, and reports how, as text and as the exit code. Changes nothing: Ctrl-C ends
//! the waiting, not the nets.

use std::time::{Duration, Instant};

use rcc_api::bodies::CommandView;
use rcc_api::codes::{self, RequestedEnd};

use crate::client::LoaderClient;
use crate::context::{Context, OutputFormat};
use crate::failure::Failure;
use crate::follow::{self, CommandPoll};
use crate::interrupt::Interrupts;
use crate::output::{print_line, print_note};

/// Time for which a net may be ready before the user is told that nobody has started it; the snapshot is a few cycles
/// older than a START that was just answered.
const READY_NOTE_AFTER: Duration = Duration::from_secs(1);

/// Arguments of `wait`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Nets: id, name (the newest with that name), or name#id
    #[arg(required = true, value_name = "NAME")]
    names: Vec<String>,
    /// Longest time to wait for all of them
    #[arg(long = "for", value_name = "TIME", value_parser = super::duration)]
    limit: Option<Duration>,
}

/// Runs the verb.
///
/// # Errors
/// Fails if the loader cannot be reached, if a net does not exist or does not end in time, on Ctrl-C, and with the exit
/// code of the first net in the order of the arguments that did not finish.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let interrupts = Interrupts::listen()?;
    let client = context.client()?;
    // From now on these commands are meant, whatever is loaded under their names.
    let named = arguments.names.iter();
    let commands = named.map(|name| follow::even_unloaded(&client, name));
    let commands: Vec<CommandView> = commands.collect::<Result<_, Failure>>()?;
    let started = Instant::now();
    let mut result = Ok(());
    for command in commands {
        let ended = end_of(&client, &interrupts, &command, started, arguments.limit)?;
        print(context, &ended);
        let judged = follow::exit_result(&ended, RequestedEnd::Finish);
        result = result.and(judged);
    }
    result
}

fn end_of(
    client: &LoaderClient,
    interrupts: &Interrupts,
    command: &CommandView,
    started: Instant,
    limit: Option<Duration>,
) -> Result<CommandView, Failure> {
    let title = follow::title(command);
    let mut poll = CommandPoll::new(command.id);
    let (begun, mut noted) = (Instant::now(), false);
    loop {
        if let Some(command) = poll.state(client)? {
            if follow::is_over(&command) {
                return Ok(command);
            }
            if command.state == "ready" && !noted && begun.elapsed() > READY_NOTE_AFTER {
                print_note(&format!(
                    "{title} is ready: `rcc-cli start {title}` starts it"
                ));
                noted = true;
            }
            if let Some(limit) = limit.filter(|limit| started.elapsed() > *limit) {
                return Err(Failure::new(
                    codes::LOADER_SILENT,
                    format!("{title} is still {} after {limit:?}", command.state),
                    format!("allow more time with --for, or end it with `rcc-cli cancel {title}`"),
                ));
            }
        }
        if interrupts.asked() {
            return Err(Failure::interrupted());
        }
        std::thread::sleep(follow::POLL_INTERVAL);
    }
}

fn print(context: &Context, command: &CommandView) {
    match context.format {
        OutputFormat::Human => print_line(&format!(
            "{}  {}",
            follow::title(command),
            follow::state_text(command)
        )),
        OutputFormat::Json => context.print(command, |_| String::new()),
    }
}
