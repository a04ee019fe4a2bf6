//! `costs`: what one primitive of each kind costs on this machine; what nets are admitted by.

use rcc_engine::costs::Costs;
use rcc_engine::costs::cache::{self, Origin};
use serde::Serialize;

use crate::context::Context;
use crate::failure::Failure;
use crate::table;

/// Whether to measure.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Measure again; an executor takes it in when it starts.
    #[arg(long)]
    refresh: bool,
}

#[derive(Serialize)]
struct Report {
    origin: String,
    primitives: Vec<Row>,
}

#[derive(Serialize)]
struct Row {
    #[serde(rename = "type")]
    ty: String,
    each_ns: f64,
}

/// Does it.
///
/// # Errors
/// None.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let (costs, origin) = cache::costs(arguments.refresh);
    let report = Report {
        origin: words(&origin),
        primitives: rows(&costs),
    };
    context.print(&report, |report| {
        let mut rows = table::table(&["PRIMITIVE", "EACH"]);
        for row in &report.primitives {
            rows.add_row([row.ty.clone(), format!("{:.1} ns", row.each_ns)]);
        }
        format!("{}\n\n{}", report.origin, table::text(&rows))
    });
    Ok(())
}

fn rows(costs: &Costs) -> Vec<Row> {
    let rows = costs.kernels();
    rows.map(|(ty, each_ns)| Row { ty, each_ns }).collect()
}

/// Where costs come from, as a sentence.
pub(super) fn words(origin: &Origin) -> String {
    match origin {
        Origin::Read(path) => format!("measured before, kept in {}", path.display()),
        Origin::Measured(path) => format!("measured now, kept in {}", path.display()),
        Origin::NotKept(why) => format!("measured now and not kept: {why}"),
    }
}
