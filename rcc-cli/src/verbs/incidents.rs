//! `incidents`: lists the files of the flight recorder; `incidents record`: records one now. The list is read from files
//! of the state folder, so it works while every process of the cell is dead, and after its end.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use rcc_api::bodies::WrittenIncident;
use rcc_api::codes;
use rcc_engine::incident::{EXTENSION, IncidentError, IncidentHead, read_head};
use serde::Serialize;

use crate::context::Context;
use crate::evidence::Evidence;
use crate::failure::Failure;
use crate::incident::IncidentNet;
use crate::output::print_note;
use crate::table;

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
}

/// A row of the list.
#[derive(Clone, Debug, Serialize)]
struct IncidentRow {
    file: PathBuf,
    /// Title of the net that caused it, such as `line#3`; its id is in the head.
    name: Option<String>,
    span_s: f64,
    #[serde(flatten)]
    head: IncidentHead,
}

/// Runs the verb.
///
/// # Errors
/// Fails if the cell or folder does not exist, or if nothing can be recorded.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    match arguments.what {
        None => {
            let folder = match arguments.folder {
                Some(folder) => folder,
                None => incidents_dir(context)?,
            };
            let rows = rows(&folder)?;
            context.print(&rows, |rows| list(rows));
            Ok(())
        }
        Some(IncidentsCommand::Record) => record(context),
    }
}

/// Returns the cell's folder of incidents; says where it is if the cell is not up.
pub(super) fn incidents_dir(context: &Context) -> Result<PathBuf, Failure> {
    let evidence = Evidence::find(context)?;
    evidence.note(context, "its incidents are");
    Ok(evidence.state.incidents_dir())
}

/// Returns the newest incident file of a folder.
pub(super) fn newest(folder: &Path) -> Result<Option<PathBuf>, Failure> {
    Ok(rows(folder)?.pop().map(|row| row.file))
}

/// Returns the incidents of a folder, oldest first. Skips other files; reports files that cannot be read.
fn rows(folder: &Path) -> Result<Vec<IncidentRow>, Failure> {
    let entries = match std::fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(Failure::unreadable(&folder.display().to_string(), &error)),
    };
    let mut rows = Vec::new();
    for path in entries.flatten().map(|entry| entry.path()) {
        if path.extension().is_none_or(|is| is != EXTENSION) {
            continue;
        }
        match read_head(&path) {
            Ok((head, command)) => rows.push(row(path, head, command.as_deref())),
            // The recorder has just removed one of the oldest files.
            Err(IncidentError::Read(error)) if error.kind() == std::io::ErrorKind::NotFound => {}
            Err(error) => print_note(&format!("{}: {error}", path.display())),
        }
    }
    rows.sort_by(|a, b| a.head.time.cmp(&b.head.time));
    Ok(rows)
}

fn row(file: PathBuf, head: IncidentHead, command: Option<&[u8]>) -> IncidentRow {
    let name = head.net.map(|id| IncidentNet::of(id, command).title());
    let cycles = (head.last_cycle + 1).saturating_sub(head.first_cycle);
    IncidentRow {
        file,
        name,
        span_s: cycles as f64 * head.period_ns as f64 * 1e-9,
        head,
    }
}

fn list(rows: &[IncidentRow]) -> String {
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
            clean(row.head.time.get(..19).unwrap_or(&row.head.time)),
            clean(&row.head.cell),
            clean(&reason(&row.head)),
            clean(row.name.as_deref().unwrap_or("–")),
            table::grouped(row.head.cycle),
            format!("{:.1} s", row.span_s),
            row.file.display().to_string(),
        ]);
    }
    table::text(&lines)
}

/// Describes why a recording was frozen.
pub(super) fn reason(head: &IncidentHead) -> String {
    let mut reason = head.reason.clone();
    if let Some(fault) = &head.fault {
        reason = format!("{reason}: {fault}");
    }
    match head.others {
        0 => reason,
        others => format!("{reason} (and {others} more)"),
    }
}

fn record(context: &Context) -> Result<(), Failure> {
    let frozen: WrittenIncident = context.client()?.post("/incidents", String::new())?;
    if context.remote.is_some() {
        context.print(&frozen, |frozen| {
            format!(
                "recording frozen at cycle {}; the file is on the cell's machine",
                table::grouped(frozen.cycle)
            )
        });
        return Ok(());
    }
    let folder = incidents_dir(context)?;
    let started = Instant::now();
    while started.elapsed() < WRITE_TIMEOUT {
        let written = rows(&folder)?.into_iter().find(|row| {
            let span = row.head.first_cycle..=row.head.last_cycle;
            row.head.executor == frozen.executor && span.contains(&frozen.cycle)
        });
        if let Some(row) = written {
            context.print(&row, |row| {
                format!("recorded {:.1} s in {}", row.span_s, row.file.display())
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
