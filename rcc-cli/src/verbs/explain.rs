//! `explain NET`: what a net is expected to need of a cycle, by type of primitive, and whether the cell has room for it.
//! A file is compiled here, without a cell; a loaded net is asked for by name.

use std::path::{Path, PathBuf};

use rcc_config::CellConfig;
use rcc_engine::costs::cache;
use rcc_loader::server::api::{CommandView, StatusView};
use rcc_loader::server::codes::exit;
use rcc_loader::server::compile::{Compiled, compile};
use serde::Serialize;

use super::check::load_config;
use super::costs;
use crate::client::Client;
use crate::context::Context;
use crate::failure::{Failure, draw};
use crate::follow;
use crate::supervisor::places;
use crate::table::{self, time};

/// What to explain.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// A file (YAML or JSON; - is the standard input), or a loaded net by name or id.
    net: String,
    /// The cell's configuration whose devices the net uses (default: the running cell's, else the demo cell's).
    #[arg(long)]
    config: Option<PathBuf>,
}

/// What a net is expected to need.
#[derive(Clone, Debug, Serialize)]
struct Explanation {
    net: String,
    primitives: u32,
    expected_ns: u64,
    period_ns: u64,
    every: u32,
    costs: String,
    types: Vec<Row>,
    cell: Option<Room>,
}

#[derive(Clone, Debug, Serialize)]
struct Row {
    #[serde(rename = "type")]
    ty: &'static str,
    count: u64,
    all_ns: f64,
}

/// What the running cell has left.
#[derive(Clone, Debug, Serialize)]
struct Room {
    cell: String,
    budget_ns: u64,
    committed_ns: u64,
    left_ns: u64,
    dearest: Option<String>,
    dearest_ns: u64,
}

/// Does it.
///
/// # Errors
/// The file is not there or not valid, or there is no such net.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let is_file = arguments.net == "-" || Path::new(&arguments.net).exists();
    // Without a cell a file can be explained all the same.
    let client = context.client();
    let cell = client.as_ref().ok().and_then(|client| room(client).ok());
    let source = if is_file {
        follow::read_text(&arguments.net)?
    } else {
        let client = client.as_ref().map_err(Clone::clone)?;
        (arguments.net.clone(), follow::state(client, &arguments.net)?.text)
    };
    let config = match (arguments.config, &cell) {
        (Some(path), _) => path,
        (None, Some((path, _))) => path.clone(),
        (None, None) => places::config("cells/demo.yaml")?,
    };
    let config = load_config(&config)?;
    let compiled = compile(&source.1, &source.0, &config).map_err(|diagnostics| {
        eprint!("{}", draw(&diagnostics, Some(&source), Context::colour()));
        Failure::said(exit::INVALID)
    })?;
    let explanation = explain(&compiled, &config, cell.map(|(_, room)| room));
    context.print(&explanation, human);
    Ok(())
}

fn explain(compiled: &Compiled, config: &CellConfig, cell: Option<Room>) -> Explanation {
    let (costs, origin) = cache::costs(false);
    let plan = compiled.plan.plan();
    let types = costs.shares(&plan).into_iter().map(|share| Row {
        ty: share.name,
        count: share.count,
        all_ns: share.ns,
    });
    Explanation {
        net: compiled.net.clone(),
        primitives: compiled.primitives,
        expected_ns: costs.expected_ns(&plan),
        period_ns: config.period_ns,
        every: plan.rate.every,
        costs: costs::words(&origin),
        types: types.collect(),
        cell,
    }
}

/// The cell's configuration, and what it has left.
fn room(client: &Client) -> Result<(PathBuf, Room), Failure> {
    let status: StatusView = client.get("/status")?;
    let commands: Vec<CommandView> = client.get("/commands")?;
    let active = |command: &&CommandView| matches!(command.state.as_str(), "running" | "canceling");
    let dearest = commands
        .iter()
        .filter(active)
        .max_by_key(|command| command.expected_ns);
    let executor = &status.executor;
    let room = Room {
        cell: status.cell,
        budget_ns: executor.budget_ns,
        committed_ns: executor.committed_ns,
        left_ns: executor.budget_ns.saturating_sub(executor.committed_ns),
        dearest: dearest.map(follow::title),
        dearest_ns: dearest.map_or(0, |command| command.expected_ns),
    };
    Ok((PathBuf::from(status.config), room))
}

fn human(explanation: &Explanation) -> String {
    let percent = |ns: f64, of: u64| format!("{:.1} %", ns * 100.0 / (of.max(1) as f64));
    let every = match explanation.every {
        0 | 1 => "every cycle".to_owned(),
        every => format!("every {every} cycles"),
    };
    let mut rows = table::table(&["TYPE", "COUNT", "EACH", "TOGETHER", "SHARE"]);
    for row in &explanation.types {
        rows.add_row([
            row.ty.to_owned(),
            table::grouped(row.count),
            format!("{:.1} ns", row.all_ns / (row.count.max(1) as f64)),
            format!("{:.1} ns", row.all_ns),
            percent(row.all_ns, explanation.expected_ns),
        ]);
    }
    format!(
        "{}: {} primitives, expected to need {} {every}, {} of the period of {}\ncosts {}\n\n{}{}",
        explanation.net,
        explanation.primitives,
        time(explanation.expected_ns),
        percent(explanation.expected_ns as f64, explanation.period_ns),
        time(explanation.period_ns),
        explanation.costs,
        table::text(&rows),
        explanation.cell.as_ref().map_or_else(String::new, left)
    )
}

fn left(room: &Room) -> String {
    let dearest = room.dearest.as_ref().map_or_else(
        || "no net runs".to_owned(),
        |net| format!("the dearest that runs is {net} ({})", time(room.dearest_ns)),
    );
    format!(
        "\n\ncell {}: nets may need {} of a cycle together, {} are in use, {} are left; {dearest}",
        room.cell,
        time(room.budget_ns),
        time(room.committed_ns),
        time(room.left_ns)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_explanation_tells_shares_and_what_is_left() {
        let explanation = Explanation {
            net: "line".into(),
            primitives: 3,
            expected_ns: 2_000,
            period_ns: 1_000_000,
            every: 1,
            costs: "measured now".into(),
            types: vec![Row {
                ty: "LinearMotion",
                count: 2,
                all_ns: 1_500.0,
            }],
            cell: Some(Room {
                cell: "demo".into(),
                budget_ns: 500_000,
                committed_ns: 100_000,
                left_ns: 400_000,
                dearest: Some("other#1".into()),
                dearest_ns: 100_000,
            }),
        };
        let text = human(&explanation);
        for part in [
            "line: 3 primitives, expected to need 2.0 µs every cycle, 0.2 % of the period of 1.0 ms",
            "LinearMotion  2      750.0 ns  1500.0 ns  75.0 %",
            "400.0 µs are left; the dearest that runs is other#1 (100.0 µs)",
        ] {
            assert!(text.contains(part), "{part}\n{text}");
        }
    }
}
