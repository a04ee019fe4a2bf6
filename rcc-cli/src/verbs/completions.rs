//! `completions SHELL`: prints the completions of verbs and options for a shell.

use clap_complete::Shell;

use crate::context::Context;
use crate::failure::Failure;
use crate::output::print_record;

/// Arguments of `completions`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Shell that reads them: rcc-cli completions bash > /etc/bash_completion.d/rcc-cli
    shell: Shell,
}

/// Runs the verb.
///
/// # Errors
/// Never fails.
pub fn run(_: &Context, arguments: Arguments) -> Result<(), Failure> {
    let mut command = crate::arguments::command();
    let mut text = Vec::new();
    clap_complete::generate(arguments.shell, &mut command, "rcc-cli", &mut text);
    print_record(String::from_utf8_lossy(&text).trim_end());
    Ok(())
}
