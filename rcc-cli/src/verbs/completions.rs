//! `completions SHELL`: prints what a shell needs to complete verbs and options.

use clap_complete::Shell;

use crate::context::Context;
use crate::failure::Failure;
use crate::output::print_record;

/// For which shell.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// The shell that reads it: `rcc-cli completions bash > /etc/bash_completion.d/rcc-cli`.
    shell: Shell,
}

/// Does it.
///
/// # Errors
/// None.
pub fn run(_: &Context, arguments: Arguments) -> Result<(), Failure> {
    let mut command = crate::arguments::command();
    let mut text = Vec::new();
    clap_complete::generate(arguments.shell, &mut command, "rcc-cli", &mut text);
    print_record(String::from_utf8_lossy(&text).trim_end());
    Ok(())
}
