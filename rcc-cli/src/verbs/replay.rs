//! `replay [FILE]`: evaluates the nets of an incident again with the recorded inputs and compares every cycle. Needs only
//! the file: neither a cell nor the machine that recorded it.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use rcc_api::codes;
use rcc_core::counted::Counted;
use rcc_engine::incident::{Incident, IncidentError};
use rcc_engine::net::Evaluation;
use rcc_engine::replay::{
    Mismatch, MismatchKind, NetReplayResult, ReplaySource, ReplayStep, RuleReplayResult,
    replay_with_rules,
};
use rcc_protocol::pattern::Pattern;
use rcc_recording::file::RecordingError;
use serde::Serialize;
use serde_json::{Map, Value, json};

use self::mcap::{IncidentRecording, RecordedPart};
use super::incidents::{incidents_dir, newest, reason};
use crate::context::{Context, OutputFormat};
use crate::csv;
use crate::failure::Failure;
use crate::output::{print_line, print_note, print_record};
use crate::result_file::WrittenFile;
use crate::table::{self, counted, grouped};
use rcc_api::incident_nets::{IncidentNet, ShownSlots, text, value_of};

mod mcap;
mod rules;

/// Arguments of `replay`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Incident file, or its name in the list of `rcc-cli incidents`; without it the newest one of the cell
    file: Option<PathBuf>,
    /// Stop after this executor cycle
    #[arg(long, value_name = "CYCLE")]
    until: Option<u64>,
    /// Show values from this executor cycle on
    #[arg(long, value_name = "CYCLE", requires = "show")]
    from: Option<u64>,
    /// Show these values in each cycle: net/primitive.port, with * and ? as wildcards
    #[arg(long, value_name = "PATTERN")]
    show: Vec<Pattern>,
    /// Write the values to this CSV file instead
    #[arg(long, value_name = "FILE", requires = "show")]
    csv: Option<PathBuf>,
    /// Write every port (or those of --show), the devices and the events to this MCAP file
    #[arg(long, value_name = "FILE")]
    mcap: Option<PathBuf>,
}

impl Arguments {
    /// Returns true unless an existing file is given: then the incidents of a cell are meant.
    #[must_use]
    pub fn is_of_a_cell(&self) -> bool {
        self.file.as_deref().is_none_or(is_name)
    }
}

/// Returns true for a name in the list of a cell's incidents.
fn is_name(given: &Path) -> bool {
    given.components().count() == 1 && !given.exists()
}

/// Result of one net.
#[derive(Clone, Debug, Serialize)]
struct ReplayResult {
    net: String,
    recorded: u64,
    compared: u64,
    different: u64,
    first_cycle: u64,
    last_cycle: u64,
    identical: bool,
    words: String,
    mismatch: Option<Value>,
}

/// Runs the verb.
///
/// # Errors
/// Fails if the file cannot be replayed, if the replay differs, or if there is nothing to compare.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let file = find(context, arguments.file.as_deref())?;
    let path = file.display().to_string();
    let incident = Incident::read(&file).map_err(|error| unusable(&path, error))?;
    let named: BTreeMap<u64, IncidentNet> = incident
        .nets
        .keys()
        .map(|id| {
            (
                *id,
                IncidentNet::of(*id, incident.files.get(id).map(Vec::as_slice)),
            )
        })
        .collect();
    let mut show = ValuePrinter::new(context.format, &arguments, &named)?;
    let source = ReplaySource {
        models: &incident.models,
        configuration: incident.configuration,
        nets: &incident.nets,
        words: &incident.records,
    };
    let from = arguments.from.unwrap_or(0);
    let mut shown = Ok(());
    let part = RecordedPart {
        nets: &named,
        show: &arguments.show,
        from,
    };
    let mcap = arguments.mcap.as_deref();
    let mut recording = mcap
        .map(|path| IncidentRecording::create(path, &incident, &part))
        .transpose()
        .map_err(|error| not_recorded(&error))?;
    let results = replay_with_rules(&source, arguments.until, |step| {
        if let Some(recording) = &mut recording {
            recording.step(&step);
        }
        if step.cycle >= from && shown.is_ok() {
            shown = show.step(&step);
        }
    });
    let (results, rules) = results.map_err(|error| {
        Failure::new(
            codes::NO_INCIDENT,
            format!("{path}: {error}"),
            "copy the file again",
        )
    })?;
    shown.and_then(|()| show.end()).map_err(|error| {
        let what = arguments.csv.as_deref().unwrap_or(Path::new("the output"));
        Failure::new(
            codes::NOT_STORED,
            format!("{}: {error}", what.display()),
            "free disk space there",
        )
    })?;
    if let Some(recording) = recording {
        let written = recording.finish(&incident, arguments.until);
        let (_, rounded) = written.map_err(|error| not_recorded(&error))?;
        if rounded > 0 {
            print_note(&format!(
                "{} beyond ±2^53 are rounded in the MCAP file",
                Counted(rounded, "Int value")
            ));
        }
    }
    for path in [&arguments.csv, &arguments.mcap].into_iter().flatten() {
        if context.format == OutputFormat::Human {
            print_note(&WrittenFile::of(path)?.describe());
        }
    }
    print_results(context, &incident, (&results, &rules), &named)
}

/// Returns the file to replay: a path, the name of one of the cell's incidents, or the newest of them.
fn find(context: &Context, given: Option<&Path>) -> Result<PathBuf, Failure> {
    if let Some(given) = given {
        let kept = if is_name(given) {
            incidents_dir(context).ok()
        } else {
            None
        };
        let kept = kept
            .map(|folder| folder.join(given))
            .filter(|path| path.exists());
        return Ok(kept.unwrap_or_else(|| given.to_owned()));
    }
    let folder = incidents_dir(context)?;
    newest(&folder)?.ok_or_else(|| {
        let (name, folder) = (context.cell_name(), folder.display());
        Failure::new(
            codes::NO_INCIDENT,
            format!("cell `{name}` has no incidents in {folder}"),
            "`rcc-cli incidents record` records one now; --cell names another cell",
        )
    })
}

fn not_recorded(error: &RecordingError) -> Failure {
    let help = "name a writable file on a disk with space";
    Failure::new(codes::NOT_STORED, error.to_string(), help)
}

fn unusable(path: &str, error: IncidentError) -> Failure {
    match error {
        IncidentError::Read(error) => Failure::unreadable(path, &error),
        IncidentError::NotAnIncident => Failure::new(
            codes::NO_INCIDENT,
            format!("{path}: {error}"),
            "`rcc-cli incidents` lists them",
        ),
        other => Failure::new(codes::NO_INCIDENT, format!("{path}: {other}"), ""),
    }
}

/// Prints the result.
fn print_results(
    context: &Context,
    incident: &Incident,
    (results, rules): (&[NetReplayResult], &RuleReplayResult),
    named: &BTreeMap<u64, IncidentNet>,
) -> Result<(), Failure> {
    let unnamed = IncidentNet::default();
    let rows: Vec<ReplayResult> = results
        .iter()
        .map(|result| result_of(result, named.get(&result.id).unwrap_or(&unnamed)))
        .collect();
    let head = &incident.head;
    let value = json!({
        "cell": head.cell, "build": head.build, "time": head.time, "reason": reason(head), "cycle": head.cycle,
        "first_cycle": head.first_cycle, "last_cycle": head.last_cycle, "nets": rows, "rules": rules::value(rules),
    });
    let clean = |text: &str| text.replace(char::is_control, " ");
    context.print(&value, |_| {
        let mut lines = table::table(&["NET", "RECORDED", "COMPARED", "CYCLES", "RESULT"]);
        for row in &rows {
            lines.add_row([
                clean(&row.net),
                grouped(row.recorded),
                grouped(row.compared),
                match row.first_cycle {
                    0 => "–".to_owned(),
                    first => format!("{} to {}", grouped(first), grouped(row.last_cycle)),
                },
                clean(&row.words),
            ]);
        }
        let of = format!(
            "{}, {}, cycle {}: {}",
            clean(&head.cell),
            clean(&head.time),
            grouped(head.cycle),
            clean(&reason(head))
        );
        if rows.is_empty() {
            return format!("{of}\nno net was evaluated");
        }
        format!("{of}\n{}{}", table::text(&lines), rules::describe(rules))
    });
    match rows.iter().filter(|row| row.different > 0).count() {
        0 if !rows.is_empty() && rows.iter().all(|row| row.compared == 0) => Err(Failure::new(
            codes::NOT_COMPARED,
            "no cycle of any net could be compared",
            "see the lines above for the reason; `recorder: {memory: …}` in the cell's configuration records more",
        )),
        0 => rules::verdict(rules),
        different => Err(Failure::new(
            codes::REPLAY_DIFFERS,
            format!(
                "{different} of {} differ from the recording",
                Counted::of(rows.len(), "net")
            ),
            "the same plan and inputs must give the same bits: report this as a bug, with the file",
        )),
    }
}

fn result_of(result: &NetReplayResult, named: &IncidentNet) -> ReplayResult {
    let net = match named.id {
        0 => format!("#{}", result.id),
        _ => named.title(),
    };
    let verdict = match (&result.mismatch, result.compared) {
        (Some(mismatch), _) => describe_mismatch(mismatch, result, named),
        (None, 0) if !result.has_plan => {
            "not compared: its plan is not in the file because it was unloaded too early".to_owned()
        }
        (None, 0) if result.too_large > 0 => format!(
            "not compared: its start is overwritten, and a snapshot of {} MB does not fit; give the recorder more \
             memory",
            (result.too_large * 8) >> 20
        ),
        (None, 0) => "not compared: neither its start nor a snapshot was recorded".to_owned(),
        (None, _) => "identical".to_owned(),
    };
    ReplayResult {
        net,
        recorded: result.recorded,
        compared: result.compared,
        different: result.different,
        first_cycle: result.span[0],
        last_cycle: result.span[1],
        identical: result.compared > 0 && result.different == 0,
        words: verdict,
        mismatch: result
            .mismatch
            .as_ref()
            .map(|mismatch| mismatch_json(mismatch, named)),
    }
}

fn describe_mismatch(mismatch: &Mismatch, result: &NetReplayResult, named: &IncidentNet) -> String {
    let what = match mismatch.what {
        MismatchKind::Slots => String::new(),
        MismatchKind::Evaluation { recorded, replayed } => {
            format!(
                ", it {} in the recording and {} in the replay",
                describe_evaluation(recorded),
                describe_evaluation(replayed)
            )
        }
        MismatchKind::Cycles { recorded, replayed } => {
            format!(", its cycle {recorded} is cycle {replayed} of the replay: records are missing")
        }
    };
    let mut description = format!(
        "DIFFERS in {}, first in cycle {} (net cycle {}){what}",
        counted(result.different, "cycle"),
        grouped(mismatch.cycle),
        grouped(mismatch.net_cycle)
    );
    if let Some(slot) = &mismatch.slot {
        let value = |bits| text(&value_of(slot.store, bits), "null");
        description.push_str(&format!(
            "; in the snapshot of cycle {}, {} was {} and is {} in the replay",
            grouped(slot.cycle),
            named.slot(slot),
            value(slot.recorded),
            value(slot.replayed)
        ));
    }
    description
}

fn describe_evaluation(evaluation: Evaluation) -> String {
    match evaluation {
        Evaluation::Running => "continued".to_owned(),
        Evaluation::Terminated => "had terminated".to_owned(),
        Evaluation::Fault(code) => format!("ended by a fault ({})", code.name()),
    }
}

fn mismatch_json(mismatch: &Mismatch, named: &IncidentNet) -> Value {
    let slot = mismatch.slot.as_ref().map(|slot| {
        json!({
            "cycle": slot.cycle, "name": named.slot(slot), "recorded": value_of(slot.store, slot.recorded),
            "replayed": value_of(slot.store, slot.replayed),
        })
    });
    json!({"cycle": mismatch.cycle, "net_cycle": mismatch.net_cycle, "slot": slot})
}

/// Prints or stores the shown values, cycle by cycle.
struct ValuePrinter {
    format: OutputFormat,
    /// Shown slots of each net, and the index of its first column.
    nets: BTreeMap<u64, (Vec<ShownSlots>, usize)>,
    columns: usize,
    csv: Option<BufWriter<File>>,
    first_ns: Option<u64>,
    /// The row that is being filled: cycle, time, values.
    row: Option<(u64, f64, Vec<String>)>,
}

impl ValuePrinter {
    fn new(
        format: OutputFormat,
        arguments: &Arguments,
        named: &BTreeMap<u64, IncidentNet>,
    ) -> Result<ValuePrinter, Failure> {
        let mut show = ValuePrinter {
            format,
            nets: BTreeMap::new(),
            columns: 0,
            csv: None,
            first_ns: None,
            row: None,
        };
        let mut heads = vec!["cycle".to_owned(), "time_s".to_owned()];
        // Ports of an MCAP file are not also printed.
        let only_mcap = arguments.mcap.is_some() && arguments.csv.is_none();
        for (id, named) in named {
            let shown = named.shown(&arguments.show);
            let first = show.columns;
            let columns: Vec<String> = shown.iter().flat_map(ShownSlots::columns).collect();
            show.columns += columns.len();
            heads.extend(columns);
            if !only_mcap {
                show.nets.insert(*id, (shown, first));
            }
        }
        if show.columns == 0 && !arguments.show.is_empty() {
            let names: Vec<&str> = named.values().map(|named| named.net.as_str()).collect();
            return Err(Failure::new(
                codes::BAD_REQUEST,
                "no port of a recorded net matches --show",
                format!(
                    "recorded nets: {}; write net/primitive.port, with * and ? as wildcards",
                    names.join(", ")
                ),
            ));
        }
        if let Some(path) = &arguments.csv {
            let failed = |error| {
                let help = "name a writable file";
                Failure::new(
                    codes::NOT_STORED,
                    format!("{}: {error}", path.display()),
                    help,
                )
            };
            let mut file = BufWriter::new(File::create(path).map_err(failed)?);
            writeln!(file, "{}", csv::line(&heads)).map_err(failed)?;
            show.csv = Some(file);
        }
        Ok(show)
    }

    fn step(&mut self, step: &ReplayStep<'_>) -> std::io::Result<()> {
        let Some((shown, first)) = self.nets.get(&step.id) else {
            return Ok(());
        };
        if shown.is_empty() {
            return Ok(());
        }
        let since_ns = step
            .woke_ns
            .saturating_sub(*self.first_ns.get_or_insert(step.woke_ns));
        let seconds = since_ns as f64 * 1e-9;
        if self.csv.is_some() {
            let values = shown.iter().flat_map(|one| one.values(step.net));
            let values: Vec<String> = values.map(|value| text(&value, "")).collect();
            let first = *first;
            if self
                .row
                .as_ref()
                .is_none_or(|(cycle, ..)| *cycle != step.cycle)
            {
                self.end_row()?;
                self.row = Some((step.cycle, seconds, vec![String::new(); self.columns]));
            }
            if let Some((_, _, row)) = &mut self.row {
                for (slot, value) in row.iter_mut().skip(first).zip(values) {
                    *slot = value;
                }
            }
            return Ok(());
        }
        match self.format {
            OutputFormat::Human => {
                for one in shown {
                    let values = one.values(step.net);
                    let values: Vec<String> = values.iter().map(|value| text(value, "–")).collect();
                    let mark = if step.same { ' ' } else { '≠' };
                    let (cycle, name) = (grouped(step.cycle), &one.name);
                    print_line(&format!(
                        "{cycle:>10} {mark} {name:<24} {}",
                        values.join(" ")
                    ));
                }
            }
            OutputFormat::Json => {
                let values = shown.iter().map(|one| {
                    let mut all = one.values(step.net);
                    let value = match (all.len(), all.pop()) {
                        (1, Some(one)) => one,
                        (_, last) => all.into_iter().chain(last).collect(),
                    };
                    (one.name.clone(), value)
                });
                let values: Map<String, Value> = values.collect();
                let line = json!({
                    "cycle": step.cycle, "time_s": seconds, "command": step.id, "same": step.same, "values": values,
                });
                print_record(&line.to_string());
            }
        }
        Ok(())
    }

    fn end_row(&mut self) -> std::io::Result<()> {
        if let (Some(file), Some((cycle, seconds, row))) = (&mut self.csv, self.row.take()) {
            writeln!(file, "{cycle},{seconds:.6},{}", row.join(","))?;
        }
        Ok(())
    }

    fn end(&mut self) -> std::io::Result<()> {
        self.end_row()?;
        self.csv.as_mut().map_or(Ok(()), Write::flush)
    }
}
