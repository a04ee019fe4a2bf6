//! `state [NAME]`: shows everything about one net, or the states of all.

use rcc_api::bodies::{CommandDetail, CommandView, ValuesView};
use rcc_config::diagnostic::DrawingStyle;

use super::ls;
use crate::context::Context;
use crate::failure::{Failure, draw};
use crate::follow;
use crate::table::{grouped, time};
use crate::value::{self, Style};
use rcc_terminal::text::TerminalSize;

/// Arguments of `state`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Net: id, name, or name#id; without it all nets are listed
    name: Option<String>,
    /// Show the values of its outputs, all of one cycle
    #[arg(long, requires = "name")]
    values: bool,
    /// Show the values of these ports, separated by commas: move.pose,ik.*,a.out[2]
    #[arg(long, requires = "name", value_name = "PATTERN", value_delimiter = ',')]
    ports: Vec<String>,
    /// Show angles in degrees
    #[arg(long, requires = "name")]
    deg: bool,
}

/// Runs the verb.
///
/// # Errors
/// Fails if the loader cannot be reached or the net does not exist.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let client = context.client()?;
    match arguments.name {
        None => {
            let commands: Vec<CommandView> = client.get("/commands")?;
            context.print(&commands, |commands| ls::list(commands));
        }
        Some(name) if arguments.values || !arguments.ports.is_empty() => {
            let values = client.values(&name, &arguments.ports)?;
            let style = Style {
                degrees: arguments.deg,
            };
            context.print(&values, |values| shown(values, style));
        }
        Some(name) => {
            let detail = follow::state(&client, &name)?;
            context.print(&detail, human);
        }
    }
    Ok(())
}

/// Formats values as a table, with their cycle.
#[must_use]
pub fn shown(values: &ValuesView, style: Style) -> String {
    let of = match values.net_cycle {
        0 => "not yet evaluated: showing initial values".to_owned(),
        cycles => format!(
            "cycle {}, net cycle {}, {:.3} s after its start",
            grouped(values.cycle),
            grouped(cycles),
            values.time_s
        ),
    };
    let head = format!("{}#{}  {}  {of}", values.net, values.id, values.state);
    format!("{head}\n{}", value::rows(&values.values, style))
}

fn human(detail: &CommandDetail) -> String {
    let command = &detail.command;
    let mut lines = vec![format!(
        "{}  {}",
        follow::title(command),
        follow::state_text(command)
    )];
    let mut add = |head: &str, text: String| {
        if !text.is_empty() {
            lines.push(format!("  {head:<12} {text}"));
        }
    };
    add("description", command.description.clone());
    let fault = command.fault.as_ref();
    add(
        "fault",
        fault.map_or_else(String::new, |fault| fault.words.clone()),
    );
    add("uses", command.uses.join(", "));
    add(
        "cancel",
        if command.can_cancel {
            "possible"
        } else {
            "not supported; use abort"
        }
        .into(),
    );
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
    let style = DrawingStyle {
        colour: false,
        columns: TerminalSize::of_stdout().map(|size| size.columns),
    };
    let drawn = draw(&command.diagnostics, None, style);
    if !drawn.is_empty() {
        text.push('\n');
        text.push_str(&drawn);
    }
    text
}
