//! `up FILE`: starts a cell from a configuration file and supervises it until Ctrl-C, whether or not anybody reads its
//! output.

use std::path::PathBuf;

use rcc_api::codes::{self, exit};
use rcc_process::signals;

use crate::context::{Context, OutputFormat};
use crate::dashboard::{Dashboard, DashboardArguments};
use crate::failure::Failure;
use crate::interrupt::Interrupts;
use crate::output::BackgroundPrinter;
use crate::supervisor::{POLL_INTERVAL, Supervisor, SupervisorEvent, processes};

/// Arguments of `up`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Cell configuration
    file: PathBuf,
    /// End the cell when the process that started this one dies
    #[arg(long)]
    parent_death: bool,
    /// Serve the dashboard too, print its address, and open it in the desktop's browser if there is one
    #[arg(long)]
    open: bool,
}

/// Runs the verb.
///
/// # Errors
/// Fails if the configuration is invalid, the cell is already running, or a process failed.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    if arguments.parent_death {
        follow_parent()?;
    }
    let interrupts = Interrupts::listen()?;
    let prepared = processes::prepare(&arguments.file)?;
    let name = context.cell.clone().unwrap_or(prepared.config.name.clone());
    let renamed = (name != prepared.config.name).then(|| SupervisorEvent {
        at: std::time::Duration::ZERO,
        who: format!("cell {name}"),
        what: format!(
            "named by --cell or RCC_CELL; {} names it {}",
            arguments.file.display(),
            prepared.config.name
        ),
    });
    let json = context.format == OutputFormat::Json;
    let printer = BackgroundPrinter::start();
    let event_printer = printer.clone();
    let mut supervisor = Supervisor::start(
        &name,
        prepared,
        Box::new(move |line| print_event(&event_printer, line, json)),
    )?;
    if let Some(renamed) = renamed {
        print_event(&printer, &renamed, json);
    }
    let up = supervisor.wait_until_up(&interrupts);
    if up.is_ok() {
        let ready = SupervisorEvent {
            at: std::time::Duration::ZERO,
            who: format!("cell {name}"),
            what: "ready  (Ctrl-C ends it; next: rcc-cli devices, rcc-cli run FILE)".to_owned(),
        };
        print_event(&printer, &ready, json);
        // A cell without a dashboard is still a cell.
        let dashboard = arguments.open.then(|| open(&name, &printer, json));
        while !interrupts.asked() && !supervisor.is_over() {
            supervisor.poll();
            std::thread::sleep(POLL_INTERVAL);
        }
        // It leaves the cell before the cell ends.
        drop(dashboard);
    }
    let failed = supervisor.has_failed();
    let clean = supervisor.stop(&interrupts);
    printer.finish();
    up?;
    if failed || !clean {
        return Err(Failure::reported(exit::FAILED));
    }
    Ok(())
}

/// Ends the cell with the program that started this one. Such a program may have blocked the signals that end the cell.
fn follow_parent() -> Result<(), Failure> {
    let followed = signals::unblock_stop_signals().and_then(|()| signals::end_with_parent());
    followed.map_err(|error| {
        Failure::new(
            codes::PROCESS_FAILED,
            error.to_string(),
            "start it from a process that lives longer, or without --parent-death",
        )
    })
}

/// Starts the dashboard and prints its address; says why if it cannot be started.
fn open(cell: &str, printer: &BackgroundPrinter, json: bool) -> Option<Dashboard> {
    let started = Dashboard::start(cell, &DashboardArguments::default());
    let what = match &started {
        Ok(dashboard) => dashboard.address.clone(),
        Err(failure) => failure.body.message.clone(),
    };
    let event = SupervisorEvent {
        at: std::time::Duration::ZERO,
        who: "dashboard".to_owned(),
        what,
    };
    print_event(printer, &event, json);
    let dashboard = started.ok()?;
    dashboard.show();
    Some(dashboard)
}

fn print_event(printer: &BackgroundPrinter, line: &SupervisorEvent, json: bool) {
    let SupervisorEvent { at, who, what } = line;
    if json {
        let value = serde_json::json!({"at_s": at.as_secs_f64(), "who": who, "what": what});
        printer.print_record(&value.to_string());
    } else if at.is_zero() {
        printer.print_line(&format!("{who}  {what}"));
    } else {
        printer.print_line(&format!("{:9.3} s  {who:<20} {what}", at.as_secs_f64()));
    }
}
