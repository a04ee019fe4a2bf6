//! `check FILE...`: compiles nets offline with the loader's own library. Folders are searched for nets; one file is
//! reported in one line, several in a summary with their errors.

use std::path::{Path, PathBuf};
use std::time::Instant;

use rcc_api::bodies::{Finding, RehearsalView};
use rcc_api::codes::{self, exit};
use rcc_api::compile::{findings, name_of};
use rcc_config::CellConfig;
use rcc_core::counted::Counted;
use rcc_language::Compiler;
use rcc_language::devices::DeviceTable;
use rcc_language::library::FileLibraries;
use rcc_language::names::Names;
use rcc_protocol::control::PlanData;
use serde::Serialize;

use crate::context::{Context, OutputFormat};
use crate::failure::{Failure, draw};
use crate::follow::read_text;
use crate::output::{print_diagnostics, print_line};
use crate::scenario::{load_config, require_valid_settings, with_names};
use crate::simulate::rehearse_at_start;
use crate::supervisor::paths;
use crate::table::grouped;

/// Arguments of `check`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Nets (YAML or JSON) and folders of nets; - reads standard input
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
    /// Reject nets with warnings
    Warnings,
}

#[derive(Serialize)]
struct NetVerdict {
    file: String,
    valid: bool,
    net: String,
    primitives: u32,
    #[serde(skip_serializing_if = "Option::is_none")]
    rehearsal: Option<RehearsalView>,
    diagnostics: Vec<Finding>,
}

/// Totals over all files.
#[derive(Debug, Default)]
struct CheckSummary {
    valid: u64,
    invalid: u64,
    errors: u64,
    warnings: u64,
    /// Number of files in folders that are not nets.
    others: u64,
    /// Exit code for the first file that could not be read.
    unreadable: Option<u8>,
}

/// Runs the verb.
///
/// # Errors
/// Fails with exit code 3 if a net is invalid, with the file's code if one cannot be read, and with 2 if folders hold
/// no net.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let started = Instant::now();
    let config = match &arguments.config {
        Some(path) => path.clone(),
        None => paths::config("cells/demo.yaml")?,
    };
    let config = load_config(&config)?;
    if arguments.rehearse {
        require_valid_settings(&config)?;
    }
    let cell = DeviceTable::from(&config);
    let stage = arguments.rehearse.then_some(&config);
    let context = Context {
        format: if arguments.json {
            OutputFormat::Json
        } else {
            context.format
        },
        ..context.clone()
    };
    let is_many =
        arguments.files.len() > 1 || arguments.files.iter().any(|file| Path::new(file).is_dir());
    let mut summary = CheckSummary::default();
    for named in &arguments.files {
        let is_folder = Path::new(named).is_dir();
        let files = if is_folder {
            nets_in(Path::new(named))
        } else {
            Ok(vec![named.clone()])
        };
        let files = files.unwrap_or_else(|error| {
            summary.unreadable(&context, &Failure::unreadable(named, &error));
            Vec::new()
        });
        for file in &files {
            match read_text(file) {
                Err(failure) => summary.unreadable(&context, &failure),
                Ok(source) if is_folder && !is_net(&source) => summary.others += 1,
                Ok(source) => {
                    let verdict = verdict(&source, &cell, arguments.deny.is_some(), stage);
                    summary.count(&verdict);
                    print_verdict(&context, &source, &verdict, is_many);
                }
            }
        }
    }
    if is_many && context.format == OutputFormat::Human {
        print_line(&summary.text(started.elapsed().as_secs_f64()));
    }
    let folders_only = arguments.files.iter().all(|file| Path::new(file).is_dir());
    if folders_only && summary.valid + summary.invalid == 0 && summary.unreadable.is_none() {
        let message = format!("no nets found in {}", arguments.files.join(", "));
        let help = "a net is a .yaml, .yml or .json file with a `net:` entry; name the file to see its errors";
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

fn verdict(
    source: &(String, String),
    cell: &DeviceTable,
    deny_warnings: bool,
    stage: Option<&CellConfig>,
) -> NetVerdict {
    let (name, text) = source;
    let compiler = Compiler {
        libraries: &FileLibraries,
        ..rcc_directionet::compiler(cell)
    };
    match compiler.compile(text, name) {
        Ok(compiled) => {
            let checked = compiled.plan.plan().check(&cell.models(), cell.fingerprint);
            let mut diagnostics = findings(&compiled.warnings);
            let rehearsed =
                stage.map(|config| rehearsed(config, compiled.plan.clone(), &compiled.names));
            let is_refused = matches!(rehearsed, Some(Err(_)));
            let rehearsal = match rehearsed {
                Some(Err(finding)) => {
                    diagnostics.push(*finding);
                    None
                }
                Some(Ok(rehearsal)) => rehearsal,
                None => None,
            };
            NetVerdict {
                file: name.clone(),
                valid: !is_refused && (!deny_warnings || diagnostics.is_empty()),
                net: compiled.net,
                rehearsal,
                // A net that compiled has a plan that passes the check.
                primitives: checked.map_or(0, |checked| checked.primitives),
                diagnostics,
            }
        }
        Err(faults) => NetVerdict {
            file: name.clone(),
            valid: false,
            net: String::new(),
            primitives: 0,
            rehearsal: None,
            diagnostics: findings(&faults),
        },
    }
}

/// Rehearses a net; returns the result, or the limit that it would break.
fn rehearsed(
    config: &CellConfig,
    plan: PlanData,
    names: &Names,
) -> Result<Option<RehearsalView>, Box<Finding>> {
    let rehearsal = rehearse_at_start(config, plan);
    with_names(names, config, |namer| match rehearsal {
        Ok(rehearsed) => Ok(rehearsed.map(|rehearsed| namer.rehearsal(&rehearsed, names))),
        Err(refusal) => Err(Box::new(namer.refusal(1, refusal).finding())),
    })
}

fn print_verdict(
    context: &Context,
    source: &(String, String),
    verdict: &NetVerdict,
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
        let NetVerdict {
            file,
            net,
            primitives,
            ..
        } = verdict;
        let primitives = Counted(u64::from(*primitives), "primitive");
        print_line(&format!("{file}: {net} is valid, {primitives}"));
        if let Some(rehearsal) = &verdict.rehearsal {
            print_line(&rehearsal.words);
        }
    }
}

impl CheckSummary {
    fn count(&mut self, verdict: &NetVerdict) {
        let errors = verdict
            .diagnostics
            .iter()
            .filter(|finding| finding.severity == "error");
        let errors = errors.count() as u64;
        self.errors += errors;
        self.warnings += verdict.diagnostics.len() as u64 - errors;
        if verdict.valid {
            self.valid += 1;
        } else {
            self.invalid += 1;
        }
    }

    fn unreadable(&mut self, context: &Context, failure: &Failure) {
        context.print_failure(failure);
        self.unreadable.get_or_insert(failure.exit);
    }

    fn text(&self, seconds: f64) -> String {
        let counted = |count: u64, one: &str, many: &str| match count {
            1 => format!("1 {one}"),
            count => format!("{} {many}", grouped(count)),
        };
        let all = counted(self.valid + self.invalid, "net", "nets");
        let mut summary = match self.invalid {
            0 => format!("{all}: all valid"),
            invalid => format!(
                "{all}: {} valid, {} not",
                grouped(self.valid),
                grouped(invalid)
            ),
        };
        let found = [
            (self.errors, counted(self.errors, "error", "errors")),
            (self.warnings, counted(self.warnings, "warning", "warnings")),
        ];
        for (count, text) in found {
            if count > 0 {
                summary.push_str(&format!(", {text}"));
            }
        }
        if self.others > 0 {
            summary.push_str(&format!(
                "; {} skipped (not a net)",
                counted(self.others, "file", "files")
            ));
        }
        format!("{summary}; {seconds:.2} s")
    }
}

/// Extensions of files that can be nets.
const ENDINGS: [&str; 5] = ["yaml", "yml", "json", "net", "dio"];
/// Greatest depth of the search, so that a link to a parent folder ends.
const DEPTH_MAX: usize = 16;

/// Returns the files below a folder that can be nets, sorted by name.
fn nets_in(folder: &Path) -> std::io::Result<Vec<String>> {
    let mut found = Vec::new();
    search(folder, 0, &mut found)?;
    Ok(found)
}

fn search(folder: &Path, depth: usize, found: &mut Vec<String>) -> std::io::Result<()> {
    let entries: Result<Vec<_>, _> = std::fs::read_dir(folder)?.collect();
    let mut paths: Vec<PathBuf> = entries?.into_iter().map(|entry| entry.path()).collect();
    paths.sort();
    for path in paths {
        let ending = path.extension().and_then(|ending| ending.to_str());
        if path.is_dir() && depth < DEPTH_MAX {
            search(&path, depth + 1, found)?;
        } else if path.is_file() && ending.is_some_and(|ending| ENDINGS.contains(&ending)) {
            found.push(path.to_string_lossy().into_owned());
        }
    }
    Ok(())
}

/// Returns false for other files: libraries of fragments, configurations.
fn is_net((name, text): &(String, String)) -> bool {
    let is_foreign = name.ends_with(".net") || name.ends_with(".dio");
    is_foreign || !name_of(text).is_empty()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn finding(severity: &str) -> Finding {
        Finding {
            severity: severity.to_owned(),
            ..Finding::default()
        }
    }

    #[test]
    fn a_summary_counts_valid_nets_and_findings() {
        let verdict = |valid: bool, severities: &[&str]| NetVerdict {
            file: String::new(),
            valid,
            net: String::new(),
            primitives: 0,
            rehearsal: None,
            diagnostics: severities.iter().map(|it| finding(it)).collect(),
        };
        let mut summary = CheckSummary::default();
        summary.count(&verdict(true, &[]));
        assert_eq!(summary.text(0.5), "1 net: all valid; 0.50 s");
        summary.count(&verdict(true, &["warning"]));
        summary.count(&verdict(false, &["error", "error", "warning"]));
        summary.others = 1;
        assert_eq!(
            summary.text(0.5),
            "3 nets: 2 valid, 1 not, 2 errors, 2 warnings; 1 file skipped (not a net); 0.50 s"
        );
    }

    #[test]
    fn a_folder_is_searched_for_nets_in_order() {
        let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs");
        let found = nets_in(&configs).unwrap_or_default();
        assert!(found.is_sorted() && found.len() > 10, "{found:?}");
        let read = |name: &str| {
            let path = found.iter().find(|path| path.ends_with(name)).cloned();
            path.and_then(|path| read_text(&path).ok())
        };
        assert!(read("nets/line.yaml").is_some_and(|source| is_net(&source)));
        assert!(read("cells/demo.yaml").is_some_and(|source| !is_net(&source)));
    }
}
