//! `fleet …`: cells of several hosts. Replaces this process by `rcc-link`, which alone knows Zenoh and is built by name.

use std::ffi::OsString;
use std::os::unix::process::CommandExt;
use std::process::Command;

use rcc_api::codes;

use crate::context::{Context, OutputFormat};
use crate::failure::Failure;
use crate::supervisor::paths;

/// Arguments of `fleet`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Verb of rcc-link and its arguments: cells, top, events, tail, start, cancel, deploy, withdraw; none prints its help
    #[arg(
        trailing_var_arg = true,
        allow_hyphen_values = true,
        value_name = "VERB"
    )]
    arguments: Vec<OsString>,
}

/// Runs the verb; returns only if it fails.
///
/// # Errors
/// Fails if `rcc-link` is not installed, or if JSON is asked for, which it does not print.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    if context.format == OutputFormat::Json {
        return Err(Failure::new(
            codes::BAD_REQUEST,
            "`fleet` has no JSON output",
            "omit `--output json`; `rcc-cli --url …` asks each cell in JSON",
        ));
    }
    let remedy = "build it (`cargo build --release -p rcc-link`) or install it in the same folder; see docs/link.md";
    let mut command = Command::new(paths::beside("rcc-link", remedy)?);
    if let Some(cell) = &context.cell {
        command.arg("--cell").arg(cell);
    }
    match arguments.arguments.as_slice() {
        [] => command.arg("--help"),
        given => command.args(given),
    };
    let error = command.exec();
    Err(Failure::new(
        codes::PROCESS_FAILED,
        format!("rcc-link: {error}"),
        remedy,
    ))
}
