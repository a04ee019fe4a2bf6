//! `simulate NET`: the net in virtual time against simple device models, without a cell; results as table, CSV and SVG.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use rcc_config::CellConfig;
use rcc_core::message::{CommandState, EndReason};
use rcc_language::names::Names;
use rcc_loader::server::api::FaultView;
use rcc_loader::server::codes::{self, exit};
use rcc_loader::server::compile::compile;
use rcc_loader::server::words::Namer;
use serde::Serialize;

use super::check::load_config;
use crate::context::{Context, Format};
use crate::failure::{Failure, draw};
use crate::follow::read_net;
use crate::simulate::script::Step;
use crate::simulate::{self, Options, SimulateError, Simulated, plot};
use crate::supervisor::places;
use crate::table;

/// What to simulate.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// A net, YAML or JSON; - is the standard input.
    file: String,
    /// The cell's configuration whose devices are imitated (default: the demo cell's).
    #[arg(long)]
    config: Option<PathBuf>,
    /// Longest logical time.
    #[arg(long = "for", value_name = "TIME", default_value = "60s", value_parser = super::duration)]
    limit: Duration,
    /// CANCEL after this time; a net without Cancel is aborted.
    #[arg(long, value_name = "TIME", value_parser = super::duration)]
    cancel_at: Option<Duration>,
    /// An input of a device: io.door_closed=true@2s, io.temperature=300K; without a time from the beginning.
    #[arg(long, value_name = "DEVICE.CHANNEL=VALUE[@TIME]")]
    input: Vec<String>,
    /// Writes what monitors show, a line for each cycle in which one is due.
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Draws what monitors show.
    #[arg(long, value_name = "FILE.svg")]
    plot: Option<PathBuf>,
}

#[derive(Serialize)]
struct Report {
    net: String,
    state: String,
    reason: Option<String>,
    fault: Option<FaultView>,
    cycles: u64,
    time_s: f64,
    monitors: Vec<Value>,
}

#[derive(Serialize)]
struct Value {
    name: String,
    unit: String,
    last: Option<f64>,
}

/// Does it.
///
/// # Errors
/// The net or an argument is not valid, it is refused, or it ends with a fault or an abort.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let path = match &arguments.config {
        Some(path) => path.clone(),
        None => places::config("cells/demo.yaml")?,
    };
    let config = load_config(&path)?;
    let options = options(&arguments, &config)?;
    let source = read_net(&arguments.file)?;
    let compiled = compile(&source.1, &source.0, &config).map_err(|diagnostics| {
        let what = format!("{} is not valid", source.0);
        Failure::invalid(&what, diagnostics, source.clone())
    })?;
    eprint!("{}", draw(&compiled.warnings, Some(&source), Context::colour()));
    let names: Names = serde_json::from_value(compiled.names).map_err(|error| {
        Failure::new(codes::PROCESS_FAILED, error.to_string(), "report it with the net")
    })?;
    let mut csv = arguments.csv.as_deref().map(create).transpose()?;
    let table = csv.as_mut().map(|file| file as &mut dyn Write);
    let begun = Instant::now();
    let simulated = simulate::run(&config, compiled.plan, &names, &options, table)
        .map_err(|error| failure(&error, &names.net, &config, arguments.csv.as_deref()))?;
    let took = begun.elapsed();
    let report = report(&names.net, &simulated, &config);
    if let Some(path) = &arguments.plot {
        let picture = plot::svg(&report.net, simulated.trace.columns(), report.time_s);
        let written = create(path)?.write_all(picture.as_bytes());
        written.map_err(|error| not_written(path, &error))?;
    }
    context.print(&report, human);
    if context.format == Format::Human {
        eprintln!("{}", speed(&simulated, took));
    }
    match EndReason::from_number(simulated.command.reason) {
        EndReason::Fault | EndReason::Aborted => Err(Failure::said(exit::FAILED)),
        EndReason::None | EndReason::Finished | EndReason::Canceled => Ok(()),
    }
}

fn options(arguments: &Arguments, config: &CellConfig) -> Result<Options, Failure> {
    let ns = |time: Duration| time.as_nanos().try_into().unwrap_or(u64::MAX);
    let steps = arguments.input.iter().map(|text| Step::parse(text, config));
    let steps = steps.collect::<Result<_, _>>().map_err(|error| {
        let help = "`rcc-cli simulate --help` shows how";
        Failure::new(codes::BAD_REQUEST, error.to_string(), help)
    })?;
    Ok(Options {
        limit_ns: ns(arguments.limit),
        cancel_at_ns: arguments.cancel_at.map(ns),
        steps,
    })
}

fn create(path: &Path) -> Result<BufWriter<File>, Failure> {
    let file = File::create(path).map_err(|error| not_written(path, &error))?;
    Ok(BufWriter::new(file))
}

fn not_written(path: &Path, error: &std::io::Error) -> Failure {
    let message = format!("{} cannot be written: {error}", path.display());
    Failure::new(codes::NOT_STORED, message, "name another file")
}

fn with_namer<T>(net: &str, config: &CellConfig, what: impl FnOnce(&Namer<'_>) -> T) -> T {
    what(&Namer {
        config,
        net: &|_| net.to_owned(),
        reason: &|_, _| String::new(),
    })
}

fn failure(error: &SimulateError, net: &str, config: &CellConfig, csv: Option<&Path>) -> Failure {
    match error {
        SimulateError::Refused(refusal) => {
            let refused = with_namer(net, config, |namer| namer.refusal(1, *refusal));
            Failure::answered(refused.body())
        }
        SimulateError::Write(error) => not_written(csv.unwrap_or(Path::new("the table")), error),
        SimulateError::Silent => Failure::new(codes::PROCESS_FAILED, error.to_string(), "report it"),
    }
}

fn report(net: &str, simulated: &Simulated, config: &CellConfig) -> Report {
    let command = &simulated.command;
    let reason = EndReason::from_number(command.reason);
    let columns = simulated.trace.columns().iter();
    let monitors = columns.filter(|column| column.seen).map(|column| Value {
        name: column.name.clone(),
        unit: column.unit.clone(),
        last: column.last,
    });
    Report {
        net: net.to_owned(),
        state: CommandState::from_number(command.state).name().to_owned(),
        reason: (reason != EndReason::None).then(|| reason.name().to_owned()),
        fault: with_namer(net, config, |namer| namer.fault(&command.fault)),
        cycles: command.cycles,
        time_s: simulated.cycles as f64 * simulated.period_ns as f64 / 1e9,
        monitors: monitors.collect(),
    }
}

fn human(report: &Report) -> String {
    let state = match (&report.fault, &report.reason) {
        (Some(fault), _) => format!("{} (fault: {})\n{}", report.state, fault.fault, fault.words),
        (None, Some(reason)) => format!("{} ({reason})", report.state),
        (None, None) => report.state.clone(),
    };
    let cycles = table::grouped(report.cycles);
    let head = format!("{}  after {} s, {cycles} cycles  {state}", report.net, report.time_s);
    if report.monitors.is_empty() {
        return head;
    }
    let mut rows = table::table(&["MONITOR", "LAST", "UNIT"]);
    for row in &report.monitors {
        let last = row.last.map_or("null".to_owned(), |value| format!("{value:.6}"));
        rows.add_row([&row.name, &last, &row.unit]);
    }
    format!("{head}\n\n{}", table::text(&rows))
}

/// On stderr: the only thing that is another one each time.
fn speed(simulated: &Simulated, took: Duration) -> String {
    let seconds = took.as_secs_f64().max(1e-9);
    let rate = simulated.cycles as f64 / seconds;
    let times = rate * simulated.period_ns as f64 / 1e9;
    format!(
        "{} cycles in {:.1} ms: {} cycles a second, {} times real time",
        table::grouped(simulated.cycles),
        1e3 * seconds,
        table::grouped(rate as u64),
        table::grouped(times as u64)
    )
}
