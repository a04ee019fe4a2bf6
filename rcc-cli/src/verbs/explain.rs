//! `explain NET`: shows a net's time budget, order of evaluation, memory layout, which values can be null and why, and
//! whether the cell has capacity for it. A file is compiled locally, without a cell; a loaded net is fetched by name.

mod report;
mod text;

use std::path::PathBuf;

use rcc_api::bodies::{CommandView, StatusView};
use rcc_engine::costs::cache;

use self::report::{CellCapacity, Explanation};
use super::costs;
use crate::client::LoaderClient;
use crate::context::Context;
use crate::failure::Failure;
use crate::follow;
use crate::net_source;
use crate::table;
use crate::task::{TaskFile, analysis};

/// Arguments of `explain`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// File (YAML or JSON; - reads standard input), or loaded net by name or id
    net: String,
    /// Cell configuration whose devices the net uses [default: the running cell's, else the demo cell's]
    #[arg(long)]
    config: Option<PathBuf>,
    #[command(flatten)]
    shown: TableSelection,
}

/// Selects the printed tables; without any option, as many as suit the size of the net.
#[derive(clap::Args, Clone, Copy, Debug, Default)]
pub struct TableSelection {
    /// Show every primitive in order of evaluation: run, time, outputs, null
    #[arg(long)]
    order: bool,
    /// Show every value that can be null, and why
    #[arg(long)]
    nulls: bool,
    /// Show the critical path: the longest chain of primitives in time
    #[arg(long)]
    path: bool,
    /// Show all tables
    #[arg(long)]
    all: bool,
}

/// Runs the verb.
///
/// # Errors
/// Fails if the file does not exist or is invalid, or if the net does not exist.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    if net_source::is_file(&arguments.net) && TaskFile::is_one(&arguments.net)? {
        return task(context, &arguments.net);
    }
    let found = net_source::find(context, &arguments.net, arguments.config)?;
    let room = match &found.client {
        Some(client) if context.remote.is_some() => Some(room(client)?),
        client => client.as_ref().and_then(|client| room(client).ok()),
    };
    let (costs, origin) = cache::costs(false);
    let explanation = Explanation::of(&found, &costs, costs::origin_text(&origin), room);
    context.print(&explanation, |explanation| {
        text::human(explanation, arguments.shown)
    });
    Ok(())
}

/// Explains the rules of a task: what starts each net, and which rule can fire when.
fn task(context: &Context, path: &str) -> Result<(), Failure> {
    let task = TaskFile::read(path)?;
    let explanation = analysis::explain(&task, &task.net_names()?);
    context.print(&explanation, |said| {
        let mut nets = table::table(&["NET", ""]);
        for (net, by) in &said.nets {
            nets.add_row([net.clone(), by.clone()]);
        }
        let mut rules = table::table(&["RULE", "WHEN", "CAN FIRE", "THEN", "NOTE"]);
        for rule in &said.rules {
            rules.add_row([
                rule.rule.clone(),
                rule.when.clone(),
                rule.fires.clone(),
                rule.then.clone(),
                rule.notes.join("\n"),
            ]);
        }
        let head = format!("{}: {}", said.task, said.description);
        format!("{head}\n{}\n{}", table::text(&nets), table::text(&rules))
    });
    Ok(())
}

/// Returns the free capacity of the running cell.
fn room(client: &LoaderClient) -> Result<CellCapacity, Failure> {
    let status: StatusView = client.get("/status")?;
    let commands: Vec<CommandView> = client.get("/commands")?;
    let dearest = commands
        .iter()
        .filter(|command| command.is_active())
        .max_by_key(|command| command.expected_ns);
    let executor = &status.executor;
    Ok(CellCapacity {
        cell: status.cell,
        budget_ns: executor.budget_ns,
        committed_ns: executor.committed_ns,
        left_ns: executor.budget_ns.saturating_sub(executor.committed_ns),
        dearest: dearest.map(follow::title),
        dearest_ns: dearest.map_or(0, |command| command.expected_ns),
    })
}
