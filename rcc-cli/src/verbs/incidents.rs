//! `incidents`: lists the files of the flight recorder; `incidents record`: records one now, `incidents arm` when a
//! condition becomes true; `incidents fetch` downloads one. The list is read from files of the state folder, so it works while every process of the cell is dead, and after its
//! end; with `--url` the loader gives it.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use rcc_api::bodies::{IncidentView, WrittenIncident};
use rcc_api::codes;
use rcc_api::incidents::IncidentFolder;
use rcc_engine::incident::IncidentHead;

use self::arm::ArmArguments;
use self::fetch::FetchArguments;
use crate::context::Context;
use crate::failure::Failure;
use crate::kept_state::KeptState;
use crate::output::print_note;
use crate::table;

mod arm;
mod fetch;

/// Interval between two checks for the requested file.
const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// Time limit for the requested file: recording continues for a fifth of a second, and the disk may be slow.
const WRITE_TIMEOUT: Duration = Duration::from_secs(20);

/// Arguments of `incidents`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// List this folder instead of the cell's
    #[arg(long, value_name = "FOLDER")]
    folder: Option<PathBuf>,
    #[command(subcommand)]
    what: Option<IncidentsCommand>,
}

#[derive(clap::Subcommand, Debug)]
enum IncidentsCommand {
    /// Record the last seconds to a file now
    Record,
    /// Record the last seconds when a condition becomes true, such as 'ft.fz > 30'
    Arm(ArmArguments),
    /// List the armed conditions, and those that have fired
    Armed,
    /// Disarm conditions
    Disarm {
        /// Numbers of the conditions
        #[arg(required = true)]
        numbers: Vec<u64>,
    },
    /// Download an incident file
    Fetch(FetchArguments),
}

/// Runs the verb.
///
/// # Errors
/// Fails if the cell or folder does not exist, or if nothing can be recorded.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    match arguments.what {
        None => {
            let rows = match (arguments.folder, &context.remote) {
                (Some(folder), None) => rows(&folder)?,
                (Some(folder), Some(_)) => return Err(local_folder(&folder)),
                (None, None) => rows(&incidents_dir(context)?)?,
                (None, Some(_)) => context.client()?.get("/incidents")?,
            };
            context.print(&rows, |rows| list(rows));
            Ok(())
        }
        Some(IncidentsCommand::Fetch(arguments)) => fetch::run(context, arguments),
        Some(IncidentsCommand::Record) => record(context),
        Some(IncidentsCommand::Arm(arguments)) => arm::arm(context, arguments),
        Some(IncidentsCommand::Armed) => arm::list(context),
        Some(IncidentsCommand::Disarm { numbers }) => arm::disarm(context, &numbers),
    }
}

fn local_folder(folder: &Path) -> Failure {
    let message = format!("--folder {} is a folder of this machine", folder.display());
    let help = "omit --url (RCC_URL), or omit --folder to list the incidents of the cell";
    Failure::new(codes::BAD_REQUEST, message, help)
}

/// Returns the cell's folder of incidents; says where it is if the cell is not up.
pub(super) fn incidents_dir(context: &Context) -> Result<PathBuf, Failure> {
    let kept = KeptState::find(context)?;
    kept.note(context, "its incidents are");
    Ok(kept.state.incidents_dir())
}

/// Returns the newest incident file of a folder.
pub(super) fn newest(folder: &Path) -> Result<Option<PathBuf>, Failure> {
    Ok(rows(folder)?.pop().map(|row| PathBuf::from(row.file)))
}

/// Returns the incidents of a folder, oldest first; reports files that cannot be read.
fn rows(folder: &Path) -> Result<Vec<IncidentView>, Failure> {
    let found = IncidentFolder::read(folder)
        .map_err(|error| Failure::unreadable(&folder.display().to_string(), &error))?;
    for (path, error) in &found.unreadable {
        print_note(&format!("{}: {error}", path.display()));
    }
    Ok(found.incidents)
}

fn list(rows: &[IncidentView]) -> String {
    if rows.is_empty() {
        return "no incidents".to_owned();
    }
    let heads = [
        "TIME (UTC)",
        "CELL",
        "REASON",
        "NET",
        "CYCLE",
        "SPAN",
        "FILE",
    ];
    let mut lines = table::table(&heads);
    for row in rows {
        // The files may come from anywhere: control characters must not reach the terminal.
        let clean = |text: &str| text.replace(char::is_control, " ");
        lines.add_row([
            clean(row.time.get(..19).unwrap_or(&row.time)),
            clean(&row.cell),
            clean(&description(
                &row.reason,
                row.fault.as_deref().or(row.condition.as_deref()),
                row.others,
            )),
            clean(row.name.as_deref().unwrap_or("–")),
            table::grouped(row.cycle),
            format!("{:.1} s", row.span_s),
            row.file.clone(),
        ]);
    }
    table::text(&lines)
}

/// Describes why a recording was frozen.
pub(super) fn reason(head: &IncidentHead) -> String {
    let detail = head.fault.as_deref().or(head.condition.as_deref());
    description(&head.reason, detail, head.others)
}

fn description(reason: &str, detail: Option<&str>, others: u64) -> String {
    let mut reason = reason.to_owned();
    if let Some(detail) = detail {
        reason = format!("{reason}: {detail}");
    }
    match others {
        0 => reason,
        others => format!("{reason} (and {others} more)"),
    }
}

fn record(context: &Context) -> Result<(), Failure> {
    let frozen: WrittenIncident = context.client()?.post("/incidents", String::new())?;
    if context.remote.is_some() {
        context.print(&frozen, |frozen| {
            format!(
                "recording frozen at cycle {}, in {} on the cell's machine; `rcc-cli incidents fetch {}` downloads it",
                table::grouped(frozen.cycle),
                frozen.file,
                frozen.file,
            )
        });
        return Ok(());
    }
    let folder = incidents_dir(context)?;
    let started = Instant::now();
    while started.elapsed() < WRITE_TIMEOUT {
        let written = rows(&folder)?.into_iter().find(|row| {
            let span = row.first_cycle..=row.last_cycle;
            row.executor == frozen.executor && span.contains(&frozen.cycle)
        });
        if let Some(row) = written {
            context.print(&row, |row| {
                format!("recorded {:.1} s in {}", row.span_s, row.file)
            });
            return Ok(());
        }
        std::thread::sleep(POLL_INTERVAL);
    }
    Err(Failure::new(
        codes::EXECUTOR_SILENT,
        format!("no incident file was written within {WRITE_TIMEOUT:?}"),
        "see `rcc-cli events` for a failure; `rcc-cli incidents` lists files written later",
    ))
}
