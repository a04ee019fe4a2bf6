//! `import FILE.mcap`: reads a recording again, as a table or as curves. Needs only the file, which may have been written by
//! `record` or by `replay --mcap`. `import trajectory` makes a net from a trajectory.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};

use rcc_api::codes;
use rcc_protocol::pattern::Pattern;
use rcc_recording::read::{ReadEnd, ReadError, ReadTable, read};
use serde::Serialize;

use crate::context::Context;
use crate::csv;
use crate::failure::Failure;
use crate::output::print_note;
use crate::plot::{Plot, PlotCurve};
use crate::result_file::{WrittenFile, create, not_written, write_plot};
use crate::simulate::trace::{BucketedSeries, panel_of, segments};
use crate::table::{self, grouped};

mod trajectory;

/// Arguments of `import`.
#[derive(clap::Args, Debug)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct Arguments {
    #[command(subcommand)]
    what: Option<ImportCommand>,
    /// Recording (MCAP)
    #[arg(required = true)]
    file: Option<PathBuf>,
    /// Only these values: net/primitive.port or device/value, with * and ? as wildcards [default: all]
    #[arg(long, value_name = "PATTERN")]
    show: Vec<Pattern>,
    /// Write the values to this CSV file, one line for each message
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Plot the values to this file, .svg, .html (with values and zoom) or .png
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
}

#[derive(clap::Subcommand, Debug)]
enum ImportCommand {
    /// Make a net from a trajectory_msgs/JointTrajectory of ROS (YAML or JSON)
    Trajectory(trajectory::Arguments),
}

/// One table of the file.
#[derive(Clone, Debug, Serialize)]
struct ImportedTable {
    topic: String,
    name: String,
    values: usize,
    messages: u64,
    first_s: f64,
    last_s: f64,
}

/// The columns of the result that a table of the file has.
#[derive(Clone, Debug, Default)]
struct TablePlaces {
    /// Element in the table, and column of the result.
    elements: Vec<(usize, usize)>,
}

/// Runs the verb.
///
/// # Errors
/// Fails if the file is not a recording, if no value matches, or if a result cannot be written; as
/// [`trajectory::run`] for a trajectory.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    if let Some(ImportCommand::Trajectory(arguments)) = arguments.what {
        return trajectory::run(context, &arguments);
    }
    // clap requires the file unless there is a subcommand.
    let file = arguments.file.unwrap_or_default();
    let contents = Contents::of(&file, &arguments.show)?;
    if let Some(path) = &arguments.csv {
        contents.write_csv(&file, path)?;
        print_note(&WrittenFile::of(path)?.describe());
    }
    if let Some(path) = &arguments.plot {
        contents.plot(&file, path)?;
        print_note(&WrittenFile::of(path)?.describe());
    }
    context.print(&contents.rows, |rows| {
        let mut lines = table::table(&["TOPIC", "VALUES", "MESSAGES", "FROM", "TO"]);
        for row in rows {
            lines.add_row([
                row.topic.replace(char::is_control, " "),
                grouped(row.values as u64),
                grouped(row.messages),
                format!("{:.3} s", row.first_s),
                format!("{:.3} s", row.last_s),
            ]);
        }
        table::text(&lines)
    });
    Ok(())
}

/// Plots a recording, as `plot FILE.mcap` does.
///
/// # Errors
/// Fails if the file is not a recording, or if the plot cannot be written.
pub fn plot_recording(file: &Path, out: &Path) -> Result<(), Failure> {
    Contents::of(file, &[])?.plot(file, out)?;
    print_note(&WrittenFile::of(out)?.describe());
    Ok(())
}

/// Tables of a recording.
struct Contents {
    rows: Vec<ImportedTable>,
    /// Names and units of the columns of the result.
    columns: Vec<(String, String)>,
    places: Vec<TablePlaces>,
    first_ns: u64,
}

impl Contents {
    /// Reads the file once.
    fn of(path: &Path, show: &[Pattern]) -> Result<Contents, Failure> {
        let mut contents = Contents {
            rows: Vec::new(),
            columns: Vec::new(),
            places: Vec::new(),
            first_ns: u64::MAX,
        };
        let mut spans: Vec<[u64; 2]> = Vec::new();
        let end = read(path, |table, index, time_ns, _| {
            if index == contents.rows.len() {
                contents.add(table, show);
                spans.push([time_ns, time_ns]);
            }
            contents.first_ns = contents.first_ns.min(time_ns);
            let (Some(row), Some([first, last])) =
                (contents.rows.get_mut(index), spans.get_mut(index))
            else {
                return;
            };
            row.messages += 1;
            (*first, *last) = ((*first).min(time_ns), (*last).max(time_ns));
        });
        if end.map_err(|error| unusable(path, &error))? == ReadEnd::Torn {
            print_note(&format!(
                "{}: the end is missing, as after the death of its recorder; everything before was read",
                path.display()
            ));
        }
        let seconds = |time_ns: u64| time_ns.saturating_sub(contents.first_ns) as f64 * 1e-9;
        for (row, [first, last]) in contents.rows.iter_mut().zip(spans) {
            (row.first_s, row.last_s) = (seconds(first), seconds(last));
        }
        if contents.columns.is_empty() {
            return Err(Failure::new(
                codes::BAD_REQUEST,
                format!("{}: no value of a net or device matches", path.display()),
                "`rcc-cli import FILE` lists what the file has; write net/primitive.port, with * and ? as wildcards",
            ));
        }
        Ok(contents)
    }

    fn add(&mut self, table: &ReadTable, show: &[Pattern]) {
        let mut places = TablePlaces::default();
        let mut element = 0;
        let names = table.elements();
        for column in &table.columns {
            let full = format!("{}/{}", table.name, column.name);
            for number in 0..column.width {
                let here = element;
                element += 1;
                let wanted = |one: &Pattern| {
                    one.matches(&full) && one.element.is_none_or(|only| only == number)
                };
                if !show.is_empty() && !show.iter().any(wanted) {
                    continue;
                }
                let name = names.get(here).cloned().unwrap_or_default();
                let known = self.columns.iter().position(|(other, _)| *other == name);
                let place = known.unwrap_or_else(|| {
                    let unit = column.unit.clone().unwrap_or_default();
                    self.columns.push((name, unit));
                    self.columns.len() - 1
                });
                places.elements.push((here, place));
            }
        }
        self.rows.push(ImportedTable {
            topic: table.topic.clone(),
            name: table.name.clone(),
            values: element,
            messages: 0,
            first_s: 0.0,
            last_s: 0.0,
        });
        self.places.push(places);
    }

    fn seconds(&self, time_ns: u64) -> f64 {
        time_ns.saturating_sub(self.first_ns) as f64 * 1e-9
    }

    /// Writes one line for each message; what it does not have is empty, like null.
    fn write_csv(&self, file: &Path, path: &Path) -> Result<(), Failure> {
        let mut out = create(path)?;
        let heads = ["cycle", "time_s"].map(str::to_owned);
        let names = self.columns.iter().map(|(name, _)| name.clone());
        let heads: Vec<String> = heads.into_iter().chain(names).collect();
        let mut result = writeln!(out, "{}", csv::line(&heads));
        let mut cells = vec![String::new(); self.columns.len()];
        let end = read(file, |_, index, time_ns, row| {
            let Some(places) = self
                .places
                .get(index)
                .filter(|one| !one.elements.is_empty())
            else {
                return;
            };
            cells.iter_mut().for_each(String::clear);
            for (element, place) in &places.elements {
                let value = row.values.get(*element).filter(|value| !value.is_nan());
                if let (Some(cell), Some(value)) = (cells.get_mut(*place), value) {
                    *cell = value.to_string();
                }
            }
            if result.is_ok() {
                let (cycle, seconds) = (row.key.cycle, self.seconds(time_ns));
                result = writeln!(out, "{cycle},{seconds:.6},{}", cells.join(","));
            }
        });
        end.map_err(|error| unusable(file, &error))?;
        result
            .and_then(|()| out.flush())
            .map_err(|error| not_written(path, &error))
    }

    /// Draws one panel per unit.
    fn plot(&self, file: &Path, path: &Path) -> Result<(), Failure> {
        let mut series = vec![BucketedSeries::default(); self.columns.len()];
        let end = read(file, |_, index, time_ns, row| {
            let Some(places) = self.places.get(index) else {
                return;
            };
            let seconds = self.seconds(time_ns);
            for (element, place) in &places.elements {
                let value = row.values.get(*element).filter(|value| !value.is_nan());
                if let Some(series) = series.get_mut(*place) {
                    series.push(seconds, value.copied());
                }
            }
        });
        end.map_err(|error| unusable(file, &error))?;
        let mut panels = BTreeMap::new();
        for ((name, unit), series) in self.columns.iter().zip(&series) {
            let unit = if unit.is_empty() { "1" } else { unit };
            let panel = panels
                .entry(unit.to_owned())
                .or_insert_with(|| panel_of(unit));
            panel.curves.push(PlotCurve {
                name: name.clone(),
                segments: segments(series.buckets()),
                colour: panel.curves.len(),
            });
        }
        let title = file.file_name().unwrap_or_default().to_string_lossy();
        let plot = Plot {
            title: title.into_owned(),
            panels: panels.into_values().collect(),
        };
        write_plot(path, &plot)
    }
}

fn unusable(path: &Path, error: &ReadError) -> Failure {
    match error {
        ReadError::Io(error) => Failure::unreadable(&path.display().to_string(), error),
        other => Failure::new(
            codes::BAD_REQUEST,
            format!("{}: {other}", path.display()),
            "`rcc-cli record` and `rcc-cli replay --mcap` write recordings",
        ),
    }
}
