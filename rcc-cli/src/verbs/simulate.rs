//! `simulate NET`: runs a net, or a task of nets and rules, in virtual time against simple device models, without a cell;
//! results as table, CSV and SVG.

use std::io::Write;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use rcc_api::bodies::{FaultView, RehearsalView};
use rcc_api::codes;
use rcc_config::CellConfig;
use rcc_core::message::{CommandState, EndReason};
use rcc_language::names::Names;
use rcc_protocol::ending::ending;
use serde::Serialize;

use crate::context::{Context, OutputFormat};
use crate::failure::Failure;
use crate::output::print_note;
use crate::plot::Plot;
use crate::result_file::{WrittenFile, create, write_plot};
use crate::scenario::{PreparedScenario, SimulationScenario, failure, with_names};
use crate::simulate::trace;
use crate::simulate::{self, SimulationResult};
use crate::table;
use crate::task::TaskFile;

mod task;

/// Arguments of `simulate`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    #[command(flatten)]
    scenario: SimulationScenario,
    /// Write monitored values to this file, one line per cycle in which one is due
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Plot monitored values to this file: .svg, .html (values under the pointer, zoom) or .png
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
}

#[derive(Serialize)]
struct SimulateReport {
    net: String,
    state: String,
    reason: Option<String>,
    outcome: Option<String>,
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
    if TaskFile::is_one(&arguments.scenario.file)? {
        if let Some(path) = arguments.csv.as_ref().or(arguments.plot.as_ref()) {
            return Err(Failure::new(
                codes::BAD_REQUEST,
                format!(
                    "a task has no monitored values to write to {}",
                    path.display()
                ),
                "omit --csv and --plot, or simulate one of its nets",
            ));
        }
        return task::run(context, &arguments.scenario);
    }
    let PreparedScenario {
        config,
        plan,
        names,
        options,
    } = arguments.scenario.prepare()?;
    let mut csv = arguments.csv.as_deref().map(create).transpose()?;
    let table = csv.as_mut().map(|file| file as &mut dyn Write);
    let started = Instant::now();
    let simulated = simulate::run(&config, plan, &names, &options, table, &mut |_, _, _| ())
        .map_err(|error| failure(&error, &names, &config, arguments.csv.as_deref()))?;
    let took = started.elapsed();
    let report = report(&names, &simulated, &config);
    if let Some(path) = &arguments.plot {
        let panels = trace::panels(simulated.trace.columns());
        let title = report.net.clone();
        write_plot(path, &Plot { title, panels })?;
    }
    context.print(&report, human);
    if context.format == OutputFormat::Human {
        print_note(&speed(&simulated, took));
        for path in [&arguments.csv, &arguments.plot].into_iter().flatten() {
            print_note(&WrittenFile::of(path)?.describe());
        }
    }
    arguments
        .scenario
        .judge(EndReason::from_number(simulated.command.reason))
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
        outcome: net.outcome(command.outcome).map(str::to_owned),
        fault: with_names(net, config, |names| names.fault(&command.fault)),
        cycles: command.cycles,
        rehearsal: simulated.rehearsed.map(|rehearsed| RehearsalView {
            // Cleared because it differs in each run.
            took_ns: 0,
            ..with_names(net, config, |names| names.rehearsal(&rehearsed, net))
        }),
        time_s: simulated.cycles as f64 * simulated.period_ns as f64 / 1e9,
        monitors: monitors.collect(),
    }
}

fn human(report: &SimulateReport) -> String {
    let state = match (&report.fault, &report.reason) {
        (Some(fault), _) => format!("{} (fault: {})\n{}", report.state, fault.fault, fault.words),
        (None, Some(reason)) => {
            let ending = ending(reason, report.outcome.as_deref(), report.cycles);
            format!("{} ({ending})", report.state)
        }
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
