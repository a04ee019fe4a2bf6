//! `simulate NET`: runs a net in virtual time against simple device models, without a cell; results as table, CSV and
//! SVG.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use rcc_api::bodies::{FaultView, RehearsalView};
use rcc_api::codes::{self, RequestedEnd, exit};
use rcc_api::compile::compile;
use rcc_api::messages::NameResolver;
use rcc_config::CellConfig;
use rcc_core::message::{CommandState, EndReason};
use rcc_language::names::Names;
use rcc_protocol::control::PlanData;
use serde::Serialize;

use super::check::{load_config, require_valid_settings};
use super::plot;
use crate::context::{Context, OutputFormat};
use crate::failure::{Failure, draw};
use crate::follow::read_net;
use crate::output::{print_diagnostics, print_note};
use crate::plot::Plot;
use crate::simulate::script::ScriptStep;
use crate::simulate::trace;
use crate::simulate::{self, SimulateError, SimulationOptions, SimulationResult};
use crate::supervisor::paths;
use crate::table;

/// Default limit of logical time.
const LIMIT: Duration = Duration::from_secs(60);

/// Net, devices and events of a simulation.
#[derive(clap::Args, Debug)]
pub struct SimulationScenario {
    /// Net (YAML or JSON); - reads standard input
    pub file: String,
    /// Cell configuration whose devices are simulated [default: the demo cell's]
    #[arg(long)]
    pub config: Option<PathBuf>,
    /// End after this logical time; without it, a net that still runs after 60s is an error
    #[arg(long = "for", value_name = "TIME", value_parser = super::duration)]
    pub limit: Option<Duration>,
    /// Cancel after this time; a net without Cancel is aborted
    #[arg(long, value_name = "TIME", value_parser = super::duration)]
    pub cancel_at: Option<Duration>,
    /// Set a device input: io.door_closed=true@2s, io.temperature=300K; without a time, from the start
    #[arg(long, value_name = "DEVICE.CHANNEL=VALUE[@TIME]")]
    pub input: Vec<String>,
}

/// A scenario whose files have been read.
pub struct PreparedScenario {
    /// Configuration of the cell.
    pub config: CellConfig,
    /// Plan of the net.
    pub plan: PlanData,
    /// Names of its ports.
    pub names: Names,
    /// Events and limits.
    pub options: SimulationOptions,
}

/// Arguments of `simulate`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    #[command(flatten)]
    scenario: SimulationScenario,
    /// Write monitored values to this file, one line per cycle in which one is due
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Plot monitored values to this file
    #[arg(long, value_name = "FILE.svg")]
    plot: Option<PathBuf>,
}

#[derive(Serialize)]
struct SimulateReport {
    net: String,
    state: String,
    reason: Option<String>,
    fault: Option<FaultView>,
    cycles: u64,
    time_s: f64,
    rehearsal: Option<RehearsalView>,
    monitors: Vec<LastValue>,
}

#[derive(Serialize)]
struct LastValue {
    name: String,
    unit: String,
    last: Option<f64>,
}

/// Runs the verb.
///
/// # Errors
/// Fails if the net or an argument is invalid, if the net is refused, or if it ends with a fault or an abort.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let PreparedScenario {
        config,
        plan,
        names,
        options,
    } = arguments.scenario.prepare()?;
    let mut csv = arguments.csv.as_deref().map(create).transpose()?;
    let table = csv.as_mut().map(|file| file as &mut dyn Write);
    let started = Instant::now();
    let simulated = simulate::run(&config, plan, &names, &options, table, &mut |_, _| ())
        .map_err(|error| failure(&error, &names, &config, arguments.csv.as_deref()))?;
    let took = started.elapsed();
    let report = report(&names, &simulated, &config);
    if let Some(path) = &arguments.plot {
        let panels = trace::panels(simulated.trace.columns());
        let title = report.net.clone();
        plot::write(path, &Plot { title, panels })?;
    }
    context.print(&report, human);
    if context.format == OutputFormat::Human {
        print_note(&speed(&simulated, took));
    }
    arguments
        .scenario
        .judge(EndReason::from_number(simulated.command.reason))
}

impl SimulationScenario {
    /// Judges the result by what was requested, with the exit codes of `run`.
    ///
    /// # Errors
    /// Fails if the net ended otherwise than `finished` without a requested CANCEL, or did not end and no time was
    /// given.
    pub(super) fn judge(&self, reason: EndReason) -> Result<(), Failure> {
        let asked = match self.cancel_at {
            Some(_) => RequestedEnd::Cancel,
            None => RequestedEnd::Finish,
        };
        let code = match (reason, self.limit) {
            (EndReason::None, Some(_)) => exit::OK,
            (EndReason::None, None) => {
                print_note(&format!(
                    "still running after {LIMIT:?}: set the simulated time with --for TIME"
                ));
                exit::TIMEOUT
            }
            _ => codes::outcome(asked, Some(reason.name())),
        };
        match code {
            exit::OK => Ok(()),
            code => Err(Failure::reported(code)),
        }
    }

    /// Reads the cell and the net and compiles it; prints warnings.
    ///
    /// # Errors
    /// Fails if a file cannot be read or is invalid, or if an input cannot be parsed.
    pub fn prepare(&self) -> Result<PreparedScenario, Failure> {
        let path = match &self.config {
            Some(path) => path.clone(),
            None => paths::config("cells/demo.yaml")?,
        };
        let config = load_config(&path)?;
        require_valid_settings(&config)?;
        let options = self.options(&config)?;
        let source = read_net(&self.file)?;
        let compiled = compile(&source.1, &source.0, &config).map_err(|diagnostics| {
            let what = format!("{} is invalid", source.0);
            Failure::invalid(&what, diagnostics, source.clone())
        })?;
        print_diagnostics(&draw(&compiled.warnings, Some(&source), Context::colour()));
        Ok(PreparedScenario {
            config,
            plan: compiled.plan,
            names: compiled.names,
            options,
        })
    }

    fn options(&self, config: &CellConfig) -> Result<SimulationOptions, Failure> {
        let ns = |time: Duration| time.as_nanos().try_into().unwrap_or(u64::MAX);
        let steps = self
            .input
            .iter()
            .map(|text| ScriptStep::parse(text, config));
        let steps = steps.collect::<Result<_, _>>().map_err(|error| {
            let help = "see `rcc-cli simulate --help`";
            Failure::new(codes::BAD_REQUEST, error.to_string(), help)
        })?;
        Ok(SimulationOptions {
            limit_ns: ns(self.limit.unwrap_or(LIMIT)),
            cancel_at_ns: self.cancel_at.map(ns),
            steps,
            despite_refusal: false,
        })
    }
}

pub(super) fn create(path: &Path) -> Result<BufWriter<File>, Failure> {
    let file = File::create(path).map_err(|error| not_written(path, &error))?;
    Ok(BufWriter::new(file))
}

pub(super) fn not_written(path: &Path, error: &std::io::Error) -> Failure {
    let message = format!("cannot write {}: {error}", path.display());
    Failure::new(codes::NOT_STORED, message, "name another file")
}

pub(super) fn with_names<T>(
    names: &Names,
    config: &CellConfig,
    what: impl FnOnce(&NameResolver<'_>) -> T,
) -> T {
    what(&NameResolver {
        disagreement: &|_| None,
        config,
        net: &|_| names.net.clone(),
        names: &|_| names.clone(),
        reason: &|_, _| String::new(),
    })
}

pub(super) fn failure(
    error: &SimulateError,
    net: &Names,
    config: &CellConfig,
    csv: Option<&Path>,
) -> Failure {
    match error {
        SimulateError::Refused(refusal) => {
            let refused = with_names(net, config, |names| names.refusal(1, *refusal));
            Failure::from_server(refused.body())
        }
        SimulateError::Write(error) => not_written(csv.unwrap_or(Path::new("the table")), error),
        SimulateError::Silent => Failure::new(
            codes::PROCESS_FAILED,
            error.to_string(),
            "report it as a bug",
        ),
    }
}

fn report(net: &Names, simulated: &SimulationResult, config: &CellConfig) -> SimulateReport {
    let command = &simulated.command;
    let reason = EndReason::from_number(command.reason);
    let columns = simulated.trace.columns().iter();
    let monitors = columns
        .filter(|column| column.seen)
        .map(|column| LastValue {
            name: column.name.clone(),
            unit: column.unit.clone(),
            last: column.last,
        });
    SimulateReport {
        net: net.net.clone(),
        state: CommandState::from_number(command.state).name().to_owned(),
        reason: (reason != EndReason::None).then(|| reason.name().to_owned()),
        fault: with_names(net, config, |names| names.fault(&command.fault)),
        cycles: command.cycles,
        rehearsal: simulated.rehearsed.map(|rehearsed| RehearsalView {
            // Cleared because it differs in each run.
            took_ns: 0,
            ..with_names(net, config, |names| names.rehearsal(&rehearsed))
        }),
        time_s: simulated.cycles as f64 * simulated.period_ns as f64 / 1e9,
        monitors: monitors.collect(),
    }
}

fn human(report: &SimulateReport) -> String {
    let state = match (&report.fault, &report.reason) {
        (Some(fault), _) => format!("{} (fault: {})\n{}", report.state, fault.fault, fault.words),
        (None, Some(reason)) => format!("{} ({reason})", report.state),
        (None, None) => report.state.clone(),
    };
    let cycles = table::grouped(report.cycles);
    let mut head = format!(
        "{}  after {} s, {cycles} cycles  {state}",
        report.net, report.time_s
    );
    if let Some(rehearsal) = &report.rehearsal {
        head = format!("{head}\n{}", rehearsal.words);
    }
    if report.monitors.is_empty() {
        return head;
    }
    let mut rows = table::table(&["MONITOR", "LAST", "UNIT"]);
    for row in &report.monitors {
        let last = row
            .last
            .map_or("null".to_owned(), |value| format!("{value:.6}"));
        rows.add_row([&row.name, &last, &row.unit]);
    }
    format!("{head}\n\n{}", table::text(&rows))
}

/// Describes the speed of the simulation. Printed on stderr because it differs in each run.
fn speed(simulated: &SimulationResult, took: Duration) -> String {
    let seconds = took.as_secs_f64().max(1e-9);
    let rate = simulated.cycles as f64 / seconds;
    let times = rate * simulated.period_ns as f64 / 1e9;
    format!(
        "{} cycles in {:.1} ms: {} cycles per second, {} times real time",
        table::grouped(simulated.cycles),
        1e3 * seconds,
        table::grouped(rate as u64),
        table::grouped(times as u64)
    )
}
