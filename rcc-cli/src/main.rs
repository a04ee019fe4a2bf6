//! `rcc-cli`: reads its arguments, runs one verb, and ends with a documented exit code.
//! The main thread does it all; the supervisor's children are started by it, so they end with it.

#![deny(clippy::print_stdout, clippy::print_stderr)]

use std::io::IsTerminal;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use clap::Parser;
use rcc_cli::client::Remote;
use rcc_cli::context::{Context, Format};
use rcc_cli::output;
use rcc_cli::verbs::Verb;
use rcc_loader::server::codes;

/// Robot Control Core: load nets, run them, look at them.
#[derive(Parser)]
#[command(version = rcc_ipc::version::version(), after_help = EXIT_CODES)]
struct Arguments {
    /// Name of the cell (default: demo).
    #[arg(long, env = "RCC_CELL", global = true)]
    cell: Option<String>,
    /// Ask this loader over TCP instead of the cell's socket: http://HOST:PORT.
    #[arg(long, env = "RCC_URL", global = true)]
    url: Option<String>,
    /// The file with the token for --url; without, the token is in RCC_TOKEN.
    #[arg(long, env = "RCC_TOKEN_FILE", global = true, requires = "url")]
    token_file: Option<PathBuf>,
    /// How results are printed.
    #[arg(
        long,
        env = "RCC_OUTPUT",
        value_enum,
        default_value = "human",
        global = true
    )]
    output: Format,
    /// How long one answer is waited for: 500ms, 2s, 1min.
    #[arg(long, env = "RCC_TIMEOUT", default_value = "2s", value_parser = duration, global = true)]
    timeout: Duration,
    #[command(subcommand)]
    verb: Verb,
}

const EXIT_CODES: &str = "Exit codes:
  0    done
  1    the operation failed, or the net ended with a fault or an abort
  2    wrong arguments
  3    a net or a configuration is not valid
  4    loader or executor cannot be reached
  5    conflict: a resource is busy, or the state does not allow it
  6    no answer in time
  7    not permitted
  8    the net was canceled before it had finished, and not by this command
  130  ended by Ctrl-C
  141  the reader of the output is gone
A verb that waits for a net ends with 0 only if the net finished; `cancel --wait` also if it was canceled.";

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

fn duration(text: &str) -> Result<Duration, String> {
    rcc_cli::verbs::duration(text)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use clap::CommandFactory;

    use super::Arguments;

    #[test]
    fn no_verb_has_an_argument_by_the_name_of_a_global_one() {
        let all = Arguments::command();
        all.clone().debug_assert();
        let globals: BTreeSet<_> = all.get_arguments().map(|one| one.get_id()).collect();
        for verb in all.get_subcommands() {
            let twice = verb
                .get_arguments()
                .find(|one| globals.contains(one.get_id()));
            assert!(twice.is_none(), "{}: {twice:?}", verb.get_name());
        }
    }
}
