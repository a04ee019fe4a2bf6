//! `explain NET`: what a net needs of a cycle, in which order it runs, where its values lie, what can be null and why, and
//! whether the cell has room for it. A file is compiled here, without a cell; a loaded net is asked for by name.

mod report;
mod text;

use std::path::PathBuf;

use rcc_engine::costs::cache;
use rcc_loader::server::api::{CommandView, StatusView};

use self::report::{Explanation, CellCapacity};
use super::{costs, source};
use crate::client::Client;
use crate::context::Context;
use crate::failure::Failure;
use crate::follow;

/// What to explain.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// A file (YAML or JSON; - is the standard input), or a loaded net by name or id.
    net: String,
    /// The cell's configuration whose devices the net uses (default: the running cell's, else the demo cell's).
    #[arg(long)]
    config: Option<PathBuf>,
    #[command(flatten)]
    shown: TableSelection,
}

/// Which tables are printed; without any of it as many as a small net needs.
#[derive(clap::Args, Clone, Copy, Debug, Default)]
pub struct TableSelection {
    /// Every primitive in the order of evaluation: run, time, outputs, what can be null.
    #[arg(long)]
    order: bool,
    /// Every value that can be null, and why.
    #[arg(long)]
    nulls: bool,
    /// The longest way from a source to a result, in time.
    #[arg(long)]
    path: bool,
    /// Everything.
    #[arg(long)]
    all: bool,
}

/// Does it.
///
/// # Errors
/// The file is not there or not valid, or there is no such net.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let found = source::find(context, &arguments.net, arguments.config)?;
    let room = found.client.as_ref().and_then(|client| room(client).ok());
    let (costs, origin) = cache::costs(false);
    let explanation = Explanation::of(&found, &costs, costs::origin_text(&origin), room);
    context.print(&explanation, |explanation| {
        text::human(explanation, arguments.shown)
    });
    Ok(())
}

/// What the running cell has left.
fn room(client: &Client) -> Result<CellCapacity, Failure> {
    let status: StatusView = client.get("/status")?;
    let commands: Vec<CommandView> = client.get("/commands")?;
    let active = |command: &&CommandView| matches!(command.state.as_str(), "running" | "canceling");
    let dearest = commands
        .iter()
        .filter(active)
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
