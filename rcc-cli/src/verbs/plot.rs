//! `plot FILE.mcap` plots a recording. `plot NET`: plots what the arms of a net would do in virtual time: the path of the flange, and positions,
//! velocities, accelerations and jerks of the joints relative to their limits.

use std::path::PathBuf;

use rcc_api::codes::{self, exit};
use rcc_core::message::EndReason;
use rcc_engine::engine::Engine;
use rcc_protocol::control::Refusal;
use serde::Serialize;

use crate::context::Context;
use crate::failure::Failure;
use crate::plot::Plot;
use crate::result_file::write_plot;
use crate::scenario::{PreparedScenario, SimulationScenario, failure, with_names};
use crate::simulate::device::SimulatedDevice;
use crate::simulate::tracks::ArmTracks;
use crate::simulate::{self, SimulationOptions};
use crate::verbs::import;

/// Arguments of `plot`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    #[command(flatten)]
    scenario: SimulationScenario,
    /// Write to this file, .svg, .html (with values and zoom) or .png, and say so [default: the net's name with .svg]
    #[arg(short, long, value_name = "FILE")]
    out: Option<PathBuf>,
}

#[derive(Serialize)]
struct PlotReport {
    net: String,
    file: String,
    time_s: f64,
    /// Description of the limit that the net would break.
    breaks: Option<String>,
}

/// Runs the verb.
///
/// # Errors
/// Fails if the net is invalid or refused, commands no arm, or if the plot cannot be written. A net that breaks a limit
/// or ends with a fault is plotted, and then fails.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    if arguments.scenario.file.ends_with(".mcap") {
        return plot_recording(&arguments);
    }
    let PreparedScenario {
        config,
        plan,
        names,
        options,
    } = arguments.scenario.prepare()?;
    let out = arguments
        .out
        .unwrap_or_else(|| PathBuf::from(format!("{}.svg", names.net)));
    let options = SimulationOptions {
        despite_refusal: true,
        ..options
    };
    let mut tracks = ArmTracks::new(&config);
    let mut watch = |time_s: f64, engine: &Engine, devices: &[SimulatedDevice]| {
        tracks.record(time_s, engine, devices);
    };
    let simulated = simulate::run(&config, plan, &names, &options, None, &mut watch)
        .map_err(|error| failure(&error, &names, &config, None))?;
    let cancel_s = options.cancel_at_ns.map(|ns| ns as f64 / 1e9);
    let panels = tracks.panels(&cancel_s.into_iter().collect::<Vec<_>>());
    if panels.is_empty() {
        let message = format!("{} commands no arm", names.net);
        let help = "`rcc-cli simulate NET --plot FILE.svg` draws what its monitors show";
        return Err(Failure::new(codes::BAD_REQUEST, message, help));
    }
    let title = match cancel_s {
        Some(cancel_s) => format!("{}, CANCEL after {cancel_s} s", names.net),
        None => names.net.clone(),
    };
    write_plot(&out, &Plot { title, panels })?;
    let error = |refusal: Refusal| with_names(&names, &config, |namer| namer.refusal(1, refusal));
    let fault = with_names(&names, &config, |namer| {
        namer.fault(&simulated.command.fault)
    });
    let breaks = simulated.foreseen.map(|refusal| error(refusal).message);
    let report = PlotReport {
        net: names.net.clone(),
        file: out.display().to_string(),
        time_s: simulated.cycles as f64 * simulated.period_ns as f64 / 1e9,
        breaks: breaks.or_else(|| fault.map(|fault| fault.words)),
    };
    context.print(&report, |report: &PlotReport| {
        let mut lines = format!(
            "wrote {}: {} s of {}",
            report.file, report.time_s, report.net
        );
        if let Some(breaks) = &report.breaks {
            lines = format!("{lines}\n{breaks}");
        }
        lines
    });
    let is_fault = EndReason::from_number(simulated.command.reason) == EndReason::Fault;
    match report.breaks {
        Some(_) => Err(Failure::reported(exit::FAILED)),
        None if is_fault => Err(Failure::reported(exit::FAILED)),
        None => Ok(()),
    }
}

/// Plots a recording; options of a simulation are refused.
fn plot_recording(arguments: &Arguments) -> Result<(), Failure> {
    if arguments.scenario.has_options() {
        let message = "the options of a simulation do not apply to a recording";
        let help = "`rcc-cli import FILE.mcap --show PATTERN --plot FILE.svg` selects values";
        return Err(Failure::new(codes::BAD_REQUEST, message, help));
    }
    let file = PathBuf::from(&arguments.scenario.file);
    let out = arguments.out.clone();
    import::plot_recording(&file, &out.unwrap_or_else(|| file.with_extension("svg")))
}
