//! `check FILE...`: checks nets, libraries of fragments, tasks, cells and robots offline with the programs' own readers. Folders
//! are searched; one file is reported in one line, several in a summary with their errors.

use std::path::{Path, PathBuf};
use std::time::Instant;

use rcc_api::codes::{self, exit};
use rcc_core::printable::OneLine;
use rcc_language::devices::DeviceTable;

use crate::context::{Context, OutputFormat};
use crate::failure::{Failure, draw};
use crate::follow::read_text;
use crate::output::{print_diagnostics, print_line, print_note};
use crate::scenario::{DevicesOf, config_or_demo, load_config, require_valid_settings};

mod search;
mod summary;
mod verdict;

use search::{CheckedKind, FoundFiles, find};
use summary::CheckSummary;
use verdict::{CheckStage, FileVerdict};

/// Arguments of `check`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Files of nets (YAML, JSON or DirectIONet), libraries, tasks, cells and robots, and folders of them; - reads standard input
    #[arg(required = true)]
    files: Vec<String>,
    /// Cell configuration whose devices the nets use [default: the demo cell's]
    #[arg(long)]
    config: Option<PathBuf>,
    /// Print one JSON object per file, like --output json
    #[arg(long)]
    json: bool,
    /// Findings to reject besides errors
    #[arg(long, value_enum)]
    deny: Option<Deny>,
    /// Rehearse nets that command an arm, as LOAD does, starting from the simulators' positions
    #[arg(long)]
    rehearse: bool,
}

/// Findings to reject besides errors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Deny {
    /// Reject files with warnings
    Warnings,
}

/// Runs the verb.
///
/// # Errors
/// Fails with exit code 3 if a file is invalid, with the file's code if one cannot be read, and with 2 if folders hold
/// nothing to check.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let started = Instant::now();
    let config = load_config(&config_or_demo(arguments.config.as_deref())?)?;
    if arguments.rehearse {
        require_valid_settings(&config)?;
    }
    let stage = CheckStage {
        devices: &DeviceTable::from(&config),
        denies_warnings: arguments.deny == Some(Deny::Warnings),
        config: &config,
        rehearses: arguments.rehearse,
    };
    let context = Context {
        format: if arguments.json {
            OutputFormat::Json
        } else {
            context.format
        },
        ..context.clone()
    };
    let is_folder = |file: &String| Path::new(file).is_dir();
    let is_many = arguments.files.len() > 1 || arguments.files.iter().any(is_folder);
    let mut summary = CheckSummary::default();
    let mut unknown = Vec::new();
    for named in &arguments.files {
        let from_folder = is_folder(named);
        for file in files_of(named, from_folder, &context, &mut summary) {
            let source = match read_text(&file) {
                Ok(source) => source,
                Err(failure) => {
                    summary.unreadable(&context, &failure);
                    continue;
                }
            };
            let kind = CheckedKind::of(&source);
            if kind.is_none() && from_folder {
                summary.of_no_kind(file);
                continue;
            }
            // A file that is named is meant as something, most probably as a net.
            let verdict = stage.judge(kind.unwrap_or(CheckedKind::Net), &source);
            summary.count(&verdict);
            print_verdict(&context, &source, &verdict, is_many);
            unknown.extend(verdict.diagnostics);
        }
    }
    if is_many && context.format == OutputFormat::Human {
        print_line(&summary.text(started.elapsed().as_secs_f64()));
    }
    DevicesOf::option(arguments.config.as_deref()).note(&unknown);
    summary
        .not_checked()
        .iter()
        .for_each(|line| print_note(&OneLine(line).to_string()));
    let folders_only = arguments.files.iter().all(is_folder);
    if folders_only && summary.checked() == 0 && summary.unreadable.is_none() {
        let message = format!("nothing to check in {}", arguments.files.join(", "));
        let help = "nets, libraries, tasks, cells and robots are .yaml, .yml, .json, .net or .dio files with a key `net:`, `library:`, \
                    `task:`, `cell:` or `robot:`; name a file to see its errors";
        return Err(Failure::new(codes::BAD_REQUEST, message, help));
    }
    match summary {
        CheckSummary {
            unreadable: Some(code),
            ..
        } => Err(Failure::reported(code)),
        CheckSummary { invalid: 1.., .. } => Err(Failure::reported(exit::INVALID)),
        _ => Ok(()),
    }
}

/// Returns the files to read for one argument; what a folder has besides them is added to the summary.
fn files_of(
    named: &str,
    is_folder: bool,
    context: &Context,
    summary: &mut CheckSummary,
) -> Vec<String> {
    if !is_folder {
        return vec![named.to_owned()];
    }
    let mut found = find(Path::new(named)).unwrap_or_else(|error| {
        summary.unreadable(context, &Failure::unreadable(named, &error));
        FoundFiles::default()
    });
    summary.passed_over(&mut found);
    found.files
}

fn print_verdict(
    context: &Context,
    source: &(String, String),
    verdict: &FileVerdict,
    is_many: bool,
) {
    if context.format == OutputFormat::Json {
        return context.print(verdict, |_| String::new());
    }
    print_diagnostics(&draw(
        &verdict.diagnostics,
        Some(source),
        Context::drawing(),
    ));
    if verdict.valid && !is_many {
        // Names must not begin a line of their own.
        let words = format!("{}: {}", verdict.file, verdict.summary);
        print_line(&OneLine(&words).to_string());
        if let Some(rehearsal) = &verdict.rehearsal {
            print_line(&rehearsal.words);
        }
    }
}
