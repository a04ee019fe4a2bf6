//! `run FILE`: load, start, follow, unload. The first Ctrl-C cancels (aborts a net that cannot be cancelled), the
//! second one aborts. What it prints is never a reason to leave the net alone.

use std::time::{Duration, Instant};

use rcc_loader::server::api::CommandView;
use rcc_loader::server::codes::{RequestedEnd, exit};

use crate::client::Client;
use crate::context::{Context, Format};
use crate::failure::{Failure, draw};
use crate::follow::{self, OnRejection};
use crate::interrupt::Interrupts;
use crate::output::{Printer, print_diagnostics};

/// How long a loader that died is waited for.
const PATIENCE: Duration = Duration::from_secs(5);

/// What to run.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// A net, YAML or JSON; - is the standard input.
    file: String,
    /// Leave it loaded at the end.
    #[arg(long)]
    keep: bool,
}

/// Does it.
///
/// # Errors
/// Not reachable, refused, or ended otherwise than `finished`, by whomever.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let source = follow::read_net(&arguments.file)?;
    let client = context.client()?;
    let interrupts = Interrupts::listen()?;
    let loaded = follow::load(&client, &source.0, &source.1, OnRejection::Unload)?;
    print_diagnostics(&draw(&loaded.diagnostics, Some(&source), Context::colour()));
    let printer = Printer::start();
    let show = |line: &str| {
        if context.format == Format::Human {
            printer.print_line(line);
        }
    };
    let outcome = start_and_follow(&show, &client, &interrupts, &loaded);
    if !arguments.keep {
        // What is said about the run counts more than a row that could not be freed.
        let _ = follow::unload(&client, loaded.id);
    }
    printer.finish();
    let command = outcome?;
    if context.format == Format::Json {
        context.print(&command, |_| String::new());
    }
    // Canceled, aborted or just finished: whoever asked for it has taken that back.
    if interrupts.asked() && command.fault.is_none() {
        return Err(Failure::interrupted());
    }
    follow::judge(&command, RequestedEnd::Finish)
}

fn start_and_follow(
    show: &dyn Fn(&str),
    client: &Client,
    interrupts: &Interrupts,
    loaded: &CommandView,
) -> Result<CommandView, Failure> {
    let id = loaded.id.to_string();
    if interrupts.asked() {
        return Err(Failure::interrupted());
    }
    follow::operate(client, &id, "start")?;
    let (mut shown, mut obeyed) = (String::new(), 0);
    let mut answered = Instant::now();
    loop {
        let command = match follow::brief(client, &id) {
            // A loader that died is started again; the net runs on meanwhile.
            Err(failure) if failure.exit == exit::UNREACHABLE && answered.elapsed() < PATIENCE => {
                std::thread::sleep(follow::POLL);
                continue;
            }
            state => state?,
        };
        answered = Instant::now();
        let words = follow::state_words(&command);
        // A snapshot may be a few cycles older than the START that was just answered.
        let old = command.state == "ready";
        if words != shown && !old {
            show(&format!("{}  {words}", follow::title(&command)));
            shown = words;
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
                // It ended in between: the next look tells how.
                Err(failure) if failure.exit == exit::CONFLICT => {}
                done => drop(done?),
            }
        }
        std::thread::sleep(follow::POLL);
    }
}
