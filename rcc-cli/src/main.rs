//! `rcc-cli`: reads its arguments, runs one verb, and ends with a documented exit code.
//! The main thread does it all; the supervisor's children are started by it, so they end with it.

#![deny(clippy::print_stdout, clippy::print_stderr)]

use std::io::IsTerminal;
use std::process::ExitCode;

use clap::Parser;
use rcc_cli::arguments::Arguments;
use rcc_cli::client::Remote;
use rcc_cli::context::Context;
use rcc_cli::output;
use rcc_loader::server::codes;

fn main() -> ExitCode {
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(told) => return conclude(&told),
    };
    let remote = arguments
        .url
        .as_deref()
        .filter(|url| !url.is_empty())
        .map(|url| {
            // Never an argument: those are seen by everybody on the machine.
            let token = std::env::var("RCC_TOKEN").ok();
            Remote::new(url, arguments.token_file.as_deref(), token.as_deref())
        });
    let (remote, refused) = match remote.transpose() {
        Ok(remote) => (remote, None),
        Err(failure) => (None, Some(failure)),
    };
    let context = Context {
        cell: arguments.cell,
        remote,
        format: arguments.output,
        timeout: arguments.timeout,
    };
    match refused.map_or_else(|| arguments.verb.run(&context), Err) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            context.print_failure(&failure);
            ExitCode::from(failure.exit)
        }
    }
}

/// Help, version or wrong arguments: printed, and an error if that cannot be.
fn conclude(told: &clap::Error) -> ExitCode {
    if told.use_stderr() {
        // What was typed may be the name of a file of somebody else.
        output::remark(&told.to_string());
    } else if std::io::stdout().is_terminal() {
        // Ours, with colours.
        let _ = told.print();
    } else {
        output::say(&told.to_string());
    }
    ExitCode::from(u8::try_from(told.exit_code()).unwrap_or(codes::exit::USAGE))
}
