//! `wrench identify`: identifies the load of a wrist sensor from readings in several orientations; prints parameters to
//! paste. Runs on the main thread.

use std::fmt::Write;

use rcc_api::codes;
use serde::Serialize;

use crate::context::Context;
use crate::failure::Failure;
use crate::follow::read_named_text;
use crate::identify::readings::{self, ReadingSelection};
use crate::identify::{GRAVITY, Identified, identify};

/// Longest file of readings, bytes.
const READINGS_MAX: u64 = 64 << 20;

/// Arguments of `wrench`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    #[command(subcommand)]
    what: WrenchCommand,
}

#[derive(clap::Subcommand, Debug)]
enum WrenchCommand {
    /// Identify mass, centre of mass and offsets for WrenchCompensation, from readings at rest in at least six
    /// orientations
    Identify(IdentifyArguments),
}

/// Arguments of `wrench identify`.
#[derive(clap::Args, Debug)]
struct IdentifyArguments {
    /// Table of `simulate --csv` or lines of `tail --output json`, with a wrench and the sensor's pose or rotation in
    /// the base frame; - reads standard input
    file: String,
    /// Suffix of the wrench's name [default: the only value of six numbers]
    #[arg(long, value_name = "NAME")]
    wrench: Option<String>,
    /// Suffix of the pose's or rotation's name [default: the only value of seven or four numbers]
    #[arg(long, value_name = "NAME")]
    pose: Option<String>,
    /// Acceleration of a falling body in the base frame, m/s² [default: 0,0,-9.80665]
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = parse_three)]
    gravity: Option<[f64; 3]>,
}

#[derive(Serialize)]
struct WrenchReport {
    #[serde(flatten)]
    found: Identified,
    gravity: Option<[f64; 3]>,
}

fn parse_three(text: &str) -> Result<[f64; 3], String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    let numbers = numbers.map_err(|error| format!("`{text}`: {error}"))?;
    let count = numbers.len();
    numbers
        .try_into()
        .map_err(|_| format!("expected three numbers, found {count} in `{text}`: write 0,0,-9.81"))
}

/// Runs the verb.
///
/// # Errors
/// Fails if the file cannot be read, or has no readings, too few, or too similar ones.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let WrenchCommand::Identify(asked) = arguments.what;
    let text = content(&asked.file)?;
    let wanted = ReadingSelection {
        wrench: asked.wrench,
        pose: asked.pose,
    };
    let refused = |what: String, help: &str| {
        Failure::new(codes::BAD_REQUEST, format!("{}: {what}", asked.file), help)
    };
    let readings = readings::read(&text, &wanted).map_err(|error| {
        refused(
            error.to_string(),
            "select them with --wrench and --pose; see docs/force.md",
        )
    })?;
    let gravity = asked.gravity.unwrap_or([0.0, 0.0, -GRAVITY]);
    let found = identify(&readings, gravity)
        .map_err(|error| refused(error.to_string(), "see docs/force.md"))?;
    let report = WrenchReport {
        found,
        gravity: asked.gravity,
    };
    context.print(&report, human);
    Ok(())
}

fn content(file: &str) -> Result<String, Failure> {
    read_named_text(file, READINGS_MAX).map_err(|error| Failure::unreadable(file, &error))
}

/// Formats a primitive to paste; comments state the quality of the fit.
fn human(report: &WrenchReport) -> String {
    let WrenchReport { found, gravity } = report;
    let list = |values: &[f64; 3]| format!("[{}]", values.map(rounded).join(", "));
    let [force, torque] = found.residual;
    let [force_max, torque_max] = found.residual_max;
    let [mass, centre] = found.deviation;
    let mut text = String::from("compensated:\n  type: WrenchCompensation\n  parameters:\n");
    // Writing to a String cannot fail.
    let mut line = |row: String| _ = writeln!(text, "{row}");
    line(format!("    mass: {} kg", rounded(found.mass)));
    line(format!("    centre: {}  # m", list(&found.centre)));
    line(format!(
        "    force_offset: {}  # N",
        list(&found.force_offset)
    ));
    line(format!(
        "    torque_offset: {}  # N·m",
        list(&found.torque_offset)
    ));
    if let Some(gravity) = gravity {
        line(format!("    gravity: {}  # m/s²", list(gravity)));
    }
    line(format!(
        "# {} readings, {} orientations, spread {:.2} (at best 0.82), condition {:.1}",
        found.readings, found.orientations, found.spread, found.condition
    ));
    line(format!(
        "# residual: force {force:.2e} N (at most {force_max:.2e}), torque {torque:.2e} N·m (at most {torque_max:.2e})"
    ));
    line(format!(
        "# standard deviation: mass {mass:.2e} kg, centre {centre:.2e} m"
    ));
    text.trim_end().to_owned()
}

/// Rounds to 1e-9, which is finer than any measurement.
fn rounded(value: f64) -> String {
    let rounded = (value * 1e9).round() / 1e9;
    // Adding 0.0 turns -0.0 into 0.0.
    format!("{:?}", rounded + 0.0)
}
