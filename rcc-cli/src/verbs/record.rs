//! `record FILE`: replaces this process by `rcc-monitor`, which is installed beside it.

use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::Command;

use rcc_api::codes;

use crate::context::{Context, OutputFormat};
use crate::failure::Failure;
use crate::supervisor::paths;

/// Arguments of `record`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// MCAP file; one that exists is kept, and is an error
    file: PathBuf,
    /// Nets, separated by commas, with * and ? as wildcards [default: all]
    #[arg(long, value_delimiter = ',', value_name = "NET")]
    nets: Vec<String>,
    /// Monitored ports, such as line/move.pose or */ik.joints, separated by commas, with wildcards [default: all]
    #[arg(long, value_delimiter = ',', value_name = "PORT")]
    ports: Vec<String>,
    /// End after this time [default: at Ctrl-C]
    #[arg(long, value_name = "SECONDS")]
    seconds: Option<String>,
    /// Greatest size: 500MB, 2GB [default: 4GB]
    #[arg(long, value_name = "SIZE")]
    max_size: Option<String>,
    /// At the greatest size, remove the oldest eighth instead of ending; the file becomes numbered segments
    #[arg(long)]
    keep_newest: bool,
    /// Rate of the messages that draw an arm; its measurements are all recorded [default: 100]
    #[arg(long, value_name = "HZ")]
    view_rate: Option<String>,
}

/// Runs the verb; returns only if it fails.
///
/// # Errors
/// Fails if the monitor cannot be started.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let program = paths::program("rcc-monitor")?;
    let mut command = Command::new(&program);
    command.arg("--cell").arg(context.cell_name()).arg("record");
    let format = match context.format {
        OutputFormat::Human => "human",
        OutputFormat::Json => "json",
    };
    command.arg("--output").arg(format);
    for net in &arguments.nets {
        command.arg("--nets").arg(net);
    }
    for port in &arguments.ports {
        command.arg("--ports").arg(port);
    }
    for (option, value) in [
        ("--seconds", arguments.seconds),
        ("--max-size", arguments.max_size),
        ("--view-rate", arguments.view_rate),
    ] {
        if let Some(value) = value {
            command.arg(option).arg(value);
        }
    }
    if arguments.keep_newest {
        command.arg("--keep-newest");
    }
    let error = command.arg("--").arg(&arguments.file).exec();
    Err(Failure::new(
        codes::PROCESS_FAILED,
        format!("{}: {error}", program.display()),
        "reinstall it",
    ))
}
