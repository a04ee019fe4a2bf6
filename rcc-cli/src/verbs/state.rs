//! `state [NAME]`: everything about one net, or the states of all.

use rcc_loader::server::api::{CommandDetail, CommandView};

use super::ls;
use crate::context::Context;
use crate::failure::{Failure, draw};
use crate::follow;
use crate::table::{grouped, time};

/// Which net.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Id, name of the net, or name#id; all nets without.
    name: Option<String>,
}

/// Does it.
///
/// # Errors
/// Not reachable, or no such net.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let client = context.client()?;
    match arguments.name {
        None => {
            let commands: Vec<CommandView> = client.get("/commands")?;
            context.print(&commands, |commands| ls::list(commands));
        }
        Some(name) => {
            let detail = follow::state(&client, &name)?;
            context.print(&detail, human);
        }
    }
    Ok(())
}

fn human(detail: &CommandDetail) -> String {
    let command = &detail.command;
    let mut lines = vec![format!(
        "{}  {}",
        follow::title(command),
        follow::state_words(command)
    )];
    let mut add = |head: &str, text: String| {
        if !text.is_empty() {
            lines.push(format!("  {head:<12} {text}"));
        }
    };
    add("description", command.description.clone());
    let fault = command.fault.as_ref();
    add("fault", fault.map_or_else(String::new, |fault| fault.words.clone()));
    add("uses", command.uses.join(", "));
    add("cancel", if command.can_cancel { "possible" } else { "not possible, only abort" }.into());
    if command.started_cycle > 0 {
        let first = grouped(command.started_cycle);
        let span = match command.ended_cycle {
            0 => format!("since executor cycle {first}"),
            last => format!("executor cycles {first} to {}", grouped(last)),
        };
        add("cycles", format!("{} ({span})", grouped(command.cycles)));
        let (last, max) = (time(command.exec_last_ns), time(command.exec_max_ns));
        add("execution", format!("last {last}, longest {max}"));
    }
    let mut text = lines.join("\n");
    let drawn = draw(&command.diagnostics, None, false);
    if !drawn.is_empty() {
        text.push('\n');
        text.push_str(&drawn);
    }
    text
}
