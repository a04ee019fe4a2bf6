//! `load FILE`: loads a net and waits until it is ready.

use rcc_api::bodies::CommandView;
use rcc_core::counted::Counted;

use crate::context::Context;
use crate::failure::{Failure, draw};
use crate::follow::{self, OnRejection};
use crate::output::print_diagnostics;
use crate::table::time;

/// Arguments of `load`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Net (YAML or JSON); - reads standard input
    file: String,
}

/// Runs the verb.
///
/// # Errors
/// Fails if the loader cannot be reached or rejects the net; prints the diagnostics.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let source = follow::read_net(&arguments.file)?;
    let client = context.client()?;
    let loaded = follow::load(&client, &source.0, &source.1, OnRejection::Keep)?;
    print_diagnostics(&draw(
        &loaded.diagnostics,
        Some(&source),
        Context::drawing(),
    ));
    context.print(&loaded, |command| match &command.rehearsal {
        Some(rehearsal) => format!("{}\n{}", line(command), rehearsal.words),
        None => line(command),
    });
    Ok(())
}

/// Describes a loaded command in one line.
pub(super) fn line(command: &CommandView) -> String {
    let uses = if command.uses.is_empty() {
        "nothing".to_owned()
    } else {
        command.uses.join(", ")
    };
    format!(
        "{}  {}  {}  uses: {uses}{}",
        follow::title(command),
        command.state,
        Counted(u64::from(command.primitives), "primitive"),
        match command.expected_ns {
            0 => String::new(),
            ns => format!("  expected: {} per cycle", time(ns)),
        }
    )
}
