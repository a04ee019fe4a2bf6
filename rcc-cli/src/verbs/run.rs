//! `run FILE`: loads, starts, follows and unloads a net. The first Ctrl-C cancels it (or aborts a net that cannot be
//! canceled), the second one aborts it. A failure to print never ends the supervision of the net.

use rcc_api::bodies::CommandView;
use rcc_api::codes::{RequestedEnd, exit};

use crate::client::LoaderClient;
use crate::context::{Context, OutputFormat};
use crate::failure::{Failure, draw};
use crate::follow::{self, CommandPoll, OnRejection};
use crate::interrupt::Interrupts;
use crate::output::{BackgroundPrinter, print_diagnostics};

/// Arguments of `run`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Net (YAML or JSON); - reads standard input
    file: String,
    /// Keep the net loaded at the end
    #[arg(long)]
    keep: bool,
}

/// Runs the verb.
///
/// # Errors
/// Fails if the loader cannot be reached or refuses, or if the net ends otherwise than `finished`, for whatever reason.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let source = follow::read_net(&arguments.file)?;
    let client = context.client()?;
    let interrupts = Interrupts::listen()?;
    let loaded = follow::load(&client, &source.0, &source.1, OnRejection::Unload)?;
    print_diagnostics(&draw(
        &loaded.diagnostics,
        Some(&source),
        Context::drawing(),
    ));
    let printer = BackgroundPrinter::start();
    let show = |line: &str| {
        if context.format == OutputFormat::Human {
            printer.print_line(line);
        }
    };
    let outcome = start_and_follow(&show, &client, &interrupts, &loaded);
    if !arguments.keep {
        // The result of the run counts more than a command that could not be unloaded.
        let _ = follow::unload(&client, &loaded.id.to_string());
    }
    printer.finish();
    let command = outcome?;
    if context.format == OutputFormat::Json {
        context.print(&command, |_| String::new());
    }
    // The user has interrupted the run, whether the net was then canceled, aborted or had just finished.
    if interrupts.asked() && command.fault.is_none() {
        return Err(Failure::interrupted());
    }
    follow::exit_result(&command, RequestedEnd::Finish)
}

fn start_and_follow(
    show: &dyn Fn(&str),
    client: &LoaderClient,
    interrupts: &Interrupts,
    loaded: &CommandView,
) -> Result<CommandView, Failure> {
    let id = loaded.id.to_string();
    if interrupts.asked() {
        return Err(Failure::interrupted());
    }
    follow::operate(client, &id, "start")?;
    let (mut shown, mut obeyed) = (String::new(), 0);
    let mut poll = CommandPoll::new(loaded.id);
    loop {
        let Some(command) = poll.state(client)? else {
            std::thread::sleep(follow::POLL_INTERVAL);
            continue;
        };
        let state = follow::state_text(&command);
        // The snapshot may be a few cycles older than the START that was just answered.
        let old = command.state == "ready";
        if state != shown && !old {
            show(&format!("{}  {state}", follow::title(&command)));
            shown = state;
        }
        if follow::is_over(&command) {
            return Ok(command);
        }
        let asked = interrupts.count();
        if asked > obeyed {
            let gently = obeyed == 0 && asked == 1 && command.can_cancel;
            obeyed = asked;
            let what = if gently { "cancel" } else { "abort" };
            match follow::operate(client, &id, what) {
                // It ended in between: the next poll shows how.
                Err(failure) if failure.exit == exit::CONFLICT => {}
                done => drop(done?),
            }
        }
        std::thread::sleep(follow::POLL_INTERVAL);
    }
}
