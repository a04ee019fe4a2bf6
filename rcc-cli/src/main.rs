//! `rcc-cli`: parses its arguments, runs one verb, and ends with a documented exit code. The main thread does all the
//! work and starts the supervisor's children, so they end with it.

#![deny(clippy::print_stdout, clippy::print_stderr)]

use std::io::IsTerminal;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use clap::Parser;
use rcc_cli::client::RemoteLoader;
use rcc_cli::context::{Context, OutputFormat};
use rcc_cli::output;
use rcc_cli::verbs::Verb;
use rcc_loader::server::codes;

/// Robot Control Core: check, run and inspect nets.
#[derive(Parser)]
#[command(version, after_help = EXIT_CODES)]
struct Arguments {
    /// Name of the cell [default: demo].
    #[arg(long, env = "RCC_CELL", global = true)]
    cell: Option<String>,
    /// Connect to the loader over TCP instead of the cell's socket: http://HOST:PORT.
    #[arg(long, env = "RCC_URL", global = true)]
    url: Option<String>,
    /// File with the token for --url; otherwise the token is read from RCC_TOKEN.
    #[arg(long, env = "RCC_TOKEN_FILE", global = true, requires = "url")]
    token_file: Option<PathBuf>,
    /// Output format of results.
    #[arg(
        long,
        env = "RCC_OUTPUT",
        value_enum,
        default_value = "human",
        global = true
    )]
    output: OutputFormat,
    /// Longest time to wait for one answer: 500ms, 2s, 1min.
    #[arg(long, env = "RCC_TIMEOUT", default_value = "2s", value_parser = duration, global = true)]
    timeout: Duration,
    #[command(subcommand)]
    verb: Verb,
}

const EXIT_CODES: &str = "Exit codes:
  0    done
  1    the operation failed, or the net ended with a fault or an abort
  2    wrong arguments
  3    invalid net or configuration
  4    loader or executor not reachable
  5    conflict: a resource is busy, or the state does not allow it
  6    no answer in time
  7    not permitted
  8    the net was canceled before it finished, and not by this command
  130  interrupted by Ctrl-C
  141  the output pipe was closed
A verb that waits for a net ends with 0 only if the net finished; `cancel --wait` also if it was canceled.";

fn main() -> ExitCode {
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(error) => return conclude(&error),
    };
    let remote = arguments
        .url
        .as_deref()
        .filter(|url| !url.is_empty())
        .map(|url| {
            // Not a command line option: every user of the machine can read the arguments of a process.
            let token = std::env::var("RCC_TOKEN").ok();
            RemoteLoader::new(url, arguments.token_file.as_deref(), token.as_deref())
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

fn duration(text: &str) -> Result<Duration, String> {
    rcc_cli::verbs::duration(text)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use clap::CommandFactory;

    use super::Arguments;

    #[test]
    fn no_verb_shadows_a_global_argument() {
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
