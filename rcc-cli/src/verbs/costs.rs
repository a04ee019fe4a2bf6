//! `costs`: shows the measured execution time of each primitive on this machine, by which nets are admitted.

use rcc_engine::costs::Costs;
use rcc_engine::costs::cache::{self, CostsSource};
use serde::Serialize;

use crate::context::Context;
use crate::failure::Failure;
use crate::table;

/// Arguments of `costs`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Measure again; executors use the new costs after their next start
    #[arg(long)]
    refresh: bool,
}

#[derive(Serialize)]
struct CostsReport {
    origin: String,
    primitives: Vec<CostRow>,
}

#[derive(Serialize)]
struct CostRow {
    #[serde(rename = "type")]
    ty: String,
    each_ns: f64,
}

/// Runs the verb.
///
/// # Errors
/// Never fails.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let (costs, origin) = cache::costs(arguments.refresh);
    let report = CostsReport {
        origin: origin_text(&origin),
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

fn rows(costs: &Costs) -> Vec<CostRow> {
    let rows = costs.kernels();
    rows.map(|(ty, each_ns)| CostRow { ty, each_ns }).collect()
}

/// Describes where the costs come from.
pub(super) fn origin_text(origin: &CostsSource) -> String {
    match origin {
        CostsSource::Read(path) => format!("measured earlier, stored in {}", path.display()),
        CostsSource::Measured(path) => format!("measured now, stored in {}", path.display()),
        CostsSource::NotKept(why) => format!("measured now, not stored: {why}"),
    }
}
