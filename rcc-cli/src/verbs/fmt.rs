//! `fmt FILE...`: formats nets and libraries, keeping comments. Needs no cell.

use rcc_api::codes::{self, exit};
use rcc_language::format::{FormatError, format};
use serde::Serialize;

use crate::context::{Context, OutputFormat};
use crate::failure::Failure;
use crate::follow::read_text;
use crate::output::{print_file, print_line};

/// Arguments of `fmt`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Nets and libraries in YAML; - formats standard input to standard output
    #[arg(required = true)]
    files: Vec<String>,
    /// Change nothing; list unformatted files and exit with code 1 if there are any
    #[arg(long)]
    check: bool,
    /// Change nothing; print the result
    #[arg(long, conflicts_with = "check")]
    stdout: bool,
}

/// Result for one file.
#[derive(Serialize)]
struct FormatOutcome {
    file: String,
    /// True if the file is, or was, not formatted.
    changed: bool,
}

/// Runs the verb.
///
/// # Errors
/// Fails with exit code 3 if a file is invalid, and reports its faults; that file stays unchanged, and the others are
/// still formatted. Fails with exit code 1 with `--check` if a file is not formatted.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let mut worst = 0;
    for file in &arguments.files {
        match format_file(context, &arguments, file) {
            Ok(false) => {}
            Ok(true) => worst = worst.max(1),
            Err(failure) => {
                context.print_failure(&failure);
                worst = worst.max(failure.exit);
            }
        }
    }
    if worst == 0 {
        Ok(())
    } else {
        Err(Failure::reported(worst))
    }
}

/// Formats one file; returns true if `--check` found it unformatted.
fn format_file(context: &Context, arguments: &Arguments, file: &str) -> Result<bool, Failure> {
    let (name, text) = read_text(file)?;
    let written = format(&text, &name).map_err(|error| refused(&name, error))?;
    let changed = written != text;
    let prints = arguments.stdout || file == "-";
    if prints && !arguments.check {
        print_file(&written);
        return Ok(false);
    }
    if changed && !arguments.check {
        std::fs::write(file, &written).map_err(|error| Failure::unreadable(file, &error))?;
    }
    if context.format == OutputFormat::Human {
        match (changed, arguments.check) {
            (true, true) => print_line(&format!("{name}: not formatted (run `rcc-cli fmt`)")),
            (true, false) => print_line(&format!("{name}: formatted")),
            (false, _) => {}
        }
    } else {
        let outcome = FormatOutcome {
            file: name,
            changed,
        };
        context.print(&outcome, |_| String::new());
    }
    Ok(changed && arguments.check)
}

fn refused(name: &str, error: FormatError) -> Failure {
    let what = format!("{name} is unchanged: {error}");
    match error {
        FormatError::Faulty(faults) | FormatError::WouldLose(faults) => {
            Failure::from_faults(&what, &faults)
        }
        FormatError::Json => Failure {
            exit: exit::INVALID,
            ..Failure::new(
                codes::BAD_REQUEST,
                what,
                "JSON needs no formatting; write nets by hand in YAML",
            )
        },
    }
}
