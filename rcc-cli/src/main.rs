//! `rcc-cli`: reads its arguments, runs one verb, and ends with a documented exit code.
//! The main thread does it all; the supervisor's children are started by it, so they end with it.

use std::process::ExitCode;
use std::time::Duration;

use clap::Parser;
use rcc_cli::context::{Context, Format};
use rcc_cli::verbs::Verb;

/// Robot Control Core: load nets, run them, look at them.
#[derive(Parser)]
#[command(version, after_help = EXIT_CODES)]
struct Arguments {
    /// Name of the cell (default: demo).
    #[arg(long, env = "RCC_CELL", global = true)]
    cell: Option<String>,
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
  130  ended by Ctrl-C";

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let context = Context {
        cell: arguments.cell,
        format: arguments.output,
        timeout: arguments.timeout,
    };
    match arguments.verb.run(&context) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            context.print_failure(&failure);
            ExitCode::from(failure.exit)
        }
    }
}

fn duration(text: &str) -> Result<Duration, String> {
    rcc_cli::verbs::duration(text)
}
