//! `tail [PATTERN...]`: replaces this process by `rcc-monitor`, which is installed beside it; with `--url` it asks the
//! loader.

use std::os::unix::process::CommandExt;
use std::process::Command;

use rcc_api::codes;

use crate::context::{Context, OutputFormat};
use crate::duration::duration;
use crate::failure::Failure;
use crate::supervisor::paths;
use remote::RemoteTail;

mod remote;

/// Arguments of `tail`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Ports such as line/move.pose, with * and ? as wildcards [default: all]
    patterns: Vec<String>,
    /// End after this many records
    #[arg(long)]
    count: Option<u64>,
    /// End after this time
    #[arg(long = "for", value_name = "DURATION")]
    duration: Option<String>,
}

/// Runs the verb; on this machine it returns only if it fails.
///
/// # Errors
/// Fails if the monitor cannot be started, or as [`RemoteTail::run`].
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    if context.remote.is_some() {
        let given = arguments.duration.as_deref().map(duration).transpose();
        let duration = given.map_err(|error| Failure::new(codes::BAD_REQUEST, error, ""))?;
        let tail = RemoteTail {
            patterns: &arguments.patterns,
            count: arguments.count,
            duration,
        };
        return tail.run(context);
    }
    let program = paths::program("rcc-monitor")?;
    let mut command = Command::new(&program);
    command.arg("--cell").arg(context.cell_name()).arg("tail");
    let format = match context.format {
        OutputFormat::Human => "human",
        OutputFormat::Json => "json",
    };
    command.arg("--output").arg(format);
    if let Some(count) = arguments.count {
        command.arg("--count").arg(count.to_string());
    }
    if let Some(duration) = arguments.duration {
        command.arg("--for").arg(duration);
    }
    let error = command.arg("--").args(&arguments.patterns).exec();
    Err(Failure::new(
        codes::PROCESS_FAILED,
        format!("{}: {error}", program.display()),
        "reinstall it",
    ))
}
