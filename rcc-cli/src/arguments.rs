//! The arguments that every verb has, and the exit codes that every verb ends with.

use std::path::PathBuf;
use std::time::Duration;

use clap::builder::{StyledStr, Styles};
use clap::{Command, CommandFactory, Parser};

use crate::context::OutputFormat;
use crate::duration::duration;
use crate::verbs::{GROUPS, Verb};
use rcc_terminal::text::{TerminalSize, between_words};

/// Robot Control Core: check, run and inspect nets.
#[derive(Parser, Debug)]
#[command(version = rcc_protocol::version::version(), after_help = EXIT_CODES)]
pub struct Arguments {
    /// Name of the cell [default: demo; for `up` the name in its file].
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

/// Columns of the help if stdout is not a terminal, and at most.
const HELP_COLUMNS: usize = 100;

/// Returns the parser of the command line, whose help lists the verbs by groups.
#[must_use]
pub fn command() -> Command {
    let columns = TerminalSize::of_stdout().map_or(HELP_COLUMNS, |size| size.columns);
    let command = Arguments::command();
    let verbs = grouped_verbs(&command, columns.min(HELP_COLUMNS));
    let styles = Styles::styled();
    let head = styles.get_header();
    let template = format!(
        "{{about-with-newline}}\n{{usage-heading}} {{usage}}\n\n{verbs}{head}Options:{head:#}\n{{options}}{{after-help}}"
    );
    command.help_template(StyledStr::from(template))
}

/// Lists all verbs with their summaries below the titles of their groups.
fn grouped_verbs(command: &Command, columns: usize) -> String {
    let styles = Styles::styled();
    let (head, verb) = (styles.get_header(), styles.get_literal());
    let longest = command.get_subcommands().map(|verb| verb.get_name().len());
    let longest = longest.max();
    let mut verbs = command.get_subcommands();
    let width = longest.unwrap_or(0);
    let indent = " ".repeat(width + 4);
    let mut text = String::new();
    for (title, count) in GROUPS {
        text.push_str(&format!("{head}{title}:{head:#}\n"));
        for one in verbs.by_ref().take(*count) {
            let about = one.get_about().map(ToString::to_string).unwrap_or_default();
            let options = between_words(columns)
                .initial_indent(&indent)
                .subsequent_indent(&indent);
            let about = textwrap::fill(&about, options);
            let name = one.get_name();
            let about = about.get(indent.len()..).unwrap_or("");
            text.push_str(&format!("  {verb}{name:<width$}{verb:#}  {about}\n"));
        }
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn the_help_lists_every_verb_once_in_a_group() {
        let command = super::command();
        let names: Vec<_> = command
            .get_subcommands()
            .map(|verb| verb.get_name())
            .collect();
        let grouped: usize = GROUPS.iter().map(|(_, count)| count).sum();
        assert_eq!(grouped, names.len());
        let help = super::command().render_long_help().to_string();
        for (title, count) in GROUPS {
            assert!(
                *count > 0 && help.contains(&format!("{title}:\n")),
                "{title}\n{help}"
            );
        }
        for name in names {
            let row = format!("  {name} ");
            let rows = help.lines().filter(|line| line.starts_with(&row));
            assert_eq!(rows.count(), 1, "{name}\n{help}");
        }
        for part in ["Usage: ", "Options:\n", "--cell", "Exit codes:"] {
            assert!(help.contains(part), "{part}\n{help}");
        }
    }

    /// Calls `check` with each verb and each of its subcommands.
    fn visit(command: &Command, path: &str, check: &dyn Fn(&str, &Command)) {
        for verb in command.get_subcommands() {
            let path = format!("{path} {}", verb.get_name());
            check(&path, verb);
            visit(verb, &path, check);
        }
    }

    #[test]
    fn the_option_o_names_the_file_of_the_result_everywhere() {
        let count = std::cell::Cell::new(0);
        visit(&Arguments::command(), "rcc-cli", &|path, verb| {
            for option in verb.get_arguments() {
                let is_o = option.get_short() == Some('o');
                assert_eq!(is_o, option.get_long() == Some("out"), "{path}: {option:?}");
                count.set(count.get() + usize::from(is_o));
                let help = option
                    .get_help()
                    .map(ToString::to_string)
                    .unwrap_or_default();
                assert!(!is_o || help.contains("say so"), "{path}: {help}");
            }
        });
        assert_eq!(
            count.get(),
            6,
            "convert, graph, import trajectory, incidents fetch, plot, robot import"
        );
    }

    #[test]
    fn the_list_of_verbs_fits_a_narrow_terminal() {
        for columns in [50, 80, 100] {
            let text = grouped_verbs(&Arguments::command(), columns);
            let text = StyledStr::from(text).to_string();
            let fits = |line: &str| line.chars().count() <= columns;
            assert!(text.lines().all(fits), "{columns}\n{text}");
        }
    }

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
