//! The arguments that every verb has, and the exit codes that every verb ends with.

use std::path::PathBuf;
use std::time::Duration;

use clap::Parser;

use crate::context::OutputFormat;
use crate::duration::duration;
use crate::verbs::Verb;

/// Robot Control Core: check, run and inspect nets.
#[derive(Parser, Debug)]
#[command(version = rcc_protocol::version::version(), after_help = EXIT_CODES)]
pub struct Arguments {
    /// Name of the cell [default: demo].
    #[arg(long, env = "RCC_CELL", global = true)]
    pub cell: Option<String>,
    /// Connect to the loader over TCP instead of the cell's socket: http://HOST:PORT.
    #[arg(long, env = "RCC_URL", global = true)]
    pub url: Option<String>,
    /// File with the token for --url; otherwise the token is read from RCC_TOKEN.
    #[arg(long, env = "RCC_TOKEN_FILE", global = true, requires = "url")]
    pub token_file: Option<PathBuf>,
    /// Output format of results.
    #[arg(
        long,
        env = "RCC_OUTPUT",
        value_enum,
        default_value = "human",
        global = true
    )]
    pub output: OutputFormat,
    /// Longest time to wait for one answer: 500ms, 2s, 1min.
    #[arg(long, env = "RCC_TIMEOUT", default_value = "2s", value_parser = duration, global = true)]
    pub timeout: Duration,
    /// The verb.
    #[command(subcommand)]
    pub verb: Verb,
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
  8    the net was canceled
  130  interrupted by Ctrl-C
  141  the output pipe was closed
A verb that waits for a net (run, wait, watch, cancel --wait) ends with 0 only if the net finished.";

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
