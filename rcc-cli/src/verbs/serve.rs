//! `serve`: the dashboard of a cell, for browsers on this machine. Replaces this process by `rcc-monitor`, or with `--open`
//! waits for it.

use std::os::unix::process::CommandExt;

use rcc_api::codes;
use rcc_api::codes::exit;

use crate::context::{Context, OutputFormat};
use crate::dashboard::{Dashboard, DashboardArguments};
use crate::failure::Failure;
use crate::interrupt::Interrupts;
use crate::output::{print_line, print_record};
use crate::supervisor::POLL_INTERVAL;

/// Arguments of `serve`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    #[command(flatten)]
    dashboard: DashboardArguments,
    /// Open the page in the desktop's browser
    #[arg(long)]
    open: bool,
}

/// Runs the verb; returns only if it fails, or with `--open` at the end.
///
/// # Errors
/// Fails if the dashboard cannot be started, or ends by itself.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let name = context.cell_name();
    if !arguments.open && context.format == OutputFormat::Human {
        let error = arguments.dashboard.command(name)?.exec();
        let message = format!("rcc-monitor: {error}");
        return Err(Failure::new(codes::PROCESS_FAILED, message, "reinstall it"));
    }
    let interrupts = Interrupts::listen()?;
    let mut dashboard = Dashboard::start(name, &arguments.dashboard)?;
    let shown = arguments.open && dashboard.show();
    match context.format {
        OutputFormat::Human => print_line(&dashboard.address),
        OutputFormat::Json => {
            let value = serde_json::json!({"address": dashboard.address, "opened": shown});
            print_record(&value.to_string());
        }
    }
    while !interrupts.asked() {
        if dashboard.has_ended() {
            return Err(Failure::reported(exit::FAILED));
        }
        std::thread::sleep(POLL_INTERVAL);
    }
    Ok(())
}
