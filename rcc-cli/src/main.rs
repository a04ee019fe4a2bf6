//! `rcc-cli`: parses its arguments, runs one verb, and ends with a documented exit code. The main thread does all the
//! work and starts the supervisor's children, so they end with it.

#![deny(clippy::print_stdout, clippy::print_stderr)]

use std::io::IsTerminal;
use std::process::ExitCode;

use clap::FromArgMatches;
use rcc_api::codes;
use rcc_cli::arguments::{self, Arguments};
use rcc_cli::client::RemoteLoader;
use rcc_cli::context::Context;
use rcc_cli::output;
use rcc_cli::reach::SelectedAddress;

fn main() -> ExitCode {
    let matches = arguments::command().try_get_matches();
    let parsed = matches.and_then(|matches| {
        let arguments = Arguments::from_arg_matches(&matches);
        arguments.map(|arguments| (arguments, matches))
    });
    let (arguments, matches) = match parsed {
        Ok(parsed) => parsed,
        Err(error) => return conclude(&error),
    };
    let selected = SelectedAddress::of(&matches, arguments.verb.reach());
    let connected = selected.and_then(|selected| {
        let remote = selected.url.as_deref().map(|url| {
            // Not a command line option: every user of the machine can read the arguments of a process.
            let token = std::env::var("RCC_TOKEN").ok();
            RemoteLoader::new(url, arguments.token_file.as_deref(), token.as_deref())
        });
        Ok((selected.cell, remote.transpose()?))
    });
    let ((cell, remote), refused) = match connected {
        Ok(connected) => (connected, None),
        Err(failure) => ((None, None), Some(failure)),
    };
    let context = Context {
        cell,
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

/// Prints clap's help, version or usage error, and returns the exit code.
fn conclude(error: &clap::Error) -> ExitCode {
    if error.use_stderr() {
        // The text may quote an argument such as another user's file name: make it printable.
        output::print_note(&error.to_string());
    } else if std::io::stdout().is_terminal() {
        // Our own text, printed with colours.
        let _ = error.print();
    } else {
        output::print_line(&error.to_string());
    }
    ExitCode::from(u8::try_from(error.exit_code()).unwrap_or(codes::exit::USAGE))
}
